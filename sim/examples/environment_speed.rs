//! Policy steps per second of the training environment, without a learner.

#![expect(clippy::print_stdout, reason = "this program prints a table")]

use std::{collections::BTreeMap, env, error::Error, path::Path, sync::Arc};

use vocaloco_core::{plugin::PluginLibrary, robot::RobotModel};
use vocaloco_sim::{
    environment::{
        EnvironmentConfig, TerrainShare, TrainingGround,
        speed::{Actor, measure},
    },
    rollout::RolledSkill,
    terrain::TerrainKind,
    threads::with_threads,
};

/// Resident memory of this process, MiB.
fn resident_mib() -> f64 {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    pages.split_whitespace().nth(1).and_then(|field| field.parse::<f64>().ok()).unwrap_or(f64::NAN) / 256.0
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let usage = "environment_speed PLUGIN_FOLDER [ENVIRONMENTS] [ROUNDS]";
    let plugins = arguments.next().ok_or(usage)?;
    let count = arguments.next().map_or(Ok(64), |text| text.parse())?;
    let rounds = arguments.next().map_or(Ok(4), |text| text.parse())?;
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let robot = Arc::new(RobotModel::load(&repository.join("manifests/robots"), "anymal_d")?);
    let library = PluginLibrary::open(&[plugins.into()], "gait")?;
    let parameters = std::fs::read_to_string(repository.join("skills/ascend/gait.toml"))?;
    let ascend = RolledSkill::new("ascend", library, &parameters, &robot)?;
    let share = |kind, share, size_m| TerrainShare::new(kind, share, size_m);
    let terrain = vec![
        share(TerrainKind::StairsUp, 0.75, [0.05, 0.3]),
        share(TerrainKind::Rough, 0.125, [0.0, 0.1]),
        share(TerrainKind::Discrete, 0.125, [0.0, 0.15]),
    ];
    let experts = terrain.iter().map(|one| (one.kind, "ascend".to_owned())).collect();
    let config = EnvironmentConfig { terrain, experts, ..EnvironmentConfig::default() };
    let empty_mib = resident_mib();
    let known = BTreeMap::from([("ascend".to_owned(), ascend)]);
    let ground = with_threads(0, || TrainingGround::new(config, &robot, &known, 1))??;
    let ground = Arc::new(ground);
    println!("terrains and poses: {:.0} MiB", resident_mib() - empty_mib);
    println!("| actor | threads | policy steps/s | physics alone | beyond physics, µs | memory, MiB |");
    println!("|---|---|---|---|---|---|");
    for threads in [1, 2] {
        for actor in [Actor::Zero, Actor::Expert] {
            let speed = with_threads(threads, || measure(&ground, count, rounds, actor))?;
            println!(
                "| {actor:?} | {threads} | {:.0} | {:.0} | {:.1} | {:.0} |",
                speed.steps_per_s,
                speed.physics_steps_per_s,
                speed.overhead_us,
                resident_mib()
            );
        }
    }
    Ok(())
}
