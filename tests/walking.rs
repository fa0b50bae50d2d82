//! A simulated robot that walks by the runtime, and a second skill that a test lets loose on it.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use vocaloco_core::decision::Decision;
use vocaloco_core::heightfield::Field;
use vocaloco_core::manifest::{Deadlines, Isolation};
use vocaloco_core::observation::Observation;
use vocaloco_core::plugin::{PluginError, PluginInstance, PluginLibrary};
use vocaloco_core::registry::{ModelPolicy, load_skill};
use vocaloco_core::robot::RobotModel;
use vocaloco_core::runtime::{
    CallFault, Follower, FrozenLimits, Pace, Predict, Runtime, RuntimeConfig, Skill, Supervision,
};
use vocaloco_core::selector::Prediction;
use vocaloco_core::switch::Windows;
use vocaloco_plugin_api::{Command, JointTarget, TerrainPatch};
use vocaloco_sim::course::{CourseConfig, CourseStage};
use vocaloco_sim::driver::{DECIMATION, TICK_S};
use vocaloco_sim::plant::Plant;
use vocaloco_sim::terrain::{CourseKind, Terrain, Vantage};

use crate::shipped;

const MAP: TerrainPatch = TerrainPatch { back_m: 1.2, front_m: 2.2, half_width_m: 0.7, resolution_m: 0.05 };

/// What a skill's stand-in predictors say; the test changes it.
#[derive(Clone)]
pub struct Says(Arc<Mutex<(Prediction, Duration)>>);

impl Says {
    /// Viability and cost of transport, until they are [`set`](Self::set) otherwise.
    pub fn always(viability: f32, cot: f32) -> Self {
        Self(Arc::new(Mutex::new((Prediction::of(viability, cot), Duration::ZERO))))
    }

    fn now(&self) -> std::sync::MutexGuard<'_, (Prediction, Duration)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on.
    pub fn set(&self, viability: f32, cot: f32) {
        self.now().0 = Prediction::of(viability, cot);
    }

    /// From now on the terrain is as unlike any that they were fitted to as this.
    pub fn find_strange(&self, strangeness: Option<f32>) {
        self.now().0.strangeness = strangeness;
    }

    /// From now on they take their time.
    pub fn take(&self, time: Duration) {
        self.now().1 = time;
    }
}

impl Predict for Says {
    fn predict(&mut self, _: &Field) -> (Prediction, Option<CallFault>) {
        let (prediction, time) = *self.now();
        std::thread::sleep(time);
        (prediction, None)
    }
}

/// The shipped `walk` on the flat before a staircase at 0.6 m/s, and beside it the skill `bad`.
pub struct Walking {
    /// The loop.
    pub runtime: Runtime,
    /// The world.
    pub plant: Plant,
    /// Predictions of `walk`.
    pub walk: Says,
    /// Predictions of `bad`.
    pub bad: Says,
    /// The targets of the last tick.
    pub joints: Vec<JointTarget>,
    /// Whether the base has touched anything.
    pub has_fallen: bool,
    terrain: Terrain,
    ticks: u64,
}

impl Walking {
    /// Of both skills, whatever is shipped.
    pub const THRESHOLD: f32 = 0.95;
    /// For how long its measurements may stay the same.
    pub const FROZEN: FrozenLimits = FrozenLimits { measurement_s: Some(0.1), terrain_s: Some(0.2) };

    /// The robot in its stand; `bad` misbehaves as `fault` says, see the plugin `faulty`.
    ///
    /// In real time a call may take `act_s`.
    ///
    /// # Panics
    /// When what is shipped does not load.
    pub fn new(fault: &str, isolation: Isolation, act_s: Option<f64>) -> Self {
        let path = shipped().plugin_path;
        let library = match isolation {
            Isolation::None => PluginLibrary::open(&path, "faulty"),
            Isolation::Process => PluginLibrary::open_isolated(&path, "faulty", &|_, _| Ok(())),
        };
        Self::beside(act_s, |robot| library.and_then(|library| library.create(fault, &robot.description)))
    }

