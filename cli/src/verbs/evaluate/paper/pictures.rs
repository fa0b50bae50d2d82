//! The figures as files: SVG, and PNG where `vocaloco-draw` stands beside this program.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};

use crate::report::{Figure, Inks};

/// Width of a figure, px.
const WIDTH_PX: f64 = 1060.0;

/// Writes each figure into `folder`; says so where there will be no PNG.
pub(super) fn write(folder: &Path, figures: &[Figure]) -> anyhow::Result<()> {
    let mut files: Vec<PathBuf> = Vec::new();
    for figure in figures {
        let path = folder.join(format!("{}.svg", figure.id));
        super::write(&path, &figure.svg(WIDTH_PX, Inks::Print))?;
        files.push(path);
    }
    let here = std::env::current_exe().context("the folder of this program")?;
    let program = here.with_file_name(format!("vocaloco-draw{}", std::env::consts::EXE_SUFFIX));
    if !program.is_file() {
        eprintln!(
            "no PNG: found no {}; `cargo build --manifest-path draw/Cargo.toml --target-dir target` makes it",
            program.display()
        );
        return Ok(());
    }
    let status = Command::new(&program)
        .args(&files)
        .status()
        .with_context(|| format!("{} does not start", program.display()))?;
    ensure!(status.success(), "{} failed: {status}", program.display());
    Ok(())
}
