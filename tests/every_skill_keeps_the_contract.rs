//! What the host relies on, of every skill that is shipped: the same inputs since reset give the same
//! bytes, targets are finite, bad input and bad parameters are errors, and nothing panics.

use vocaloco_core::plugin::PluginInstance;
use vocaloco_core::registry::{LoadedSkill, ModelPolicy, load_skill};
use vocaloco_core::robot::RobotModel;
use vocaloco_plugin_api::{Command, ErrorCode, JointTarget, RobotState, SkillError};
use vocaloco_tests::shipped;

const TICKS: usize = 150;

fn robot() -> RobotModel {
    RobotModel::load(&shipped().robots_folder(), "anymal_d").expect("the shipped robot")
}

fn skills(robot: &RobotModel) -> Vec<LoadedSkill> {
    let installation = shipped();
    let names = installation.skill_names().expect("a readable folder");
    for wanted in ["walk", "ascend", "descend"] {
        assert!(names.iter().any(|name| name == wanted), "{wanted} is shipped, found {names:?}");
    }
    let load = |name: &String| load_skill(&installation, name, &robot.description, ModelPolicy::Optional);
    names.iter().map(|name| load(name).unwrap_or_else(|refusal| panic!("{refusal}"))).collect()
}

/// A state with storage of its own, so that a test may spoil any part.
#[derive(Clone)]
struct Measured {
    time_s: f64,
    position_rad: Vec<f32>,
    velocity_rad_per_s: Vec<f32>,
    torque_nm: Vec<f32>,
    linear: [f32; 3],
    angular: [f32; 3],
    gravity: [f32; 3],
    contact: Vec<u8>,
    terrain_m: Vec<f32>,
}

impl Measured {
    /// Around the stand on gently rolling ground, another one each tick, no two joints alike.
    fn at(tick: usize, skill: &LoadedSkill, robot: &RobotModel) -> Self {
        let description = &robot.description;
        let joints = description.joints.len();
        let wave = |phase: f64| libm::sin(0.1 * tick as f64 + phase) as f32;
        let joint_wave = |size: f32| (0..joints).map(|joint| size * wave(joint as f64)).collect::<Vec<_>>();
        let roll = 0.03 * wave(0.3);
        let points = skill.needs.terrain.as_ref().map_or(0, |it| it.rows() * it.columns());
        let ground_m = -description.stand_height_m as f32;
        Self {
            time_s: 0.02 * tick as f64,
            position_rad: joint_wave(0.05)
                .iter()
                .zip(robot.stand_position_rad())
                .map(|(wave, stand)| wave + stand)
                .collect(),
            velocity_rad_per_s: joint_wave(0.5),
            torque_nm: joint_wave(10.0),
            linear: [0.4 + 0.1 * wave(0.0), 0.05 * wave(1.0), 0.02 * wave(2.0)],
            angular: [0.1 * wave(3.0), 0.1 * wave(4.0), 0.05 * wave(5.0)],
            gravity: [0.02, roll, -libm::sqrtf(1.0 - 0.02 * 0.02 - roll * roll)],
            contact: (0..description.feet.len())
                .map(|foot| u8::from((tick / 12 + foot).is_multiple_of(2)))
                .collect(),
            terrain_m: (0..points).map(|point| ground_m + 0.01 * wave(point as f64)).collect(),
        }
    }

    fn state(&self) -> RobotState<'_> {
        RobotState {
            time_s: self.time_s,
            joint_position_rad: self.position_rad.as_slice().into(),
            joint_velocity_rad_per_s: self.velocity_rad_per_s.as_slice().into(),
            joint_torque_nm: self.torque_nm.as_slice().into(),
            base_linear_velocity_m_per_s: self.linear,
            base_angular_velocity_rad_per_s: self.angular,
            projected_gravity: self.gravity,
            foot_contact: self.contact.as_slice().into(),
            terrain_m: self.terrain_m.as_slice().into(),
        }
    }
}

fn command(skill: &LoadedSkill) -> Command {
    let velocity = Command::velocity(0.6, 0.0, 0.1);
    Command { kind: skill.manifest.command.kind, target: [1.2, -0.1, 0.05, 5.0], ..velocity }
}

fn instance(skill: &LoadedSkill, robot: &RobotModel) -> PluginInstance {
    skill.create(&robot.description).unwrap_or_else(|error| panic!("{}: {error}", skill.manifest.name))
}

