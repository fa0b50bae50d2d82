//! A recorded course, packed for the page: millimetres, ten-thousandths and indices, so that half a
//! minute of 50 Hz stays below a megabyte. `course.js` unpacks what this packs.

use std::collections::BTreeMap;

use serde::Serialize;
use vocaloco_core::{
    decision::Decision,
    heightfield::Field,
    robot::{RobotModel, Role, ShapeKind},
};
use vocaloco_sim::{
    course::{CourseRun, Switch},
    driver::TICK_S,
    kinematics::{forward_kinematics, legs},
    plant::BasePose,
    terrain::{Solid, Terrain},
};

use super::base64::base64;

/// The heightfield is kept every so many ticks.
const FIELD_EVERY: usize = 2;
/// In place of a prediction that was not made.
const NONE: u16 = u16::MAX;

/// What the page says about a course in words.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Story {
    pub(crate) id: String,
    pub(crate) title: String,
    pub(crate) summary: String,
    pub(crate) expected: String,
    pub(crate) as_expected: bool,
}

#[derive(Serialize)]
struct Threshold {
    name: String,
    threshold: f32,
}

/// A course as `course.js` reads it. All series are by tick; text is base64 of little-endian values.
#[derive(Serialize)]
pub(crate) struct PackedCourse {
    #[serde(flatten)]
    story: Story,
    steps: usize,
    size_m: f32,
    outcome: String,
    duration_s: f64,
    distance_m: f64,
    cot: Option<f64>,
    path: String,
    switches: Vec<Switch>,
    skills: Vec<Threshold>,
    tick_s: f64,
    ticks: usize,
    first_tick: u64,
    legs: usize,
    leg_points: usize,
    /// Centre and half extents in the base frame, m.
    base_boxes: Vec<[[f64; 3]; 2]>,
    /// Boxes: centre and half extents, m.
    terrain: Vec<[f32; 6]>,
    /// What `choice` and `active` index.
    names: Vec<String>,
    /// What `reason` and `verdict` index.
    texts: Vec<String>,
    /// i16: base position mm, orientation xyzw × 32767, then each leg's points, mm.
    motion: String,
    /// u16 by skill: viability × 10⁴, cost of transport × 10³.
    predictions: String,
    /// u8: a bit a skill.
    viable: String,
    /// u8: a bit a foot.
    contact: String,
    choice: String,
    active: String,
    reason: String,
    /// u16 by skill.
    verdict: String,
    /// i8: 31 × 11 heights, cm, every `field_every` ticks.
    field: String,
    field_every: usize,
}

impl PackedCourse {
    /// Packs a recorded run; `thresholds` gives each skill's, in the decisions' order.
    pub(crate) fn new(
        story: Story,
        run: &CourseRun,
        robot: &RobotModel,
        terrain: &Terrain,
        thresholds: &[(String, f32)],
    ) -> Self {
        let mut series = Series::new(thresholds);
        for (index, tick) in run.ticks.iter().enumerate() {
            let links = forward_kinematics(&robot.description, &tick.base, &tick.joint_position_rad);
            series.motion.extend(tick.base.position_m.map(millimetres));
            series.motion.extend(tick.base.orientation_xyzw.map(|part| (part * 32767.0).round() as i16));
            for point in legs(&robot.description, &links).concat() {
                series.motion.extend(point.map(millimetres));
            }
            series.contact.push(bits(tick.foot_contact.iter().copied()));
            if let Some(decision) = &tick.decision {
                series.add(decision, index % FIELD_EVERY == 0);
            }
        }
        let stand = vec![0.0; robot.joint_count()];
        let origin = BasePose::from_yaw([0.0; 3], 0.0);
        let lines = legs(&robot.description, &forward_kinematics(&robot.description, &origin, &stand));
        Self {
            steps: run.steps,
            size_m: run.size_m,
            outcome: run.outcome.id().to_owned(),
            duration_s: run.duration_s,
            distance_m: run.distance_m,
            cot: run.cot,
            path: path(run),
            switches: run.switches.clone(),
            skills: thresholds
                .iter()
                .map(|(name, threshold)| Threshold { name: name.clone(), threshold: *threshold })
                .collect(),
            tick_s: TICK_S,
            ticks: run.ticks.len(),
            first_tick: run.ticks.first().and_then(|tick| tick.decision.as_ref()).map_or(0, |d| d.tick),
            legs: lines.len(),
            leg_points: lines.first().map_or(0, Vec::len),
            base_boxes: base_boxes(robot),
            terrain: strips(terrain),
            names: series.names,
            texts: series.texts.list,
            motion: base64(&little_endian(&series.motion)),
            predictions: base64(&series.predictions.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()),
            viable: base64(&series.viable),
            contact: base64(&series.contact),
            choice: base64(&series.choice),
            active: base64(&series.active),
            reason: base64(&series.reason.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()),
            verdict: base64(&series.verdict.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()),
            field: base64(&series.field),
            field_every: FIELD_EVERY,
            story,
        }
    }
}

