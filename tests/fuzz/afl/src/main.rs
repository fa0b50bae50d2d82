//! One target under AFL++: `fuzz TARGET`, the inputs by way of AFL's shared memory or of stdin.

#[path = "../../targets.rs"]
mod targets;

fn main() {
    let name = std::env::args().nth(1).unwrap_or_default();
    let Some((_, target)) = targets::TARGETS.iter().find(|(known, _)| *known == name) else {
        let known: Vec<&str> = targets::TARGETS.iter().map(|(name, _)| *name).collect();
        eprintln!("target: found {name:?}, wanted one of {}", known.join(", "));
        std::process::exit(2);
    };
    // A panic aborts: to AFL a crash.
    afl::fuzz(true, |bytes| target(bytes));
}
