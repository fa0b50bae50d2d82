use std::path::Path;

use super::*;

const DT_S: f64 = 0.02;

fn robot() -> Arc<RobotModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&folder, "anymal_d").unwrap())
}

/// The stand pose with the left front and right hind leg lifted, as in a trot.
fn mid_trot(robot: &RobotModel) -> Vec<f32> {
    let mut position = robot.stand_position_rad();
    for (index, joint) in robot.description.joints.iter().enumerate() {
        position[index] += match joint.name.as_str() {
            "LF_HFE" => 0.5,
            "LF_KFE" => -0.9,
            "RH_HFE" => -0.4,
            "RH_KFE" => 0.7,
            _ => 0.0,
        };
    }
    position
}

const MID_TROT: [bool; 4] = [false, true, true, false];

fn feet_m(stand: &Stand, position_rad: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    let position: Vec<f64> = (0..stand.held_rad.len()).map(position_rad).collect();
    stand.legs.iter().map(|leg| leg.foot_in_base_m(&position)).collect()
}

fn targets(stand: &mut Stand, sensed: Sensed<'_>) -> Vec<JointTarget> {
    let mut joints = vec![JointTarget::default(); stand.held_rad.len()];
    stand.step(DT_S, sensed, &mut joints);
    joints
}

#[test]
fn feet_of_the_stand_pose_lie_at_the_stated_height_under_their_corners() {
    let robot = robot();
    let stand = Stand::new(Arc::clone(&robot));
    let feet = feet_m(&stand, |joint| robot.description.joints[joint].stand_rad);
    for ([x, y, z], foot) in feet.into_iter().zip(&robot.description.feet) {
        let height_m = foot.radius_m - z;
        assert!((height_m - robot.description.stand_height_m).abs() < 1e-3, "{}: {height_m}", foot.name);
        assert_eq!(x > 0.0, foot.name[1..].starts_with('F'), "{}", foot.name);
        assert_eq!(y > 0.0, foot.name.starts_with('L'), "{}", foot.name);
    }
}

#[test]
fn the_motion_of_a_foot_is_the_derivative_of_its_place() {
    let robot = robot();
    let stand = Stand::new(Arc::clone(&robot));
    let at: Vec<f64> =
        mid_trot(&robot).iter().enumerate().map(|(i, q)| f64::from(*q) + 0.02 * i as f64).collect();
    for leg in &stand.legs {
        for axis in 0..3 {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            for (joint, found) in leg.joints().zip(leg.moves_foot(&at, direction)) {
                let moved = |by: f64| {
                    let mut position = at.clone();
                    position[joint] += by;
                    leg.foot_in_base_m(&position)[axis]
                };
                let wanted = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!((found - wanted).abs() < 1e-6, "joint {joint}, axis {axis}: {found}, {wanted}");
            }
        }
    }
}

#[test]
fn a_swinging_foot_is_lowered_straight_down_at_no_more_than_the_stated_speed_until_it_touches() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = mid_trot(&robot);
    let landing = [true, true, true, false];
    let sensed = |contact| Sensed { position_rad: Some(&position), contact, ..Sensed::default() };
    let last = vec![JointTarget::default(); position.len()];
    stand.begin(sensed(Some(&MID_TROT)), Some(&last));
    let begun = feet_m(&stand, |joint| f64::from(position[joint]));
    let mut before = begun.clone();
    for tick in 0..10 {
        targets(&mut stand, sensed(Some(&MID_TROT)));
        let feet = feet_m(&stand, |joint| stand.held_rad[joint]);
        for (leg, foot) in robot.description.feet.iter().enumerate() {
            let down = (before[leg][2] - feet[leg][2]) / DT_S;
            if MID_TROT[leg] {
                assert!(down.abs() < 1e-9, "{} at tick {tick} is held: {down} m/s", foot.name);
            } else {
                assert!((0.2..=0.301).contains(&down), "{} at tick {tick}: {down} m/s", foot.name);
                let aside = (feet[leg][0] - begun[leg][0]).hypot(feet[leg][1] - begun[leg][1]);
                assert!(aside < 0.01, "{} went {aside} m aside", foot.name);
            }
        }
        before = feet;
    }
    targets(&mut stand, sensed(Some(&landing)));
    assert_eq!(stand.landed, landing);
    assert!((stand.held_rad[1] - f64::from(position[1])).abs() < 1e-9, "held where it was measured to touch");
}

#[test]
fn a_foot_over_a_hole_is_not_lowered_for_ever() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = mid_trot(&robot);
    let sensed = Sensed { position_rad: Some(&position), contact: Some(&MID_TROT), ..Sensed::default() };
    stand.begin(sensed, None);
    for _ in 0..500 {
        targets(&mut stand, sensed);
    }
    let depth_m = -feet_m(&stand, |joint| stand.held_rad[joint])[0][2];
    let stand_depth_m = stand.stand_depth_m();
    assert!(depth_m > stand_depth_m - 0.02 && depth_m < stand_depth_m + 0.21, "{depth_m}, {stand_depth_m}");
    for (joint, held) in robot.description.joints.iter().zip(&stand.held_rad) {
        assert!((joint.lower_rad..=joint.upper_rad).contains(held), "{}", joint.name);
    }
}

