//! The generic plugin `onnx`: any feed-forward policy, by the contract in its manifest, with no code of
//! its own. The host runs the network; observation and action are those of `vocaloco-plugin-api`.

mod policy_skill;

pub use policy_skill::PolicySkill;

vocaloco_plugin_api::export_skill!(PolicySkill);