fn act(
    instance: &mut PluginInstance,
    measured: &Measured,
    (skill, robot): (&LoadedSkill, &RobotModel),
) -> Result<Vec<JointTarget>, SkillError> {
    // Filled with NaN, so that a target left untouched is noticed.
    let untouched = JointTarget {
        position_rad: f32::NAN,
        stiffness_nm_per_rad: f32::NAN,
        damping_nms_per_rad: f32::NAN,
        feed_forward_nm: f32::NAN,
    };
    let mut joints = vec![untouched; robot.joint_count()];
    instance.act(&measured.state(), &command(skill), &mut joints).map(|()| joints)
}

/// The targets of a whole sequence from a reset on.
fn sequence(instance: &mut PluginInstance, skill: &LoadedSkill, robot: &RobotModel) -> Vec<Vec<JointTarget>> {
    let name = &skill.manifest.name;
    instance.reset(&Measured::at(0, skill, robot).state()).unwrap_or_else(|error| panic!("{name}: {error}"));
    (0..TICKS)
        .map(|tick| {
            act(instance, &Measured::at(tick, skill, robot), (skill, robot))
                .unwrap_or_else(|error| panic!("{name}, tick {tick}: {error}"))
        })
        .collect()
}

fn numbers(target: &JointTarget) -> [f32; 4] {
    [target.position_rad, target.stiffness_nm_per_rad, target.damping_nms_per_rad, target.feed_forward_nm]
}

fn same_bytes(name: &str, what: &str, left: &[Vec<JointTarget>], right: &[Vec<JointTarget>]) {
    assert_eq!(left.len(), right.len());
    for (tick, (left, right)) in left.iter().zip(right).enumerate() {
        for (joint, (left, right)) in left.iter().zip(right).enumerate() {
            let bits = |target| numbers(target).map(f32::to_bits);
            assert_eq!(bits(left), bits(right), "{name}, {what}, tick {tick}, joint {joint}");
        }
    }
}

#[test]
fn the_same_inputs_since_reset_give_the_same_bytes() {
    let robot = robot();
    for skill in skills(&robot) {
        let name = &skill.manifest.name;
        let mut one = instance(&skill, &robot);
        let first = sequence(&mut one, &skill, &robot);
        same_bytes(name, "again after a reset", &first, &sequence(&mut one, &skill, &robot));
        same_bytes(
            name,
            "in a fresh instance",
            &first,
            &sequence(&mut instance(&skill, &robot), &skill, &robot),
        );
        let moves = first[0].iter().zip(&first[TICKS / 3]).any(|(a, b)| numbers(a) != numbers(b));
        assert!(moves, "{name} does something");
    }
}

#[test]
fn instances_do_not_disturb_each_other() {
    let robot = robot();
    for skill in skills(&robot) {
        let name = &skill.manifest.name;
        let alone = sequence(&mut instance(&skill, &robot), &skill, &robot);
        let (mut one, mut other) = (instance(&skill, &robot), instance(&skill, &robot));
        let at = |tick| Measured::at(tick, &skill, &robot);
        one.reset(&at(0).state()).expect("a reset");
        other.reset(&at(40).state()).expect("a reset");
        let mixed: Vec<_> = (0..TICKS)
            .map(|tick| {
                act(&mut other, &at(tick + 40), (&skill, &robot)).expect("targets");
                act(&mut one, &at(tick), (&skill, &robot)).expect("targets")
            })
            .collect();
        same_bytes(name, "beside another instance", &alone, &mixed);
    }
}

#[test]
fn every_target_is_finite_and_no_gain_is_negative() {
    let robot = robot();
    for skill in skills(&robot) {
        for (tick, targets) in sequence(&mut instance(&skill, &robot), &skill, &robot).iter().enumerate() {
            for (target, joint) in targets.iter().zip(&robot.description.joints) {
                let [_, stiffness, damping, _] = numbers(target);
                let sound = numbers(target).iter().all(|number| number.is_finite())
                    && (0.0..=1e4).contains(&stiffness)
                    && (0.0..=1e3).contains(&damping);
                assert!(sound, "{}, tick {tick}, {}: {target:?}", skill.manifest.name, joint.name);
            }
        }
    }
}