/// The active skills in the order of use: `walk → ascend → walk`.
pub(crate) fn path(run: &CourseRun) -> String {
    let skills = run.skills();
    if skills.is_empty() { "–".to_owned() } else { skills.join(" → ") }
}

/// Texts kept once each.
#[derive(Default)]
struct Texts {
    list: Vec<String>,
    index: BTreeMap<String, u16>,
}

impl Texts {
    fn of(&mut self, text: &str) -> u16 {
        if let Some(index) = self.index.get(text) {
            return *index;
        }
        let index = self.list.len().min(usize::from(u16::MAX)) as u16;
        self.list.push(text.to_owned());
        self.index.insert(text.to_owned(), index);
        index
    }
}

struct Series {
    names: Vec<String>,
    texts: Texts,
    motion: Vec<i16>,
    predictions: Vec<u16>,
    viable: Vec<u8>,
    contact: Vec<u8>,
    choice: Vec<u8>,
    active: Vec<u8>,
    reason: Vec<u16>,
    verdict: Vec<u16>,
    field: Vec<u8>,
}

impl Series {
    fn new(thresholds: &[(String, f32)]) -> Self {
        let fixed = ["stop", "stand"].into_iter().map(str::to_owned);
        Self {
            names: fixed.chain(thresholds.iter().map(|(name, _)| name.clone())).collect(),
            texts: Texts::default(),
            motion: Vec::new(),
            predictions: Vec::new(),
            viable: Vec::new(),
            contact: Vec::new(),
            choice: Vec::new(),
            active: Vec::new(),
            reason: Vec::new(),
            verdict: Vec::new(),
            field: Vec::new(),
        }
    }

    fn add(&mut self, decision: &Decision, with_field: bool) {
        let index = |name: &str| self.names.iter().position(|known| known == name).unwrap_or(0) as u8;
        self.choice.push(index(&decision.choice));
        self.active.push(index(&decision.active));
        self.reason.push(self.texts.of(&decision.reason));
        let scaled = |value: Option<f32>, factor: f32| {
            // Phrased as "is inside": NaN is no prediction either.
            value
                .filter(|v| (0.0..=1e6).contains(v))
                .map_or(NONE, |v| (v * factor).round().min(65534.0) as u16)
        };
        let mut viable = 0;
        for (place, name) in self.names[2..].iter().enumerate() {
            // A skill taken out of service may be missing from a record.
            let verdict = decision.skills.iter().find(|verdict| verdict.name == *name);
            self.predictions.push(scaled(verdict.and_then(|v| v.viability), 1e4));
            self.predictions.push(scaled(verdict.and_then(|v| v.cot), 1e3));
            let words = match verdict {
                None => "not in the record".to_owned(),
                Some(v) if v.viable && v.name == decision.choice => format!("{}; the cheapest", v.reason),
                Some(v) if v.viable => format!("{}; {} is cheaper", v.reason, decision.choice),
                Some(v) => v.reason.to_string(),
            };
            self.verdict.push(self.texts.of(&words));
            viable |= u8::from(verdict.is_some_and(|v| v.viable)) << place.min(7);
        }
        self.viable.push(viable);
        if with_field {
            let cells = decision.field.as_ref().map(Field::as_slice);
            for cell in 0..341 {
                let height_m = cells.map_or(0.0, |cells| cells[cell]);
                let centimetres = (height_m * 100.0).round().clamp(-127.0, 127.0) as i8;
                self.field.push(centimetres.to_le_bytes()[0]);
            }
        }
    }
}

fn millimetres(metres: f32) -> i16 {
    (metres * 1000.0).round().clamp(-32767.0, 32767.0) as i16
}

fn bits(flags: impl Iterator<Item = bool>) -> u8 {
    flags.take(8).enumerate().fold(0, |bits, (place, flag)| bits | u8::from(flag) << place)
}

