//! What is fed to whom: bytes that anybody may have written, into every door that takes such bytes.
//! A target returns whatever it is given; a panic, an abort or a value that must not get out is a bug.

use std::cell::RefCell;
use std::io::Write as _;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use flate2::Compression;
use flate2::write::GzEncoder;
use vocaloco_core::bundle;
use vocaloco_core::elevation::Elevation;
use vocaloco_core::heightfield::{COLUMNS, Field, Heightfield, ROWS};
use vocaloco_core::lock::{PublicKey, Signature};
use vocaloco_core::manifest::{CommandRange, Deployment, SkillManifest};
use vocaloco_core::policy::PolicyNetwork;
use vocaloco_core::predictor::{Predictor, Quantity};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::runtime::{CallFault, Controller, Predict, Runtime, RuntimeConfig, Skill};
use vocaloco_core::selector::{Prediction, Rule};
use vocaloco_core::stdio::{self, Greeting};
use vocaloco_core::switch::Windows;
use vocaloco_plugin_api::abi::abi_stable::std_types::RSome;
use vocaloco_plugin_api::{Command, CommandKind, JointTarget, Needs, RobotState, TerrainPatch};

/// A door: bytes in, nothing out.
pub(crate) type Target = fn(&[u8]);

/// Every target by the name of its corpus.
pub(crate) const TARGETS: [(&str, Target); 9] = [
    ("manifest", manifest),
    ("deployment", deployment),
    ("robot", robot),
    ("model", model),
    ("heightfield", heightfield),
    ("line", line),
    ("bundle", unpacked),
    ("archive", archive),
    ("signature", signature),
];

/// What parts the MJCF from the TOML in an input of `robot`.
pub(crate) const PART: &[u8] = b"\n=====\n";

/// A skill's manifest.
fn manifest(bytes: &[u8]) {
    if let Ok(text) = String::from_utf8(bytes.to_vec())
        && let Ok(manifest) = SkillManifest::parse(Path::new("manifests/skills/ascend.toml"), text)
    {
        assert!((0.0..=1.0).contains(&manifest.selection.viability_threshold));
        assert!(manifest.command.forward_m_per_s.iter().all(|speed| speed.is_finite()));
        assert!(!manifest.models.cot.has_root());
    }
}

/// A deployment's manifest.
fn deployment(bytes: &[u8]) {
    if let Ok(text) = String::from_utf8(bytes.to_vec())
        && let Ok(deployment) = Deployment::parse(Path::new("manifests/deployments/one.toml"), text)
    {
        assert!(
            deployment.rate_hz.is_finite() && deployment.switch_window > 0 && !deployment.skills.is_empty()
        );
    }
}

/// A robot's MJCF and the TOML beside it.
fn robot(bytes: &[u8]) {
    let at = bytes.windows(PART.len()).position(|window| window == PART);
    let (mjcf, settings) = at.map_or((bytes, &b""[..]), |at| (&bytes[..at], &bytes[at + PART.len()..]));
    let read = |path: &Path| {
        let is_mjcf = path.extension().is_some_and(|extension| extension == "xml");
        Ok(if is_mjcf { mjcf } else { settings }.to_vec())
    };
    if let Ok(robot) = RobotModel::load_by(Path::new("robots"), "anymal_d", &read) {
        assert!(robot.description.mass_kg.is_finite() && robot.joint_count() < 1000);
    }
}

/// A model's file, in each of its places.
fn model(bytes: &[u8]) {
    let file = Path::new("model.onnx");
    for quantity in [Quantity::Viability, Quantity::Cot] {
        let _ = Predictor::from_bytes(bytes, file, quantity);
    }
    let _ = PolicyNetwork::from_bytes(bytes, file);
}

/// Heights as a sensor may send them: through the patch into the field that the networks see.
fn heightfield(bytes: &[u8]) {
    let mut numbers = bytes.as_chunks().0.iter().map(|&raw| f32::from_le_bytes(raw));
    let mut raw = Heightfield { cells_m: [[0.0; COLUMNS]; ROWS] };
    for cell in raw.cells_m.as_flattened_mut() {
        *cell = numbers.next().unwrap_or(0.0);
    }
    let noise = numbers.next().map(|noise_m| [[noise_m; COLUMNS]; ROWS]);
    if let Ok(field) = raw.prepare(noise.as_ref()) {
        assert!(field.as_slice().iter().all(|height| height.is_finite()), "{:?}", field.as_slice());
    }
    let mut next = || f64::from(numbers.next().unwrap_or(1.0));
    let mut elevation = Elevation {
        t_s: next(),
        resolution_m: next(),
        back_m: next(),
        front_m: next(),
        half_width_m: next(),
        height_m: Vec::new(),
    };
    // As many heights as the map says that it has, where that is no continent; otherwise as few.
    let count = elevation.rows().saturating_mul(elevation.columns()).min(20_000);
    elevation.height_m.extend(raw.cells_m.as_flattened().iter().cycle().take(count));
    if elevation.check().is_ok() {
        let mut patch_m = vec![0.0; MAP.rows() * MAP.columns()];
        elevation.patch(&MAP, &mut patch_m);
    }
    if let Ok(field) = elevation.heightfield() {
        let _ = field
            .prepare(None)
            .map(|field| assert!(field.as_slice().iter().all(|height| height.is_finite())));
    }
}

