//! Who decides on a course: the selector's runtime, or one skill alone.

use rand_chacha::ChaCha8Rng;
use vocaloco_core::{
    decision::Decision,
    elevation::Elevation,
    heightfield::{COLUMNS, Heightfield, Noise, ROWS},
    observation::{BaseInOdom, Observation},
    plugin::PluginInstance,
    runtime::Runtime,
};
use vocaloco_plugin_api::{Command, TerrainPatch};

use super::{CourseConfig, CourseError, Ground};
use crate::{
    driver::{DECIMATION, Driver, TICK_S},
    occlusion::{Occlusion, SeenMap, Unseen, levelled},
    plant::{Measurement, Plant},
    rollout::RolledSkill,
    sensing::Sensors,
    stream::{stream, uniform},
    terrain::{Course, Terrain, Vantage},
};

/// The elevation map that the simulated robot perceives. Both the field's 10 cm and a plugin's
/// points fall on its own when they are multiples of its resolution.
const MAP: TerrainPatch = TerrainPatch { back_m: 1.2, front_m: 2.2, half_width_m: 0.7, resolution_m: 0.02 };

/// What a tick came to.
#[derive(Clone, Debug)]
pub struct PilotTick {
    /// What was decided, where there is anything to decide.
    pub decision: Option<Decision>,
    /// The skill that drove, or `stand`.
    pub active: String,
    /// The base touched something in one of the physics steps.
    pub base_contact: bool,
    /// Anything but a foot did.
    pub nonfoot_contact: bool,
}

/// Drives a plant, one policy tick at a time.
pub trait Pilot {
    /// The plant that is driven.
    fn plant(&self) -> &Plant;

    /// Counts work from here.
    fn reset_work(&mut self);

    /// What cameras have not seen so far; none where the map is whole.
    fn unseen(&self) -> Option<Unseen> {
        None
    }

    /// Observes, decides, and steps the plant by 20 ms.
    ///
    /// # Errors
    /// When the pilot cannot go on.
    fn tick(&mut self, command: &Command) -> Result<PilotTick, CourseError>;
}

/// Contacts over the physics steps of a tick.
#[derive(Default)]
struct Touched {
    base: bool,
    nonfoot: bool,
}

impl Touched {
    fn see(&mut self, measured: &Measurement) {
        self.base |= measured.base_contact;
        self.nonfoot |= measured.nonfoot_contact;
    }
}

/// The runtime of `vocaloco-core`, exactly as on a robot, fed from the plant.
pub struct SelectorPilot<'a> {
    plant: &'a mut Plant,
    terrain: &'a Terrain,
    runtime: &'a mut Runtime,
    course: Course,
    field_noise_m: f32,
    sensors: Sensors,
    field: ChaCha8Rng,
    occlusion: Occlusion,
    seen: Option<SeenMap>,
    ground: Option<&'a Ground>,
    watch: Option<&'a mut dyn FnMut(&Measurement)>,
    ticks: u64,
}

impl<'a> SelectorPilot<'a> {
    /// A pilot at time 0; its noise comes from the streams `course_sensors` and `course_field`.
    pub fn new(
        config: &CourseConfig,
        plant: &'a mut Plant,
        terrain: &'a Terrain,
        runtime: &'a mut Runtime,
    ) -> Self {
        let [x_m, y_m, _] = plant.measure().base.position_m;
        let seen = (config.occlusion != Occlusion::None).then(|| SeenMap::new(terrain, [x_m, y_m]));
        Self {
            plant,
            terrain,
            runtime,
            course: config.course(),
            occlusion: config.occlusion,
            seen,
            ground: None,
            field_noise_m: config.field_noise_m,
            sensors: Sensors::new(config.noise, stream(config.seed, "course_sensors", &[config.rollout])),
            field: stream(config.seed, "course_field", &[config.rollout]),
            watch: None,
            ticks: 0,
        }
    }

    /// Shows `watch` every physics step.
    #[must_use]
    pub fn watched(mut self, watch: &'a mut dyn FnMut(&Measurement)) -> Self {
        self.watch = Some(watch);
        self
    }

    /// Says every tick what lies under the field, for an oracle to look up.
    #[must_use]
    pub fn over(mut self, ground: Option<&'a Ground>) -> Self {
        self.ground = ground;
        self
    }

    /// Adds a velocity to the robot at once, m/s in the world.
    pub fn push(&mut self, velocity_in_world: [f32; 3]) {
        self.plant.push(velocity_in_world);
    }

