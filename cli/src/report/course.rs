//! A recorded course, packed for the page: millimetres, ten-thousandths and indices, so that half a
//! minute of 50 Hz stays below a megabyte. `course.js` unpacks what this packs.

use std::collections::BTreeMap;

use serde::Serialize;
use vocaloco_core::{decision::Decision, heightfield::Field, robot::RobotModel};
use vocaloco_sim::{
    course::{CourseRun, Outcome, Switch},
    terrain::Terrain,
};

use super::{base64::base64, motion::PackedMotion, shapes::strips};

/// The heightfield is kept every so many ticks.
const FIELD_EVERY: usize = 2;
/// In place of a prediction that was not made.
const NONE: u16 = u16::MAX;

/// What the page says about a course in words.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Story {
    pub(crate) id: String,
    pub(crate) title: String,
    pub(crate) summary: String,
    /// The outcome that was expected, where one was.
    pub(crate) expected: Option<String>,
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
    #[serde(flatten)]
    moved: PackedMotion,
    first_tick: u64,
    /// What `choice` and `active` index.
    names: Vec<String>,
    /// What `reason` and `verdict` index.
    texts: Vec<String>,
    /// u16 by skill: viability × 10⁴, cost of transport × 10³.
    predictions: String,
    /// u8: a bit a skill.
    viable: String,
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
        let alone = alone(run);
        series.names.extend(alone.iter().map(|decision| decision.active.clone()));
        for (index, tick) in run.ticks.iter().enumerate() {
            if let Some(decision) = tick.decision.as_ref().or(alone.as_ref()) {
                series.add(decision, index % FIELD_EVERY == 0);
            }
        }
        let ticks = run.ticks.iter();
        let moved = PackedMotion::new(
            robot,
            strips(terrain),
            ticks.map(|tick| (&tick.base, tick.joint_position_rad.as_slice(), tick.foot_contact.as_slice())),
        );
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
            moved,
            first_tick: run.ticks.first().and_then(|tick| tick.decision.as_ref()).map_or(0, |d| d.tick),
            names: series.names,
            texts: series.texts.list,
            predictions: base64(&series.predictions.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()),
            viable: base64(&series.viable),
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

/// What stands in for the decisions of a run in which one skill drove alone.
fn alone(run: &CourseRun) -> Option<Decision> {
    let decided = run.ticks.iter().any(|tick| tick.decision.is_some());
    let name = run.skills().first().filter(|_| !decided).map(|name| (*name).to_owned())?;
    let reason = "one skill alone: nothing is predicted, and nothing stops it".to_owned();
    Some(Decision { choice: name.clone(), active: name, reason, ..Decision::default() })
}

