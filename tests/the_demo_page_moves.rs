//! The demo's page in headless Chromium: no errors on the console, the robot moves, and nothing is
//! wider than the window, on a phone and on a desk, light and dark. A peer test.

use std::process::Command;

use serde_json::Value;

#[test]
fn the_page_loads_without_errors_and_the_robot_moves() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let plugins = vocaloco_tests::plugin_folder();
    let demo = Command::new(plugins.join("vocaloco"))
        .args(["demo", "--json", "--out"])
        .arg(out.path())
        .env("VOCALOCO_ROOT", vocaloco_tests::repository())
        .env("VOCALOCO_PLUGIN_PATH", plugins)
        .output()
        .expect("the demo starts");
    // 1 is a finding about the robot, which is another test's matter.
    assert!(
        matches!(demo.status.code(), Some(0 | 1)),
        "the demo could not run: {}",
        String::from_utf8_lossy(&demo.stderr)
    );
    let summary: Value = serde_json::from_slice(&demo.stdout).expect("a JSON object");

    let output = Command::new("python3")
        .arg(vocaloco_tests::repository().join("tests/peers/page_in_chromium.py"))
        .arg(format!("file://{}", out.path().join("report.html").display()))
        .output()
        .expect("Python is there");
    let narration = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{narration}");
    let looks: Vec<Value> = serde_json::from_slice(&output.stdout).expect("a list of looks");
    assert_eq!(looks.len(), 4, "two widths, light and dark");
    for look in &looks {
        let at = format!("{} px, {}", look["width"], look["scheme"]);
        assert_eq!(look["errors"], Value::Array(Vec::new()), "{at}");
        assert_eq!(look["moved"], true, "{at}: the picture stands still");
        let ticks = look["ticks"].as_array().expect("two ticks");
        assert!(ticks[1].as_i64() > ticks[0].as_i64().map(|tick| tick + 10), "{at}: {ticks:?}");
        assert!(look["overflow_px"].as_i64() <= Some(0), "{at}: wider than the window");
        let courses = summary["courses"].as_array().map(Vec::len);
        assert_eq!(look["sections"].as_u64().map(|n| n as usize), courses, "{at}: sections");
    }
}