    fn observe(&mut self, command: &Command) -> Observation {
        let t_s = self.ticks as f64 * TICK_S;
        let measured = self.plant.measure();
        let from = Vantage { position_m: measured.base.position_m, yaw_rad: measured.base.yaw() };
        let mut elevation = self.terrain.elevation(&from, &MAP, t_s);
        self.sensors.measure(measured);
        blur(&mut elevation, |height| self.sensors.height_m(height));
        let readings = self.sensors.readings();
        Observation {
            t_s,
            joint_position_rad: readings.joint_position_rad.clone(),
            joint_velocity_rad_per_s: readings.joint_velocity_rad_per_s.clone(),
            joint_torque_nm: Some(readings.joint_torque_nm.clone()),
            foot_contact: Some(measured.foot_contact.clone()),
            base_linear_velocity: readings.base_linear_velocity_m_per_s,
            base_angular_velocity: readings.base_angular_velocity_rad_per_s,
            projected_gravity: readings.projected_gravity,
            base_in_odom: Some(BaseInOdom::from(&measured.base)),
            elevation: Some(elevation),
            command: *command,
            field_noise: (self.field_noise_m > 0.0).then(|| self.field_noise()),
            heightfield: self.seen_field(),
        }
    }

    /// The field by the cameras' map; none where the map is whole.
    fn seen_field(&mut self) -> Option<Heightfield> {
        let base = self.plant.measure().base;
        let seen = self.seen.as_mut()?;
        seen.look(self.terrain, &base);
        let field =
            seen.heightfield(self.terrain, &Vantage { position_m: base.position_m, yaw_rad: base.yaw() });
        match self.occlusion {
            // A field with too much unknown stays as it is: the runtime stops for it.
            Occlusion::CameraUnfilled => Some(levelled(&field).unwrap_or(field)),
            Occlusion::None | Occlusion::Camera => Some(field),
        }
    }

    fn field_noise(&mut self) -> Noise {
        let mut cells = [[0.0; COLUMNS]; ROWS];
        for cell in cells.as_flattened_mut() {
            *cell = uniform(&mut self.field, -self.field_noise_m, self.field_noise_m);
        }
        cells
    }
}

/// Noise on every height but those that the predictors' field is sampled from: it has its own.
fn blur(elevation: &mut Elevation, mut noisy: impl FnMut(f32) -> f32) {
    let every = (0.1 / elevation.resolution_m).round() as usize;
    let (first_row, first_column) = (
        (elevation.back_m / elevation.resolution_m).round() as usize % every,
        (elevation.half_width_m / elevation.resolution_m).round() as usize % every,
    );
    let columns = elevation.columns();
    for (index, height) in elevation.height_m.iter_mut().enumerate() {
        let of_the_field =
            (index / columns) % every == first_row && (index % columns) % every == first_column;
        if !of_the_field {
            *height = noisy(*height);
        }
    }
}

impl Pilot for SelectorPilot<'_> {
    fn plant(&self) -> &Plant {
        self.plant
    }

    fn reset_work(&mut self) {
        self.plant.reset_work();
    }

    fn unseen(&self) -> Option<Unseen> {
        self.seen.as_ref().map(SeenMap::unseen)
    }

    fn tick(&mut self, command: &Command) -> Result<PilotTick, CourseError> {
        if let Some(ground) = self.ground {
            ground.set(self.course.under_field(self.plant.measure().base.position_m[0]));
        }
        let observation = self.observe(command);
        let tick = self.runtime.tick(&observation);
        let mut touched = Touched::default();
        for _ in 0..DECIMATION {
            self.plant.step(tick.joints);
            touched.see(self.plant.measure());
            if let Some(watch) = &mut self.watch {
                watch(self.plant.measure());
            }
        }
        self.ticks += 1;
        Ok(PilotTick {
            active: tick.decision.active.clone(),
            decision: Some(tick.decision.clone()),
            base_contact: touched.base,
            nonfoot_contact: touched.nonfoot,
        })
    }
}

/// One skill alone, whatever lies ahead.
pub struct SkillPilot<'a> {
    name: String,
    driver: Driver<'a>,
    started: bool,
    ticks: u64,
}

impl<'a> SkillPilot<'a> {
    /// A pilot at time 0; its noise comes from the stream `course_sensors`.
    pub fn new(
        config: &CourseConfig,
        plant: &'a mut Plant,
        terrain: &'a Terrain,
        (skill, instance): (&RolledSkill, &'a mut PluginInstance),
    ) -> Self {
        let rng = stream(config.seed, "course_sensors", &[config.rollout]);
        let driver = Driver::new(plant, terrain, instance, config.noise, rng).aiming(skill.target());
        Self { name: skill.name.clone(), driver, started: false, ticks: 0 }
    }
}

impl Pilot for SkillPilot<'_> {
    fn plant(&self) -> &Plant {
        self.driver.plant
    }

    fn reset_work(&mut self) {
        self.driver.plant.reset_work();
    }

    fn tick(&mut self, command: &Command) -> Result<PilotTick, CourseError> {
        let t_s = self.ticks as f64 * TICK_S;
        let name = &self.name;
        let failed = |error| CourseError::Skill { skill: name.clone(), t_s, error };
        if !self.started {
            self.driver.start().map_err(failed)?;
            self.started = true;
        }
        let mut touched = Touched::default();
        self.driver.tick(command, |plant| touched.see(plant.measure())).map_err(failed)?;
        self.ticks += 1;
        Ok(PilotTick {
            decision: None,
            active: self.name.clone(),
            base_contact: touched.base,
            nonfoot_contact: touched.nonfoot,
        })
    }
}
