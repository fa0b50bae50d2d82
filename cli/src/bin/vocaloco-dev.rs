//! `cargo demo` and `cargo vocaloco` for developers: builds the plugins and `vocaloco` itself (and
//! `vocaloco-train` for the verbs it serves), then runs `vocaloco` with the same arguments and ends as
//! it ends.

use std::process::{Command, ExitCode};

fn main() -> ExitCode {
    match run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let words: Vec<_> = std::env::args_os().skip(1).take(2).collect();
    let learns = words.first().is_some_and(|verb| verb == "train" || verb == "train-policy")
        || words == ["bench", "policy"]
        || words == ["bench", "train"]
        || words == ["evaluate", "novelty"];
    let programs: &[&str] = if learns { &["vocaloco", "vocaloco-train"] } else { &["vocaloco"] };
    // A soak lets a plugin misbehave that is made for tests.
    let places: &[&str] =
        if words == ["bench", "soak"] { &["plugins", "tests/plugins"] } else { &["plugins"] };
    let folder = vocaloco_dev::build_plugins(places, programs)?;
    let program = folder.join(format!("vocaloco{}", std::env::consts::EXE_SUFFIX));
    let status = Command::new(program).args(std::env::args_os().skip(1)).status()?;
    // Without a code it was killed by a signal: it did not get to run to its end.
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(2)))
}
