//! A deployment may set viability thresholds in place of its skills' own, without touching them.

use vocaloco_core::registry::load_deployment;
use vocaloco_core::runtime::Skill;
use vocaloco_tests::Fixture;

/// A deployment of two skills, `two`.
fn two() -> Fixture {
    let fixture = Fixture::new();
    for skill in ["first", "last"] {
        fixture.add_skill(skill, "none", 0.97, 0.3);
    }
    fixture.add_deployment("two", &["first", "last"]);
    fixture
}

#[test]
fn a_deployments_threshold_stands_in_for_its_skills_own() {
    let fixture = two();
    let thresholds = |fixture: &Fixture| -> Vec<f32> {
        let loaded = load_deployment(&fixture.installation(), "two").expect("sound");
        loaded.skills.iter().map(|skill| skill.manifest.selection.viability_threshold).collect()
    };
    assert_eq!(thresholds(&fixture), [0.9, 0.9]);
    fixture.alter("manifests/deployments/two.toml", "robot", "viability_thresholds = { last = 0.98 }\nrobot");
    assert_eq!(thresholds(&fixture), [0.9, 0.98]);
}

#[test]
fn a_skill_that_drives_is_not_held_to_more_than_it_begins_with() {
    let fixture = two();
    fixture.alter(
        "manifests/deployments/two.toml",
        "robot",
        "hold_thresholds = { last = 0.7, first = 0.95 }\nrobot",
    );
    let loaded = load_deployment(&fixture.installation(), "two").expect("one skill is sound");
    let rules: Vec<_> = loaded.skills.iter().map(Skill::rule_of).collect();
    let held: Vec<_> = rules.iter().map(|rule| (rule.name.as_str(), rule.hold_threshold)).collect();
    assert_eq!(held, [("last", 0.7)]);
    let [refusal] = loaded.refused.as_slice() else { panic!("{:?}", loaded.refused) };
    let refusal = refusal.to_string();
    for part in ["first", "hold_thresholds.first", "0.95", "at most 0.9, its viability threshold"] {
        assert!(refusal.contains(part), "{part:?} is not in {refusal}");
    }
}

#[test]
fn deployments_that_cannot_be_compared_are_refused_before_anything_is_measured() {
    let out = tempfile::tempdir().expect("a temporary folder");
    for (flag, name) in [("--promised", "anymal_obstacles"), ("--added", "anymal_stairs_promised")] {
        let output = std::process::Command::new(vocaloco_tests::plugin_folder().join("vocaloco"))
            .args(["evaluate", "all", "--quick", flag, name, "--out"])
            .arg(out.path())
            .env("VOCALOCO_ROOT", vocaloco_tests::repository())
            .env("VOCALOCO_PLUGIN_PATH", vocaloco_tests::plugin_folder())
            .output()
            .expect("the evaluation starts");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{flag}: {error}");
        let named = error.contains(&format!("deployment `{name}`: skills: found walk, ascend_network"));
        assert!(named && error.contains("wanted"), "{flag}: {error}");
    }
    let measured = std::fs::read_dir(out.path().join("measured")).map_or(0, Iterator::count);
    assert_eq!(measured, 0, "results");
}