    /// The same with another plugin's instance as `bad`.
    ///
    /// # Panics
    /// When what is shipped does not load, or `bad` is not made.
    pub fn beside(
        act_s: Option<f64>,
        bad: impl FnOnce(&RobotModel) -> Result<PluginInstance, PluginError>,
    ) -> Self {
        let installation = shipped();
        let robot = Arc::new(RobotModel::load(&installation.robots_folder(), "anymal_d").expect("the robot"));
        let loaded = load_skill(&installation, "walk", &robot.description, ModelPolicy::Optional);
        let loaded = loaded.expect("the shipped walk");
        let bad = bad(&robot);
        let [walk_says, bad_says] =
            [(0.99, 0.5), (0.1, 0.1)].map(|(viability, cot)| Says::always(viability, cot));
        let skill = |name: &str, controller: PluginInstance, says: &Says| Skill {
            rule: vocaloco_core::selector::Rule {
                name: name.into(),
                viability_threshold: Self::THRESHOLD,
                hold_threshold: Self::THRESHOLD,
                ..Skill::rule_of(&loaded)
            },
            needs: *controller.needs(),
            controller: Box::new(controller),
            predictors: Box::new(says.clone()),
        };
        let skills = vec![
            skill("walk", loaded.create(&robot.description).expect("an instance"), &walk_says),
            skill("bad", bad.expect("sound until it is not"), &bad_says),
        ];
        let windows = Windows { switch: 10, stop: 10, resume: 25 };
        let config = RuntimeConfig { frozen: Self::FROZEN, ..RuntimeConfig::of(windows) };
        let mut runtime = Runtime::from_skills(config, Arc::clone(&robot), skills);
        if let Some(act_s) = act_s {
            let deadlines = Deadlines { act_s, predict_s: act_s };
            let supervision = Supervision { clock, deadlines, pace: Pace::Real };
            runtime = runtime.supervised(supervision).expect("threads");
        }
        let course = CourseConfig::demo(CourseKind::StairsUp, 0.02, 7);
        let CourseStage { terrain, plant } = CourseStage::set(&robot, &course).expect("a settled robot");
        Self {
            joints: vec![JointTarget::default(); robot.joint_count()],
            walk: walk_says,
            bad: bad_says,
            has_fallen: false,
            ticks: 0,
            runtime,
            plant,
            terrain,
        }
    }

    /// The same, at its full speed.
    ///
    /// # Panics
    /// When it does not come to that.
    pub fn at_speed(fault: &str, isolation: Isolation, act_s: Option<f64>) -> Self {
        Self::new(fault, isolation, act_s).at_full_speed()
    }

    /// The same, at its full speed.
    ///
    /// # Panics
    /// When it does not come to that.
    #[must_use]
    pub fn at_full_speed(mut self) -> Self {
        for _ in 0..80 {
            self.tick();
        }
        let speed = self.plant.measure().base_linear_velocity[0];
        assert!(speed > 0.4, "it moves at {speed} m/s");
        self
    }

    /// The same, whose skills are those of files that are followed.
    #[must_use]
    pub fn following(mut self, follower: Follower) -> Self {
        self.runtime = self.runtime.following(follower);
        self
    }

    /// One tick.
    pub fn tick(&mut self) -> Decision {
        self.tick_with(|_| {})
    }

    /// One tick with an observation that something went wrong with.
    ///
    /// # Panics
    /// When a drive is left without gains.
    pub fn tick_with(&mut self, spoil: impl FnOnce(&mut Observation)) -> Decision {
        let measured = self.plant.measure();
        let t_s = self.ticks as f64 * TICK_S;
        let from = Vantage { position_m: measured.base.position_m, yaw_rad: measured.base.yaw() };
        let mut observation = Observation {
            t_s,
            joint_position_rad: measured.joint_position_rad.clone(),
            joint_velocity_rad_per_s: measured.joint_velocity_rad_per_s.clone(),
            joint_torque_nm: Some(measured.joint_torque_nm.clone()),
            foot_contact: Some(measured.foot_contact.clone()),
            base_linear_velocity: measured.base_linear_velocity,
            base_angular_velocity: measured.base_angular_velocity,
            projected_gravity: measured.projected_gravity,
            base_in_odom: None,
            elevation: Some(self.terrain.elevation(&from, &MAP, t_s)),
            command: Command::velocity(0.6, 0.0, (-0.5 * measured.base.yaw()).clamp(-1.0, 1.0)),
            field_noise: None,
            heightfield: None,
        };
        spoil(&mut observation);
        let ticked = self.runtime.tick(&observation);
        let decision = ticked.decision.clone();
        self.joints.copy_from_slice(ticked.joints);
        let has_gains = |it: &JointTarget| it.stiffness_nm_per_rad >= 1.0 && it.damping_nms_per_rad >= 0.01;
        assert!(self.joints.iter().all(has_gains), "{decision:?}: {:?}", self.joints);
        for _ in 0..DECIMATION {
            self.plant.step(&self.joints);
            self.has_fallen |= self.plant.measure().base_contact;
        }
        self.ticks += 1;
        decision
    }

    /// Ticks until `bad` would drive: the one in which it is first called.
    ///
    /// # Panics
    /// When that never comes.
    pub fn until_bad_is_called(&mut self) -> Decision {
        self.bad.set(0.99, 0.1);
        for _ in 0..9 {
            assert_eq!(self.tick().active, "walk", "the window has not agreed yet");
        }
        self.tick()
    }

    /// Whether every target is one of the stand.
    pub fn stands(&self) -> bool {
        let stiffness = self.runtime.robot().stand.stiffness_nm_per_rad;
        self.joints.iter().all(|it| it.position_rad.is_finite() && it.stiffness_nm_per_rad >= stiffness)
    }

    /// Whether the robot is upright and has not touched anything with its base.
    pub fn is_on_its_feet(&self) -> bool {
        !self.has_fallen && self.plant.measure().projected_gravity[2] < -0.95
    }
}

/// Time since a test first asked.
fn clock() -> std::time::Duration {
    #[expect(clippy::disallowed_methods, reason = "budgets are of the world's time")]
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    START.elapsed()
}
