//! A deployment may set viability thresholds in place of its skills' own, without touching them.

use vocaloco_core::registry::load_deployment;
use vocaloco_tests::Fixture;

#[test]
fn a_deployments_threshold_stands_in_for_its_skills_own() {
    let fixture = Fixture::new();
    for skill in ["first", "last"] {
        fixture.add_skill(skill, "none", 0.97, 0.3);
    }
    fixture.add_deployment("two", &["first", "last"]);
    let thresholds = |fixture: &Fixture| -> Vec<f32> {
        let loaded = load_deployment(&fixture.installation(), "two").expect("sound");
        loaded.skills.iter().map(|skill| skill.manifest.selection.viability_threshold).collect()
    };
    assert_eq!(thresholds(&fixture), [0.9, 0.9]);
    fixture.alter("manifests/deployments/two.toml", "robot", "viability_thresholds = { last = 0.98 }\nrobot");
    assert_eq!(thresholds(&fixture), [0.9, 0.98]);
}