/// How a run went, in a sentence or two.
pub(crate) fn told(run: &CourseRun) -> String {
    let mut words = match run.outcome {
        Outcome::Reached => format!("Reached the far flat in {:.1} s", run.duration_s),
        Outcome::Crashed => format!("The base touched the ground after {:.1} s", run.duration_s),
        Outcome::Stuck => format!("Stuck: time was up after {:.1} s", run.duration_s),
        Outcome::Stopped => format!("Stopped, and stood for 2 s, after {:.1} s", run.duration_s),
    };
    if let Some(cot) = run.cot {
        words = format!("{words}; cost of transport {cot:.2}");
    }
    let actives: Vec<String> =
        run.switches.iter().map(|switch| format!("{} from {:.2} s", switch.to, switch.t_s)).collect();
    if !actives.is_empty() {
        words = format!("{words}. Active: {}", actives.join(", "));
    }
    format!("{words}.")
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
    /// How many of the names, after `stop` and `stand`, are chosen from.
    skills: usize,
    texts: Texts,
    predictions: Vec<u16>,
    viable: Vec<u8>,
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
            skills: thresholds.len(),
            texts: Texts::default(),
            predictions: Vec::new(),
            viable: Vec::new(),
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
        for (place, name) in self.names[2..].iter().take(self.skills).enumerate() {
            // A skill taken out of service may be missing from a record.
            let verdict = decision.skills.iter().find(|verdict| verdict.name == *name);
            self.predictions.push(scaled(verdict.and_then(|v| v.viability), 1e4));
            self.predictions.push(scaled(verdict.and_then(|v| v.cot), 1e3));
            let words = match verdict {
                None => "not in the record".to_owned(),
                Some(v) if v.viable && v.name == decision.choice => format!("{}; the cheapest", v.reason),
                Some(v) if v.viable => format!("{}; {} is chosen", v.reason, decision.choice),
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

#[cfg(test)]
mod tests {
    use vocaloco_sim::{course::CourseTick, plant::BasePose, terrain::CourseKind};

    use super::*;

    #[test]
    fn every_series_has_a_value_for_every_tick() {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap();
        let tick = |n: u64| CourseTick {
            decision: Some(Decision {
                tick: 40 + n,
                choice: "walk".to_owned(),
                active: "stand".to_owned(),
                reason: format!("{n} of 10"),
                ..Decision::default()
            }),
            base: BasePose::from_yaw([-1.25, 0.5, 0.6], 0.3),
            joint_position_rad: robot.stand_position_rad(),
            foot_contact: vec![true, false, false, true],
        };
        let run = CourseRun {
            kind: CourseKind::StairsUp,
            size_m: 0.12,
            steps: 3,
            outcome: Outcome::Stopped,
            duration_s: 0.1,
            distance_m: 0.0,
            cot: None,
            cot_signed: None,
            switches: Vec::new(),
            nonfoot_contact: false,
            unseen: None,
            ticks: (0..5).map(tick).collect(),
        };
        let story = Story {
            id: "up".to_owned(),
            title: String::new(),
            summary: String::new(),
            expected: Some("stopped".to_owned()),
            as_expected: true,
        };
        let thresholds = [("walk".to_owned(), 0.95), ("ascend".to_owned(), 0.925)];
        let terrain = Terrain::course(run.kind, run.size_m, run.steps);
        let packed = PackedCourse::new(story, &run, &robot, &terrain, &thresholds);
        let length = |text: &str| text.len() / 4 * 3 - text.matches('=').count();
        assert_eq!(packed.first_tick, 40);
        assert_eq!(length(&packed.predictions), 5 * 2 * 2 * 2);
        assert_eq!(length(&packed.verdict), 5 * 2 * 2);
        for series in [&packed.viable, &packed.choice, &packed.active] {
            assert_eq!(length(series), 5);
        }
        assert_eq!(length(&packed.field), 3 * 341, "every other tick");
        assert_eq!((packed.choice, packed.active), (base64(&[2; 5]), base64(&[1; 5])));
    }

    #[test]
    fn one_skill_alone_is_packed_with_its_name_and_without_predictions() {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let robot = RobotModel::load(&robots, "anymal_d").unwrap();
        let tick = CourseTick {
            decision: None,
            base: BasePose::from_yaw([1.0, 0.0, 0.6], 0.0),
            joint_position_rad: robot.stand_position_rad(),
            foot_contact: vec![true; 4],
        };
        let run = CourseRun {
            kind: CourseKind::StairsUp,
            size_m: 0.12,
            steps: 3,
            outcome: Outcome::Crashed,
            duration_s: 0.04,
            distance_m: 0.0,
            cot: None,
            cot_signed: None,
            switches: vec![Switch { t_s: 0.0, from: "stand".into(), to: "trot".into() }],
            nonfoot_contact: true,
            unseen: None,
            ticks: vec![tick; 2],
        };
        let story = Story { summary: told(&run), ..Story::default() };
        let packed = PackedCourse::new(story, &run, &robot, &Terrain::course(run.kind, 0.12, 3), &[]);
        assert_eq!((packed.active, packed.names[2].as_str()), (base64(&[2; 2]), "trot"));
        assert!(
            packed.predictions.is_empty() && packed.story.summary.contains("touched the ground after 0.0 s")
        );
    }

    #[test]
    fn texts_are_kept_once() {
        let mut texts = Texts::default();
        let indices = ["a", "b", "a"].map(|text| texts.of(text));
        assert_eq!((indices, texts.list), ([0, 1, 0], vec!["a".to_owned(), "b".to_owned()]));
    }
}
