//! The page of `evaluate all` in headless Chromium: no errors on the console, the robot moves, nothing is
//! wider than the window and no words lie over each other, on a phone and on a desk, light and dark; and a
//! second run measures nothing again. A peer test.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// As few rollouts as there can be.
fn evaluate_all(out: &Path) -> Output {
    let plugins = vocaloco_tests::plugin_folder();
    Command::new(plugins.join("vocaloco"))
        .args(["evaluate", "all", "--quick", "--rollouts", "1", "--samples", "2", "--json", "--out"])
        .arg(out)
        .env("VOCALOCO_ROOT", vocaloco_tests::repository())
        .env("VOCALOCO_PLUGIN_PATH", plugins)
        .output()
        .expect("the evaluation starts")
}

fn claims(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout")
}

#[test]
fn the_page_can_be_read_and_a_second_run_measures_nothing_again() {
    let out = tempfile::tempdir().expect("a temporary folder");
    let summary = claims(&evaluate_all(out.path()));
    let page = out.path().join("report.html");
    let first = std::fs::read(&page).expect("a page");

    // Every result is there already: the same bytes, from files alone.
    let measured = || {
        let files = std::fs::read_dir(out.path().join("measured")).expect("results").flatten();
        files.map(|file| file.metadata().and_then(|data| data.modified()).expect("a time")).max()
    };
    let newest = measured();
    assert_eq!(claims(&evaluate_all(out.path())), summary);
    assert_eq!(measured(), newest, "something was measured again");
    assert!(std::fs::read(&page).expect("a page") == first, "the pages differ");

    for file in ["tables/success.csv", "tables/cells.json", "figures/success_up.svg", "report.json"] {
        let length = std::fs::metadata(out.path().join(file)).map_or(0, |file| file.len());
        assert!(length > 300, "{file} holds {length} bytes");
    }
    let output = Command::new("python3")
        .arg(vocaloco_tests::repository().join("tests/peers/page_in_chromium.py"))
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("Python is there");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let looks: Vec<Value> = serde_json::from_slice(&output.stdout).expect("a list of looks");
    assert_eq!(looks.len(), 4, "two widths, light and dark");
    for look in &looks {
        let at = format!("{} px, {}", look["width"], look["scheme"]);
        assert_eq!(look["errors"], Value::Array(Vec::new()), "{at}");
        assert_eq!(look["moved"], true, "{at}: the picture stands still");
        assert!(look["overflow_px"].as_i64() <= Some(0), "{at}: wider than the window");
        assert_eq!(look["overlaps"], Value::Array(Vec::new()), "{at}: words over words");
    }
}