#[test]
fn the_legs_on_the_ground_carry_the_weight_between_them() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = robot.stand_position_rad();
    let sensed = Sensed { position_rad: Some(&position), contact: Some(&[true; 4]), ..Sensed::default() };
    stand.begin(sensed, None);
    let joints = targets(&mut stand, sensed);
    // The work of lowering every foot by 1 mm against its share of the weight, joint by joint.
    let weight_n = robot.description.mass_kg * GRAVITY_M_PER_S2;
    let mut carried_n = 0.0;
    for leg in &stand.legs {
        let moves = leg.moves_foot(&stand.held_rad, [0.0, 0.0, -1.0]);
        let square: f64 = moves.iter().map(|m| m * m).sum();
        let push: f64 = leg
            .joints()
            .zip(&moves)
            .map(|(joint, moved)| {
                let stiffness = f64::from(joints[joint].stiffness_nm_per_rad);
                stiffness * f64::from(joints[joint].position_rad - position[joint]) * moved
            })
            .sum();
        carried_n += push / square;
    }
    assert!((carried_n - weight_n).abs() < 1.0, "{carried_n} of {weight_n} N");
}

#[test]
fn a_leg_on_the_ground_begins_with_the_torque_it_had() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = robot.stand_position_rad();
    let last: Vec<_> = position
        .iter()
        .enumerate()
        .map(|(index, q)| JointTarget {
            position_rad: q + 0.02 * index as f32,
            stiffness_nm_per_rad: 95.0,
            damping_nms_per_rad: 3.6,
            feed_forward_nm: -3.0,
        })
        .collect();
    let sensed = Sensed { position_rad: Some(&position), contact: Some(&MID_TROT), ..Sensed::default() };
    stand.begin(sensed, Some(&last));
    for (leg, touches) in stand.legs.iter().zip(MID_TROT) {
        for joint in leg.joints() {
            let wanted = if touches { 95.0 * 0.02 * joint as f64 - 3.0 } else { 0.0 };
            assert!((stand.load_nm[joint] - wanted).abs() < 1e-3, "joint {joint}: {}", stand.load_nm[joint]);
        }
    }
}

#[test]
fn without_contact_sensing_the_deepest_feet_are_taken_to_touch_and_the_others_come_down_to_them() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = mid_trot(&robot);
    let sensed = Sensed { position_rad: Some(&position), ..Sensed::default() };
    stand.begin(sensed, None);
    assert_eq!(stand.landed, MID_TROT);
    for _ in 0..100 {
        targets(&mut stand, Sensed::default());
    }
    assert!(stand.is_settled());
    let depths = stand.depths_m([0.0, 0.0, -1.0]);
    assert!(depths.iter().all(|depth| (depth - depths[1]).abs() < 0.01), "{depths:?}");
}

#[test]
fn without_any_measurement_it_begins_at_the_last_targets_or_in_the_stand_pose() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let last: Vec<_> = mid_trot(&robot)
        .into_iter()
        .map(|position_rad| JointTarget { position_rad, ..JointTarget::default() })
        .collect();
    stand.begin(Sensed::default(), Some(&last));
    for (held, last) in stand.held_rad.iter().zip(&last) {
        assert!((held - f64::from(last.position_rad)).abs() < 1e-6);
    }
    stand.begin(Sensed::default(), None);
    for target in targets(&mut stand, Sensed::default()) {
        assert!(target.position_rad.is_finite() && target.stiffness_nm_per_rad > 0.0);
    }
    assert!(stand.is_settled());
}

#[test]
fn a_standing_robot_that_is_pushed_brakes_and_one_at_rest_does_not() {
    let robot = robot();
    let at_rest = robot.stand_position_rad();
    let mut stand = Stand::new(Arc::clone(&robot));
    let mut joints = vec![JointTarget::default(); robot.joint_count()];
    let mut damping = |speed_m_per_s: f32| {
        let sensed = Sensed {
            position_rad: Some(&at_rest),
            velocity_m_per_s: Some([0.0, -speed_m_per_s, 0.0]),
            ..Sensed::default()
        };
        stand.step(0.02, sensed, &mut joints);
        joints[0].damping_nms_per_rad / robot.stand.damping_nms_per_rad
    };
    assert_eq!(damping(0.0), 1.0);
    assert_eq!(damping(0.1), 1.0, "what sensors make up is no push");
    assert!((damping(0.5) - BRAKING_DAMPING as f32).abs() < 1e-5);
    let fading = damping(0.0);
    assert!(fading > 2.9 && fading < 3.0, "{fading}: it fades as after a stop");
}
