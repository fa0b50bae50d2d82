//! The page on which one rollout can be watched: the moving picture of the report and nothing else.

use serde::Serialize;
use vocaloco_core::robot::RobotModel;
use vocaloco_sim::watched::Watched;

use super::motion::PackedMotion;

const GROUND_EVERY_M: f32 = 0.02;
/// How far the ground reaches behind the first and ahead of the last base, m.
const GROUND_REACH_M: [f32; 2] = [1.5, 2.5];
const HALF_WIDTH_M: f32 = 1.0;

#[derive(Serialize)]
struct Look<'a> {
    title: &'a str,
    command: &'a str,
    version: &'a str,
    /// The skill, which has the robot's colour.
    palette: [&'a str; 1],
    motion: PackedMotion,
}

/// The whole page; the ground is as under the path, all the way across.
///
/// # Errors
/// When the data do not serialise.
pub(crate) fn page(
    robot: &RobotModel,
    watched: &Watched,
    [skill, title, command]: [&str; 3],
) -> serde_json::Result<String> {
    let ticks = watched.ticks.iter();
    let motion = PackedMotion::new(
        robot,
        ground(watched),
        ticks.map(|tick| (&tick.base, tick.joint_position_rad.as_slice(), tick.foot_contact.as_slice())),
    );
    let look = Look { title, command, version: env!("CARGO_PKG_VERSION"), palette: [skill], motion };
    // `<` would let a text end the script element that holds the data.
    let data = serde_json::to_string(&look)?.replace('<', "\\u003c");
    let script = [include_str!("course.js"), include_str!("scene.js"), include_str!("look.js")].concat();
    let mut page = include_str!("look.html").to_owned();
    for (slot, content) in [
        ("/*{{STYLE}}*/", include_str!("report.css")),
        ("/*{{SCRIPT}}*/", script.as_str()),
        ("/*{{DATA}}*/", data.as_str()),
    ] {
        page = page.replacen(slot, content, 1);
    }
    Ok(page)
}

/// Boxes side by side along the path, each as high as the ground under it.
fn ground(watched: &Watched) -> Vec<[f32; 6]> {
    let furthest_m = watched.ticks.iter().map(|tick| tick.base.position_m[0]).fold(0.0, f32::max);
    let count = ((GROUND_REACH_M[0] + furthest_m + GROUND_REACH_M[1]) / GROUND_EVERY_M) as usize;
    let x_m = |n: usize| n as f32 * GROUND_EVERY_M - GROUND_REACH_M[0];
    let mut runs: Vec<[f32; 3]> = Vec::new();
    for n in 0..count {
        let top_m = watched.ground_m(x_m(n) + 0.5 * GROUND_EVERY_M, 0.0);
        match runs.last_mut() {
            _ if !top_m.is_finite() => {}
            Some(run) if (run[2] - top_m).abs() < 1e-4 => run[1] = x_m(n + 1),
            _ => runs.push([x_m(n), x_m(n + 1), top_m]),
        }
    }
    let floor_m = runs.iter().map(|run| run[2]).fold(f32::INFINITY, f32::min) - 0.5;
    let solid = |[from_m, to_m, top_m]: [f32; 3]| {
        let half_z = 0.5 * (top_m - floor_m);
        [0.5 * (from_m + to_m), 0.0, floor_m + half_z, 0.5 * (to_m - from_m), HALF_WIDTH_M, half_z]
    };
    runs.into_iter().map(solid).collect()
}
