use std::fs;
use std::path::PathBuf;

use super::*;

fn robots() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots")
}

/// The shipped robot with `from` replaced by `to` in one of its files.
fn altered(file: &str, from: &str, to: &str) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["anymal_d.xml", "anymal_d.toml"] {
        let text = fs::read_to_string(robots().join(name)).expect("the shipped file");
        assert!(name != file || text.contains(from), "{from} is in {file}");
        let text = if name == file { text.replacen(from, to, 1) } else { text };
        fs::write(folder.path().join(name), text).expect("a written file");
    }
    RobotModel::load(folder.path(), "anymal_d").expect_err("a refusal").to_string()
}

#[test]
fn a_robot_that_takes_in_another_file_is_refused() {
    let itself = "<asset><model name=\"a\" file=\"anymal_d.xml\"/></asset><worldbody>";
    for (what, text) in [("include", "<include file=\"legs.xml\"/><worldbody>"), ("model", itself)] {
        let line = altered("anymal_d.xml", "<worldbody>", text);
        assert!(line.contains(&format!("anymal_d.xml: file: found {what} of another file")), "{line}");
    }
}

#[test]
fn what_the_parser_trips_over_is_refused() {
    let text = "<compiler angle=\"radian\" eulerseq=\"xyzx\"/><worldbody>";
    let line = altered("anymal_d.xml", "<worldbody>", text);
    assert!(line.contains("anymal_d.xml: file: found eulerseq"), "{line}");
}

#[test]
fn numbers_that_are_none_are_refused_by_field() {
    for (from, to, field) in [("pos=\"", "pos=\"nan ", ".pos"), ("mass=\"", "mass=\"1e300", "inertial.mass")]
    {
        let text = fs::read_to_string(robots().join("anymal_d.xml")).expect("the shipped file");
        // The first of a body that is not the base's, whose centre of mass is its origin.
        let body = text.find("LF_HIP").expect("a leg");
        let at = body + text[body..].find(from).expect("a number") + from.len();
        let (number, _) = text[at..].split_once([' ', '"']).expect("its end");
        let spoiled = to.strip_prefix(from).expect("as it begins");
        let whole = format!("{}{}", &text[body..at], number);
        let line = altered("anymal_d.xml", &whole, &format!("{}{spoiled}", &text[body..at]));
        assert!(line.contains(field) && line.contains("less than a million"), "{line}");
    }
}

#[test]
fn names_that_would_be_looked_for_for_minutes_are_refused() {
    let line = altered("anymal_d.toml", "feet = [", &format!("feet = [{}", "\"a\",".repeat(100)));
    assert!(line.contains("anymal_d.toml: feet: found 104 names, wanted at most 100"), "{line}");
    let line = altered("anymal_d.toml", "feet = [", "feet = [\"LF_FOOT\", ");
    assert!(line.contains("feet: found \"LF_FOOT\" twice, wanted each once"), "{line}");
}

#[test]
fn a_field_from_a_hostile_file_is_one_short_line() {
    let name = format!("a&#10;\u{7f}{}", "b".repeat(9000));
    let line = altered("anymal_d.xml", "\"LF_HIP\" pos=\"0.304", &format!("\"{name}\" pos=\"nan"));
    assert!(line.len() < 400 && !line.contains(char::is_control), "{} bytes", line.len());
}

#[test]
fn a_robot_larger_than_any_is_refused() {
    let line = altered("anymal_d.toml", "", &format!("# {}\n", "-".repeat(1 << 20)));
    assert!(line.contains("anymal_d.toml: file: found more than 1048576 bytes"), "{line}");
    let line = altered("anymal_d.xml", "<worldbody>", &format!("{}<worldbody>", " ".repeat(1 << 20)));
    assert!(line.contains("anymal_d.xml: file: found more than 1048576 bytes"), "{line}");
}

