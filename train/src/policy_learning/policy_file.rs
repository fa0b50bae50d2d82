//! A trained policy as `policy.onnx`: `obs` f32 `[1, n]`, raw as observed → `actions` f32 `[1, m]`.
//!
//! The observation's scaling is folded into the first layer. What the policy was trained with stands in
//! `metadata_props`, under the names that Isaac Lab's exporter uses and, whole, as `contract`.

use tract_onnx::pb;
use vocaloco_plugin_api::contract::{Contract, ContractError};

use super::learner::Learner;
use super::network::Layer;
use super::normaliser::Scaling;
use crate::onnx::{Graph, Rows, fully_connected, initializer, node, value};

/// Layer `layer` of `parameters` as ONNX has it, weights `[output][input]`, with `scaling` folded in.
///
/// ```text
/// W·((x − mean)∘factor) + b = (W∘factor)·x + (b − (W∘factor)·mean)
/// ```
fn tensors(name: &str, layer: &Layer, parameters: &[f32], scaling: Option<&Scaling>) -> [pb::TensorProto; 2] {
    let (weights, biases) = (layer.weights(parameters), layer.biases(parameters));
    let mut turned = vec![0.0; weights.len()];
    let mut shifted: Vec<f64> = biases.iter().map(|bias| f64::from(*bias)).collect();
    for input in 0..layer.inputs {
        let (mean, factor) =
            scaling.map_or((0.0, 1.0), |scaling| (scaling.mean[input], scaling.factor[input]));
        for output in 0..layer.outputs {
            let weight = weights[input * layer.outputs + output] * factor;
            turned[output * layer.inputs + input] = weight;
            shifted[output] -= f64::from(weight) * f64::from(mean);
        }
    }
    let shifted: Vec<f32> = shifted.iter().map(|bias| *bias as f32).collect();
    [
        initializer(&format!("{name}.weight"), &[layer.outputs, layer.inputs], &turned),
        initializer(&format!("{name}.bias"), &[layer.outputs], &shifted),
    ]
}

/// The file's bytes for the policy's network, with `metadata`.
pub fn onnx(learner: &Learner, metadata: Vec<(String, String)>) -> Vec<u8> {
    let layers = learner.actor.layers();
    let scaling = learner.observation.scaling();
    let (mut nodes, mut initializers) = (Vec::new(), Vec::new());
    let mut input = "obs".to_owned();
    for (at, layer) in layers.iter().enumerate() {
        let name = format!("layer{at}");
        initializers.extend(tensors(&name, layer, learner.weights(), (at == 0).then_some(&scaling)));
        if at + 1 == layers.len() {
            nodes.push(fully_connected(&name, &input, "actions"));
        } else {
            nodes.push(fully_connected(&name, &input, &name));
            input = format!("elu{at}");
            nodes.push(node("Elu", &[&name], &input, vec![]));
        }
    }
    Graph {
        name: "policy",
        nodes,
        initializers,
        input: value("obs", Rows::One, &[learner.actor.inputs() as i64]),
        output: value("actions", Rows::One, &[learner.actor.outputs() as i64]),
        metadata,
    }
    .encode()
}

/// What a policy was trained with, for `metadata_props`.
///
/// # Errors
/// The contract leaves out a joint.
///
/// # Panics
/// Never: a contract is names and numbers.
pub fn metadata(contract: &Contract, skill: &str, seed: u64) -> Result<Vec<(String, String)>, ContractError> {
    let joints = &contract.joints;
    let list = |values: &[f64]| {
        let values: Vec<String> = values.iter().map(ToString::to_string).collect();
        values.join(",")
    };
    let default_position_rad: Vec<f64> = joints
        .iter()
        .map(|joint| contract.action.default_position_rad.get(joint).copied().unwrap_or_default())
        .collect();
    let stiffness = contract.gains.stiffness_nm_per_rad.in_order("gains.stiffness_nm_per_rad", joints)?;
    let damping = contract.gains.damping_nms_per_rad.in_order("gains.damping_nms_per_rad", joints)?;
    let scale = contract.action.scale.in_order("action.scale", joints)?;
    let terms: Vec<&str> = contract.observation.iter().map(|term| term.term.name()).collect();
    let metadata = [
        ("action_scale", list(&scale)),
        ("command_names", "base_velocity".to_owned()),
        ("contract", serde_json::to_string(contract).expect("names and numbers")),
        ("default_joint_pos", list(&default_position_rad)),
        ("joint_damping", list(&damping)),
        ("joint_names", joints.join(",")),
        ("joint_stiffness", list(&stiffness)),
        ("observation_names", terms.join(",")),
        ("seed", seed.to_string()),
        ("skill", skill.to_owned()),
    ];
    Ok(metadata.map(|(key, value)| (key.to_owned(), value)).to_vec())
}

#[cfg(test)]
mod tests {
    use super::super::config::Plan;
    use super::super::learner::Widths;
    use super::super::single_pass::Scratch;
    use super::*;
    use tract_onnx::prelude::*;
    use vocaloco_sim::stream::{stream, uniform};

    #[test]
    fn the_file_answers_as_the_policy_did_in_training() {
        let widths = Widths { observation: 30, privileged: 32, action: 12 };
        let mut plan = Plan::with_environment(1, ());
        plan.network.actor = vec![48, 32];
        let mut learner = Learner::new(&plan, widths, 3);
        let mut rng = stream(3, "test/policy_file", &[]);
        learner.policy.iter_mut().for_each(|p| *p += uniform(&mut rng, -0.1, 0.1));
        let rows: Vec<Vec<f32>> = (0..40)
            .map(|_| (0..30).map(|at| 0.1 * at as f32 + uniform(&mut rng, -2.0, 2.0)).collect())
            .collect();
        learner.observation.add(rows.iter().map(Vec::as_slice));
        let bytes = super::onnx(&learner, vec![("skill".into(), "test".into())]);
        let model = tract_onnx::onnx()
            .model_for_read(&mut bytes.as_slice())
            .and_then(InferenceModelExt::into_optimized)
            .and_then(IntoRunnable::into_runnable)
            .unwrap();
        let policy = learner.single_pass();
        let mut scratch = Scratch::default();
        for row in &rows {
            let input = Tensor::from_shape(&[1, 30], row).unwrap();
            let answer = model.run(tvec!(input.into())).unwrap();
            let found = answer[0].to_plain_array_view::<f32>().unwrap();
            let wanted = policy.answer(row, &mut scratch);
            assert_eq!(found.shape(), [1, 12]);
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((found - wanted).abs() < 1e-5, "{found} against {wanted}");
            }
        }
    }
}
