use std::path::Path;

use super::*;

const DT_S: f64 = 0.02;
const DOWN: [f32; 3] = [0.0, 0.0, -1.0];

fn robot() -> Arc<RobotModel> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
    Arc::new(RobotModel::load(&folder, "anymal_d").unwrap())
}

/// The stand pose with the left front and right hind leg lifted, as in a trot.
fn mid_trot(robot: &RobotModel) -> Vec<f32> {
    let mut position = robot.stand_position_rad();
    for (index, joint) in robot.description.joints.iter().enumerate() {
        let lift = match joint.name.as_str() {
            "LF_HFE" => 0.5,
            "LF_KFE" => -0.9,
            "RH_HFE" => -0.4,
            "RH_KFE" => 0.7,
            _ => 0.0,
        };
        position[index] += lift;
    }
    position
}

fn feet_m(stand: &Stand, position: &[JointTarget]) -> Vec<[f64; 3]> {
    let at = |joint: usize| f64::from(position[joint].position_rad);
    stand.legs.iter().map(|leg| leg.foot_in_base_m(at)).collect()
}

#[test]
fn feet_of_the_stand_pose_lie_on_a_plane_at_the_stated_height() {
    let robot = robot();
    let stand = Stand::new(Arc::clone(&robot));
    for (leg, foot) in stand.legs.iter().zip(&robot.description.feet) {
        let [x, y, z] = leg.foot_in_base_m(|joint| robot.description.joints[joint].stand_rad);
        let height_m = foot.radius_m - z;
        assert!((height_m - robot.description.stand_height_m).abs() < 1e-3, "{}: {height_m}", foot.name);
        assert_eq!(
            x > 0.0,
            foot.name.as_str().contains('F') && &foot.name.as_str()[1..2] == "F",
            "{}",
            foot.name
        );
        assert_eq!(y > 0.0, foot.name.starts_with('L'), "{}", foot.name);
    }
}

#[test]
fn a_swinging_foot_is_lowered_at_no_more_than_the_stated_speed_and_arrives() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position = mid_trot(&robot);
    let torque = vec![0.0; position.len()];
    let last = vec![JointTarget::default(); position.len()];
    stand.begin(Handover { position_rad: Some(&position), torque_nm: Some(&torque), last: Some(&last) });
    let mut joints = vec![JointTarget::default(); position.len()];
    let mut before: Vec<_> =
        stand.legs.iter().map(|leg| leg.foot_in_base_m(|joint| f64::from(position[joint]))).collect();
    let lifted_m = before[0][2];
    let mut ticks = 0;
    while !stand.is_settled() {
        stand.step(DT_S, DOWN, &mut joints);
        let feet = feet_m(&stand, &joints);
        for (foot, (now, was)) in robot.description.feet.iter().zip(feet.iter().zip(&before)) {
            let down = (was[2] - now[2]) / DT_S;
            assert!(down <= 0.3 + 1e-4, "{} at tick {ticks}: {down} m/s", foot.name);
        }
        before = feet;
        ticks += 1;
        assert!(ticks < 100, "it must arrive within 2 s");
    }
    assert!(lifted_m - before[0][2] > 0.05, "the fixture must have lifted the foot");
    for (target, wanted) in joints.iter().zip(robot.stand_position_rad()) {
        assert!((target.position_rad - wanted).abs() < 1e-6);
        assert!(target.stiffness_nm_per_rad > 0.0 && target.damping_nms_per_rad > 0.0);
    }
}

#[test]
fn taking_over_keeps_the_torque_that_each_joint_gave() {
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
    stand.begin(Handover { position_rad: Some(&position), torque_nm: None, last: Some(&last) });
    for (index, start) in stand.start_rad.iter().enumerate() {
        let before = 95.0 * 0.02 * index as f64 - 3.0;
        let after = f64::from(robot.stand.stiffness_nm_per_rad) * (start - f64::from(position[index]));
        assert!((before - after).abs() < 1e-3, "joint {index}: {before} and {after} N·m");
    }
}

#[test]
fn a_robot_that_stands_already_is_held_where_it_is() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let position: Vec<f32> = robot.stand_position_rad().iter().map(|q| q + 0.04).collect();
    stand.begin(Handover { position_rad: Some(&position), torque_nm: None, last: None });
    let mut joints = vec![JointTarget::default(); position.len()];
    stand.step(DT_S, DOWN, &mut joints);
    for (target, wanted) in joints.iter().zip(robot.stand_position_rad()) {
        assert!((target.position_rad - wanted).abs() < 1e-6, "no sag below the pose");
    }
}

#[test]
fn without_any_measurement_it_still_ends_in_the_stand_pose() {
    let robot = robot();
    let mut stand = Stand::new(Arc::clone(&robot));
    let last: Vec<_> = mid_trot(&robot)
        .into_iter()
        .map(|position_rad| JointTarget {
            position_rad,
            stiffness_nm_per_rad: 95.0,
            ..JointTarget::default()
        })
        .collect();
    stand.begin(Handover { position_rad: None, torque_nm: None, last: Some(&last) });
    let mut joints = last.clone();
    stand.step(DT_S, DOWN, &mut joints);
    let jump =
        joints.iter().zip(&last).map(|(a, b)| (a.position_rad - b.position_rad).abs()).fold(0.0, f32::max);
    assert!(jump < 0.1, "it begins at the last targets");
    for _ in 0..100 {
        stand.step(DT_S, DOWN, &mut joints);
    }
    assert!(stand.is_settled());
}
