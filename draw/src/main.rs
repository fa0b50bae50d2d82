//! `vocaloco-draw`: figures as PNG, for slides and papers that take no SVG.
//!
//! A program of its own, which `vocaloco evaluate all` runs where it stands beside it: what draws is not compiled
//! into what a robot or the demo runs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};
use clap::Parser;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree, fontdb::Database};

/// The one font that there is, whatever the machine has: a figure has the same bytes everywhere.
const FONT: &str = "DejaVu Sans";
/// Pixels of a picture's longer side, at most.
const LARGEST_PX: f32 = 16_384.0;

/// Writes each SVG as a PNG beside it.
#[derive(Parser)]
#[command(name = "vocaloco-draw", version)]
struct Args {
    /// SVG files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Pixels for each of the figure's own
    #[arg(long, default_value_t = 2.0, value_name = "FACTOR")]
    scale: f32,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((0.1..=10.0).contains(&args.scale), "--scale: found {}, wanted 0.1 to 10", args.scale);
    let options = options();
    for file in &args.files {
        let svg = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
        let png = picture(&svg, args.scale, &options).with_context(|| file.display().to_string())?;
        write(&file.with_extension("png"), &png)?;
    }
    Ok(())
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    std::fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}

/// Every family that a figure may ask for is the one font.
fn options() -> Options<'static> {
    let mut fonts = Database::new();
    for font in [dejavu::sans::regular(), dejavu::sans::bold()] {
        fonts.load_font_data(font.to_vec());
    }
    fonts.set_sans_serif_family(FONT);
    fonts.set_serif_family(FONT);
    fonts.set_monospace_family(FONT);
    Options { font_family: FONT.to_owned(), fontdb: std::sync::Arc::new(fonts), ..Options::default() }
}

/// A figure as the bytes of a PNG.
fn picture(svg: &[u8], scale: f32, options: &Options<'_>) -> anyhow::Result<Vec<u8>> {
    let tree = Tree::from_data(svg, options)?;
    let size = tree.size();
    let [width, height] = [size.width() * scale, size.height() * scale].map(f32::ceil);
    ensure!(
        width.max(height) <= LARGEST_PX,
        "found {width} × {height} px, wanted at most {LARGEST_PX} a side"
    );
    let mut pixels =
        Pixmap::new(width as u32, height as u32).context("found no size, wanted 1 px or more")?;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixels.as_mut());
    Ok(pixels.encode_png()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIGURE: &str = r##"<svg xmlns="http://www.w3.org/2000/svg" width="40" height="20" viewBox="0 0 40 20"
        font-family="system-ui, sans-serif" font-size="12"><rect width="40" height="20" fill="#fff"/>TEXT</svg>"##;

    fn dark_pixels(text: &str) -> usize {
        let png = picture(FIGURE.replace("TEXT", text).as_bytes(), 2.0, &options()).unwrap();
        let pixels = Pixmap::decode_png(&png).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (80, 40));
        pixels.pixels().iter().filter(|pixel| pixel.red() < 128).count()
    }

    #[test]
    fn text_is_drawn_without_a_font_of_the_machine() {
        assert_eq!(dark_pixels(""), 0);
        let plain = dark_pixels("<text x='2' y='14'>CoT</text>");
        let bold = dark_pixels("<text x='2' y='14' font-weight='600'>CoT</text>");
        assert!(plain > 100 && bold > plain + 20, "{plain} {bold}");
    }

    #[test]
    fn what_is_no_figure_or_too_large_is_refused() {
        assert!(picture(b"<svg", 1.0, &options()).is_err());
        let large = r#"<svg xmlns="http://www.w3.org/2000/svg" width="20000" height="10"/>"#;
        let error = picture(large.as_bytes(), 1.0, &options()).unwrap_err().to_string();
        assert!(error.contains("20000") && error.contains("16384"), "{error}");
    }
}
