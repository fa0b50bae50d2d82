//! A computed threshold into a skill's manifest; every other byte of the file stays.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, bail};
use vocaloco_core::manifest::SkillManifest;

use crate::files::write_whole;
use vocaloco_sim::promise::Promise;

/// Writes the threshold of `promise` into `[selection] viability_threshold` of the manifest `file`.
///
/// # Errors
/// There is no such threshold, or `file` is no sound manifest with that field on a line of its own.
pub(super) fn write_threshold(file: &Path, promise: &Promise) -> anyhow::Result<()> {
    let Some(threshold) = promise.threshold else {
        bail!(
            "{}: found {} unsafe rows, too few to promise {}; wanted more rows, or a larger share",
            file.display(),
            promise.unsafe_rows,
            promise.risk.alpha
        );
    };
    let old = std::fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let Some(new) = with_threshold(&old, threshold) else {
        bail!("{}: selection.viability_threshold: found no line of it, wanted one to change", file.display());
    };
    let manifest = SkillManifest::parse(file, new.clone())?;
    if manifest.selection.viability_threshold != threshold {
        let found = manifest.selection.viability_threshold;
        bail!("{}: selection.viability_threshold: found {found}, wanted {threshold}", file.display());
    }
    write_whole(file, new.as_bytes())
}

/// The text with the value on the line `viability_threshold = …` of `[selection]` replaced.
fn with_threshold(text: &str, threshold: f32) -> Option<String> {
    let mut in_selection = false;
    let mut changed = false;
    let mut new = String::with_capacity(text.len() + 8);
    for line in text.split_inclusive('\n') {
        let plain = line.trim();
        if plain.starts_with('[') {
            in_selection = plain.split('#').next().is_some_and(|head| head.trim() == "[selection]");
        }
        let value = plain.strip_prefix("viability_threshold").map(str::trim_start);
        match value.and_then(|value| value.strip_prefix('=')) {
            Some(value) if in_selection && !changed => {
                let name = line.split('=').next()?;
                // What follows the number: a comment with the blanks before it, and the line's end.
                let number = value.trim_start().find(|c: char| c.is_whitespace() || c == '#');
                let behind = number.map_or("", |end| &value.trim_start()[end..]);
                let end = if line.ends_with("\r\n") { "\r\n" } else { "\n" };
                // Writing to a `String` does not fail.
                let _ = write!(new, "{name}= {threshold}{behind}{end}");
                changed = true;
            }
            _ => new.push_str(line),
        }
    }
    changed.then_some(new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vocaloco_sim::promise::Risk;

    const MANIFEST: &str = "# by hand\nschema = 1\nname = \"walk\"\nsummary = \"Walks\"\nplugin = \"gait\"\n\n\
        [models]\nviability = \"viability.onnx\"\ncot = \"cot.onnx\"\n\n[selection]  # who may\n\
        viability_threshold = 0.95   # the paper's\ncost_margin = 0.1\n\n[command]\nkind = \"velocity\"\n\
        forward_m_per_s = [0.4, 0.7]\n";

    fn promise(threshold: Option<f32>) -> Promise {
        Promise {
            risk: Risk { required_viability: 0.5, alpha: 0.01 },
            threshold,
            unsafe_rows: 7,
            let_through: 0,
            upper_bound: None,
            safe_refused: None,
        }
    }

    #[test]
    fn the_number_changes_and_no_other_byte() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("walk.toml");
        std::fs::write(&file, MANIFEST).unwrap();
        write_threshold(&file, &promise(Some(0.873))).unwrap();
        let written = std::fs::read_to_string(&file).unwrap();
        assert_eq!(written, MANIFEST.replace("= 0.95 ", "= 0.873 "));
    }

    #[test]
    fn a_manifest_without_that_line_or_a_promise_without_threshold_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("walk.toml");
        let inline =
            MANIFEST.replace("[selection]  # who may\nviability_threshold", "[other]\nviability_threshold");
        for (text, promise) in [(MANIFEST, promise(None)), (inline.as_str(), promise(Some(0.9)))] {
            std::fs::write(&file, text).unwrap();
            let error = write_threshold(&file, &promise).unwrap_err().to_string();
            assert!(error.contains("walk.toml"), "{error}");
            assert_eq!(std::fs::read_to_string(&file).unwrap(), text);
        }
    }
}
