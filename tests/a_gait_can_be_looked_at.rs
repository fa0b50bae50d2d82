//! `vocaloco look` draws what it rolled out: as many frames as asked for, every number in them finite, the
//! same bytes from the same seed, and a page that fetches nothing.

use std::{fs, path::Path, process::Command};

use vocaloco_tests::{plugin_folder, repository};

/// The strip and the page.
fn look(folder: &Path, terrain: &str, size_m: &str) -> [String; 2] {
    let (strip, page) = (folder.join("strip.svg"), folder.join("page.html"));
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args(["look", "--skill", "walk", "--terrain", terrain, "--size-m", size_m])
        .args(["--plant", "fast", "--frames", "6", "--horizon-m", "0.5", "--out"])
        .arg(&strip)
        .arg("--page")
        .arg(&page)
        .env("VOCALOCO_ROOT", repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("it starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    [strip, page].map(|file| fs::read_to_string(&file).expect("it was written"))
}

#[test]
fn a_strip_has_the_frames_asked_for_with_finite_numbers() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (terrain, size_m) in [("stairs_up", "0.1"), ("rough", "0.05")] {
        let [strip, _] = look(folder.path(), terrain, size_m);
        assert_eq!(strip.matches("clip-path=").count(), 6, "{terrain}");
        assert_eq!(strip.matches("<circle").count(), 6 * 4, "{terrain}: four feet a frame");
        assert_eq!(strip.matches("0.5 m</text>").count(), 1, "{terrain}: one scale");
        assert!(strip.contains(">0.00 s</text>"), "{terrain}: the first frame is the start");
        for number in ["NaN", "inf"] {
            assert!(!strip.contains(number), "{terrain}: the strip holds {number}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_pictures() {
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    let [[first_strip, _], [second_strip, _]] =
        [&folders[0], &folders[1]].map(|folder| look(folder.path(), "stairs_down", "0.1"));
    assert_eq!(first_strip, second_strip);
}

#[test]
fn every_slot_of_the_page_is_filled_and_nothing_is_fetched() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [_, page] = look(folder.path(), "stairs_up", "0.1");
    assert!(!page.contains("{{"), "a slot is left");
    for request in ["src=", "href=\"http", "@import", "url(", "fetch(", "XMLHttpRequest", "import("] {
        assert!(!page.contains(request), "the page holds {request}");
    }
}

/// `--out look.pdf` once got an SVG under that name.
#[test]
fn a_picture_of_another_kind_is_refused_by_its_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("look.pdf");
    let output = Command::new(plugin_folder().join("vocaloco"))
        .args(["look", "--skill", "walk", "--terrain", "flat", "--out"])
        .arg(&file)
        .env("VOCALOCO_ROOT", repository())
        .env("VOCALOCO_PLUGIN_PATH", plugin_folder())
        .output()
        .expect("it starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--out") && said.contains("look.pdf") && said.contains(".svg"), "{said}");
    assert!(!file.exists());
}