/// What a plugin of the session asks of the map.
const MAP: TerrainPatch = TerrainPatch { back_m: 1.2, front_m: 2.2, half_width_m: 0.7, resolution_m: 0.05 };

/// Holds whatever joints it is given.
struct Holds;

impl Controller for Holds {
    fn reset(&mut self, _: &RobotState<'_>) -> Result<(), CallFault> {
        Ok(())
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        _: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault> {
        for (target, &position_rad) in joints.iter_mut().zip(state.joint_position_rad.iter()) {
            let (stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm) = (80.0, 2.0, 0.0);
            *target =
                JointTarget { position_rad, stiffness_nm_per_rad, damping_nms_per_rad, feed_forward_nm };
        }
        Ok(())
    }
}

/// Likes whatever it is shown.
struct Likes;

impl Predict for Likes {
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>) {
        assert!(field.as_slice().iter().all(|height| height.is_finite()), "{:?}", field.as_slice());
        (Prediction::of(0.99, 0.3), None)
    }
}

/// A loop whose one skill drives from the first usable line on, and its greeting.
fn session() -> (Runtime, Greeting) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let robots = here.ancestors().map(|folder| folder.join("manifests/robots")).find(|it| it.is_dir());
    let robot = RobotModel::load(&robots.expect("the repository"), "anymal_d").expect("the shipped robot");
    let skill = Skill {
        rule: Rule {
            name: "any".to_owned(),
            viability_threshold: 0.9,
            hold_threshold: 0.9,
            cost_margin: 0.0,
            command: CommandRange {
                kind: CommandKind::Velocity,
                forward_m_per_s: [-1.0, 1.0],
                target_distance_m: None,
            },
            time_limit_s: 4.0,
            committed: false,
        },
        needs: Needs { policy: false, terrain: RSome(MAP), foot_contacts: true, joint_torques: false },
        controller: Box::new(Holds),
        predictors: Box::new(Likes),
    };
    let config = RuntimeConfig::of(Windows { switch: 1, stop: 1, resume: 1 });
    let runtime = Runtime::from_skills(config, Arc::new(robot), vec![skill]);
    let greeting = Greeting::of(&runtime, "any", Vec::new());
    (runtime, greeting)
}

/// All that `run --source stdio` is sent: every line is answered, with targets that are numbers.
fn line(bytes: &[u8]) {
    thread_local! {
        static SESSION: RefCell<(Runtime, Greeting)> = RefCell::new(session());
    }
    SESSION.with_borrow_mut(|(runtime, greeting)| {
        runtime.restart();
        let mut answers = Vec::new();
        let served = stdio::serve(runtime, greeting, bytes, &mut answers, |_| ControlFlow::Continue(()));
        let served = served.expect("memory takes it");
        let answers = std::str::from_utf8(&answers).expect("UTF-8");
        let lines = bytes.split(|&byte| byte == b'\n').count()
            - usize::from(bytes.is_empty() || bytes.ends_with(b"\n"));
        assert_eq!((served.lines, answers.lines().count()), (lines as u64, 1 + lines));
        // A number that is none is written as null.
        assert!(!answers.contains("_rad\":null") && !answers.contains("_nm\":null"), "{answers}");
    });
}

/// A bundle.
fn unpacked(bytes: &[u8]) {
    if let Ok(bundle) = bundle::unpack(Path::new("a.skill"), bytes) {
        assert!(!bundle.skill().is_empty() && !bundle.skill().contains('/'));
    }
}

/// What a bundle is once it is decompressed: a tar, which chance seldom finds through gzip's checksum.
fn archive(bytes: &[u8]) {
    let mut stored = GzEncoder::new(Vec::new(), Compression::none());
    let packed = stored.write_all(bytes).and_then(|()| stored.finish());
    unpacked(&packed.expect("memory takes it"));
}

/// A signature's file, and a key in a deployment.
fn signature(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        let _ = Signature::parse(Path::new("a.lock.sig"), text);
        let _ = text.parse::<PublicKey>();
    }
}