/// What spoils one part of a measurement.
type Spoil = (&'static str, fn(&mut Measured, f32));

const SPOILS: [Spoil; 8] = [
    ("joint position", |it, value| it.position_rad[4] = value),
    ("joint velocity", |it, value| it.velocity_rad_per_s[7] = value),
    ("joint torque", |it, value| it.torque_nm[1] = value),
    ("linear velocity", |it, value| it.linear[0] = value),
    ("angular velocity", |it, value| it.angular[2] = value),
    ("gravity", |it, value| it.gravity = [value; 3]),
    ("one height", |it, value| it.terrain_m.iter_mut().skip(20).take(1).for_each(|cell| *cell = value)),
    ("all heights", |it, value| it.terrain_m.fill(value)),
];

#[test]
fn nan_and_infinity_are_an_error_or_survived_and_never_a_panic() {
    let robot = robot();
    for skill in skills(&robot) {
        for (part, spoil) in SPOILS {
            for value in [f32::NAN, f32::INFINITY, 1e30] {
                let at = format!("{}, {part} {value}", skill.manifest.name);
                let mut one = instance(&skill, &robot);
                one.reset(&Measured::at(0, &skill, &robot).state()).expect("a reset");
                for tick in 0..60 {
                    let mut measured = Measured::at(tick, &skill, &robot);
                    if tick >= 10 {
                        spoil(&mut measured, value);
                    }
                    match act(&mut one, &measured, (&skill, &robot)) {
                        Err(error) => assert_ne!(error.code, ErrorCode::Panic, "{at}, tick {tick}: {error}"),
                        Ok(targets) => {
                            // Out of absurd but finite numbers may come what the runtime refuses.
                            let finite = targets.iter().flat_map(numbers).all(f32::is_finite);
                            assert!(finite || value.is_finite(), "{at}, tick {tick}: {targets:?}");
                        }
                    }
                }
            }
        }
    }
}

/// What gives one array of a measurement another length.
type Cut = (&'static str, fn(&mut Measured));

#[test]
fn arrays_of_another_length_are_an_error_that_names_them() {
    let robot = robot();
    let cuts: [Cut; 3] = [
        ("joint_position_rad", |it| it.position_rad.truncate(11)),
        ("joint_velocity_rad_per_s", |it| it.velocity_rad_per_s.push(0.0)),
        ("terrain_m", |it| it.terrain_m.truncate(5)),
    ];
    for skill in skills(&robot) {
        let mut one = instance(&skill, &robot);
        one.reset(&Measured::at(0, &skill, &robot).state()).expect("a reset");
        for (field, cut) in cuts {
            let mut measured = Measured::at(1, &skill, &robot);
            cut(&mut measured);
            let error = act(&mut one, &measured, (&skill, &robot)).expect_err(field);
            assert!(error.code == ErrorCode::Input && error.message.contains(field), "{error}");
        }
        let mut few = vec![JointTarget::default(); 3];
        let state = Measured::at(1, &skill, &robot);
        one.act(&state.state(), &command(&skill), &mut few).expect_err("three targets");
    }
}

#[test]
fn a_parameter_is_taken_at_its_limits_and_refused_beyond_them() {
    let robot = robot();
    for skill in skills(&robot) {
        let name = &skill.manifest.name;
        // A policy's text is its contract; what runs none has a default for everything.
        let text = if skill.policy.is_some() { skill.parameters.as_str() } else { "" };
        let own: toml::Table = toml::from_str(text).expect("TOML");
        let create = |text: &str| skill.library.create_with(text, &robot.description, skill.policy.as_ref());
        let with = |key: &str, value: f64| {
            let mut table = own.clone();
            table.insert(key.to_owned(), toml::Value::Float(value));
            table.to_string()
        };
        create(text).unwrap_or_else(|error| panic!("{name}: its defaults: {error}"));
        for parameter in &skill.library.description().parameters {
            let (key, min, max) = (&parameter.name, parameter.range.min, parameter.range.max);
            let step = 0.01 * (max - min);
            for inside in [min, max, parameter.default] {
                create(&with(key, inside)).unwrap_or_else(|error| panic!("{name}: {key} {inside}: {error}"));
            }
            for outside in [min - step, max + step, f64::NAN] {
                let error = create(&with(key, outside)).expect_err(key).to_string();
                assert!(error.contains(key.as_str()) && !error.contains('\n'), "{name}: {outside}: {error}");
            }
        }
        let error = create(&with("no_such_parameter", 1.0)).expect_err("unknown").to_string();
        assert!(error.contains("no_such_parameter") && !error.contains('\n'), "{name}: {error}");
        create("= = =").expect_err("not a parameter file");
    }
}

#[test]
fn a_robot_without_legs_is_an_error() {
    let robot = robot();
    for skill in skills(&robot) {
        let mut stump = robot.description.clone();
        stump.joints.clear();
        stump.feet.clear();
        if let Ok(mut one) = skill.create(&stump) {
            // It may hold nothing at all, but must not reach for joints that are not there.
            let mut measured = Measured::at(0, &skill, &robot);
            (measured.position_rad, measured.velocity_rad_per_s) = (vec![], vec![]);
            let result = one.act(&measured.state(), &command(&skill), &mut []);
            assert!(result.err().is_none_or(|error| error.code != ErrorCode::Panic));
        }
    }
}