fn little_endian(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The box around all of the base's shapes.
fn base_boxes(robot: &RobotModel) -> Vec<[[f64; 3]; 2]> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let shapes = robot.links.iter().flat_map(|link| &link.shapes).filter(|shape| shape.role == Role::Base);
    for shape in shapes {
        let turned = BasePose {
            position_m: [0.0; 3],
            orientation_xyzw: shape.orientation_in_link_xyzw.map(|part| part as f32),
        };
        let along = |axis: [f32; 3]| turned.vector_in_world(axis).map(|part| f64::from(part.abs()));
        let (x, y, z) = (along([1.0, 0.0, 0.0]), along([0.0, 1.0, 0.0]), along([0.0, 0.0, 1.0]));
        for axis in 0..3 {
            let half = match shape.kind {
                ShapeKind::Sphere { radius_m } => radius_m,
                ShapeKind::Capsule { radius_m, half_length_m } => z[axis] * half_length_m + radius_m,
                ShapeKind::Cylinder { radius_m, half_length_m } => {
                    z[axis] * half_length_m + (x[axis] + y[axis]) * radius_m
                }
                ShapeKind::Box { half_extents_m: [a, b, c] } => x[axis] * a + y[axis] * b + z[axis] * c,
            };
            low[axis] = low[axis].min(shape.centre_in_link_m[axis] - half);
            high[axis] = high[axis].max(shape.centre_in_link_m[axis] + half);
        }
    }
    if low[0] > high[0] {
        return Vec::new();
    }
    let at = |f: fn(f64, f64) -> f64| [0, 1, 2].map(|axis| f(low[axis], high[axis]));
    vec![[at(|low, high| 0.5 * (low + high)), at(|low, high| 0.5 * (high - low))]]
}

/// The ground as boxes side by side along x, each of one height: courses do not vary across, and
/// boxes that overlap could not be painted back to front.
fn strips(terrain: &Terrain) -> Vec<[f32; 6]> {
    let [[low_x, low_y], [high_x, high_y]] = [terrain.min_m, terrain.max_m];
    let mut edges_m = vec![low_x, high_x];
    for solid in &terrain.solids {
        if let Solid::Box { centre_m, half_extents_m } = solid {
            edges_m.extend([centre_m[0] - half_extents_m[0], centre_m[0] + half_extents_m[0]]);
        }
    }
    edges_m.retain(|x| (low_x..=high_x).contains(x));
    edges_m.sort_by(f32::total_cmp);
    edges_m.dedup_by(|a, b| (*a - *b).abs() < 1e-4);
    let middle_y = 0.5 * (low_y + high_y);
    let height_m = |pair: &[f32]| terrain.height_m(0.5 * (pair[0] + pair[1]), middle_y);
    let floor_m = edges_m.windows(2).map(height_m).fold(f32::INFINITY, f32::min) - 0.5;
    edges_m
        .windows(2)
        .map(|pair| {
            let half_z = 0.5 * (height_m(pair) - floor_m);
            let centre = [0.5 * (pair[0] + pair[1]), middle_y, floor_m + half_z];
            let half = [0.5 * (pair[1] - pair[0]), 0.5 * (high_y - low_y), half_z];
            [centre[0], centre[1], centre[2], half[0], half[1], half[2]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use vocaloco_sim::terrain::CourseKind;

    use super::*;

    #[test]
    fn strips_have_the_ground_of_the_course_and_do_not_overlap() {
        for kind in CourseKind::ALL {
            let terrain = Terrain::course(kind, 0.12, 3);
            let strips = strips(&terrain);
            assert_eq!(strips.len(), 4, "{kind:?}: three steps part four levels");
            for pair in strips.windows(2) {
                let gap_m = (pair[1][0] - pair[1][3]) - (pair[0][0] + pair[0][3]);
                assert!(gap_m.abs() < 1e-4, "{kind:?}: {gap_m} m apart");
            }
            for [x, y, z, _, _, half_z] in strips {
                assert!((terrain.height_m(x, y) - (z + half_z)).abs() < 1e-5, "{kind:?} at x {x} m");
            }
        }
    }

    #[test]
    fn texts_are_kept_once() {
        let mut texts = Texts::default();
        let indices = ["a", "b", "a"].map(|text| texts.of(text));
        assert_eq!((indices, texts.list), ([0, 1, 0], vec!["a".to_owned(), "b".to_owned()]));
    }
}