#[test]
fn the_shipped_robot_has_the_published_figures() {
    let robot = RobotModel::load(&robots(), "anymal_d").expect("the shipped robot");
    assert!((robot.description.mass_kg - 51.5).abs() < 1e-9, "{} kg", robot.description.mass_kg);
    let names: Vec<&str> = robot.description.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "LF_HAA", "LF_HFE", "LF_KFE", "RF_HAA", "RF_HFE", "RF_KFE", "LH_HAA", "LH_HFE", "LH_KFE",
            "RH_HAA", "RH_HFE", "RH_KFE"
        ]
    );
    let feet: Vec<(&str, u32)> =
        robot.description.feet.iter().map(|foot| (foot.name.as_str(), foot.joint)).collect();
    assert_eq!(feet, [("LF_FOOT", 2), ("RF_FOOT", 5), ("LH_FOOT", 8), ("RH_FOOT", 11)]);
    assert!((0.59..0.63).contains(&robot.description.stand_height_m));
    let haa = &robot.description.joints[0];
    assert_eq!((haa.parent, haa.origin_in_parent_m), (-1, [0.304, 0.109, 0.0]));
    assert_eq!((haa.lower_rad, haa.upper_rad), (-0.785, 0.611));
    let right = &robot.description.joints[3];
    assert_eq!((right.lower_rad, right.upper_rad), (-0.611, 0.785));
    assert_eq!(robot.description.joints[8].parent, 7);
    assert_eq!(robot.links.len(), 13);
    assert!(robot.links[1..].iter().all(|link| (link.armature_kg_m2 - 0.05).abs() < 1e-12));
    let base_shapes = robot.links[0].shapes.iter().filter(|shape| shape.role == Role::Base).count();
    assert_eq!(base_shapes, robot.links[0].shapes.len());
}

#[test]
fn left_and_right_are_mirror_images() {
    let robot = RobotModel::load(&robots(), "anymal_d").expect("the shipped robot");
    for (left, right) in [(1, 4), (2, 5), (3, 6), (7, 10), (8, 11), (9, 12)] {
        let (left, right) = (&robot.links[left], &robot.links[right]);
        let mirrored = |[x, y, z]: [f64; 3], other: [f64; 3]| {
            let gap = (x - other[0]).abs() + (y + other[1]).abs() + (z - other[2]).abs();
            assert!(gap < 1e-12, "{} and {}: {x} {y} {z} and {other:?}", left.name, right.name);
        };
        mirrored(left.com_in_link_m, right.com_in_link_m);
        for (left, right) in left.shapes.iter().zip(&right.shapes) {
            mirrored(left.centre_in_link_m, right.centre_in_link_m);
        }
    }
}

#[test]
fn each_fault_in_a_robot_file_is_named() {
    for (file, from, to, wanted) in [
        ("anymal_d.toml", "schema = 1", "schema = 2", "schema: found 2, wanted 1"),
        ("anymal_d.toml", "schema = 1", "schema = 1\ncolour = 3", "unknown field `colour`"),
        ("anymal_d.toml", "base = \"base\"", "base = \"trunk\"", "base: found \"trunk\", wanted \"base\""),
        ("anymal_d.toml", "\"base_box\"", "\"belly\"", "base_shapes: found \"belly\""),
        ("anymal_d.toml", "\"RH_FOOT\"", "\"RH_shank\"", "feet: found \"RH_shank\", wanted a sphere"),
        ("anymal_d.toml", "effort_nm = 80.0", "effort_nm = nan", "drive.effort_nm: found NaN"),
        (
            "anymal_d.toml",
            "LF_KFE = -0.8",
            "LF_KFE = 0.8",
            "stand.position_rad.LF_KFE: found 0.8, wanted -2.6 to -0.1",
        ),
        ("anymal_d.toml", "LF_KFE = -0.8", "", "stand.position_rad.LF_KFE: found none"),
        (
            "anymal_d.toml",
            "LF_KFE = -0.8",
            "LF_KFE = -0.8\nLF_ABC = 0.0",
            "stand.position_rad: found \"LF_ABC\"",
        ),
        ("anymal_d.xml", "<freejoint name=\"root\"/>", "", "base.joint: found 0 joints"),
        ("anymal_d.xml", "range=\"-0.785 0.611\"", "", "LF_HAA.range: found None"),
        (
            "anymal_d.xml",
            "damping=\"0\"",
            "damping=\"0.2\"",
            "LF_HAA.damping, stiffness or frictionloss: found 0.2",
        ),
        (
            "anymal_d.xml",
            "pos=\"0 0 0\" mass",
            "pos=\"0 0 0.1\" mass",
            "base.inertial.pos: found [0.0, 0.0, 0.1]",
        ),
        ("anymal_d.xml", "mass=\"2.379\"", "mass=\"-1\"", "LF_HIP.inertial.mass: found -1"),
        ("anymal_d.xml", "type=\"box\"", "type=\"ellipsoid\"", "base_box.type: found Ellipsoid"),
        ("anymal_d.xml", "</mujoco>", "", "anymal_d.xml: XML parse error"),
    ] {
        let message = altered(file, from, to);
        assert!(message.contains(wanted), "{from} → {to}: {message}");
        assert!(message.contains(file), "{message} names {file}");
        assert!(!message.contains('\n'), "{message:?} is one line");
    }
}

#[test]
fn a_missing_robot_is_named() {
    let message = RobotModel::load(&robots(), "anymal_z").expect_err("a refusal").to_string();
    assert!(message.contains("anymal_z.toml: file: found No such file"), "{message}");
}
