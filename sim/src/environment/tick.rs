//! What a tick does to the robot of an environment, and what is seen of it afterwards.

use std::sync::Arc;

use vocaloco_core::observation::BaseInOdom;
use vocaloco_plugin_api::{Command, CommandKind};

use super::ground::Stage;
use super::reward::Deed;
use super::target::Aim;
use super::views::Known;
use super::{End, Environment};
use crate::driver::{DECIMATION, TICK_S};
use crate::plant::GRAVITY_M_PER_S2;

/// An episode ends this far before the map does, m: nothing in sight is unknown.
pub(super) const MAP_MARGIN_M: f32 = 1.5;
/// The ground's height is the mean over a square of this half-width around the base, m.
const GROUND_HALF_WIDTH_M: f32 = 0.25;
/// An expert, which follows velocities, slows down over this much of the way to a target, m.
const SLOWING_M: f32 = 0.5;

impl Environment {
    /// Four physics steps under the targets that arrive; what they did, and whether the base touched.
    pub(super) fn advance(&mut self) -> (Deed, bool) {
        let targets = self.latency.pass(&self.targets);
        let limit = self.plant.robot().drive.velocity_limit_rad_per_s;
        let work_before_j = self.plant.positive_work_j();
        let share = 1.0 / DECIMATION as f32;
        let mut deed = Deed::default();
        let mut touched = false;
        let (mut contacts, mut stumbles) = (0_u32, 0_u32);
        for _ in 0..DECIMATION {
            self.plant.step(targets);
            let measured = self.plant.measure();
            touched |= measured.base_contact;
            deed.base_contact_share += if measured.base_contact { share } else { 0.0 };
            deed.limb_contact_share += if measured.nonfoot_contact { share } else { 0.0 };
            for (torque, speed) in measured.joint_torque_nm.iter().zip(&measured.joint_velocity_rad_per_s) {
                deed.torque_squared += torque * torque * share;
                deed.overspeed_rad_per_s += (speed.abs() - limit).max(0.0) * share;
            }
            for (foot, (touches, stumble)) in
                measured.foot_contact.iter().zip(&measured.foot_stumble).enumerate()
            {
                contacts |= u32::from(*touches) << foot;
                stumbles |= u32::from(*stumble) << foot;
            }
        }
        let work_j = (self.plant.positive_work_j() - work_before_j) as f32;
        deed.power_per_weight = work_j / (TICK_S as f32 * self.plant.total_mass_kg() * GRAVITY_M_PER_S2);
        deed.stumbles = stumbles.count_ones() as f32;
        for (foot, air_time_s) in self.air_time_s.iter_mut().enumerate() {
            let touches = contacts >> foot & 1 == 1;
            if touches && *air_time_s > 0.0 {
                deed.air_time_s += *air_time_s + TICK_S as f32 - self.ground.config.reward.air_time_s;
            }
            *air_time_s = if touches { 0.0 } else { *air_time_s + TICK_S as f32 };
        }
        (deed, touched)
    }

    /// The rest of what the tick did: how the robot moves at its end.
    pub(super) fn add_motion(&self, deed: &mut Deed) {
        let measured = self.plant.measure();
        let [x, y, _] = measured.base.vector_in_world(measured.base_linear_velocity);
        let yaw = measured.base.yaw();
        let (sin, cos) = (libm::sinf(yaw), libm::cosf(yaw));
        deed.command = self.command.velocity;
        deed.aim = self.target.map(|target| {
            let now_s = f64::from(self.tick) * TICK_S;
            let way = target.command(&BaseInOdom::from(&measured.base), [0.0; 3], now_s).target;
            let offset = measured.joint_position_rad.iter().zip(&self.ground.stand_rad);
            let posture_error = offset.map(|(q, stand)| (q - stand).powi(2)).sum();
            Aim::new(
                way,
                [cos * x + sin * y, cos * y - sin * x],
                measured.base_angular_velocity[2],
                posture_error,
            )
        });
        deed.velocity_in_yaw = [cos * x + sin * y, cos * y - sin * x];
        deed.vertical_m_per_s = measured.base_linear_velocity[2];
        deed.angular_velocity = measured.base_angular_velocity;
        deed.heading_error_rad = self.path.heading_error_rad(&measured.base);
        deed.projected_gravity = measured.projected_gravity;
        deed.height_error_m = self.height_error_m();
        let changes = measured.joint_velocity_rad_per_s.iter().zip(&self.joint_velocity_before);
        deed.joint_acceleration_squared =
            changes.map(|(after, before)| ((after - before) / TICK_S as f32).powi(2)).sum();
        deed.action_change_squared =
            self.action.iter().zip(&self.last_action).map(|(now, last)| (now - last).powi(2)).sum();
    }

    /// Height of the base over the ground around it, less the stand's.
    pub(super) fn height_error_m(&self) -> f32 {
        let terrain = &self.ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let [x_m, y_m, z_m] = self.plant.measure().base.position_m;
        let steps = [-GROUND_HALF_WIDTH_M, 0.0, GROUND_HALF_WIDTH_M];
        let column = |dx: f32| steps.map(|dy| terrain.height_m(x_m + dx, y_m + dy)).iter().sum::<f32>();
        let ground_m = steps.map(column).iter().sum::<f32>() / 9.0;
        z_m - ground_m - self.ground.robot.description.stand_height_m as f32
    }

    pub(super) fn find_end(&mut self, stage: &Stage, base_touched: bool) -> Option<End> {
        let config = &self.ground.config;
        let [x_m, y_m, z_m] = self.plant.measure().base.position_m;
        self.base_has_touched |= base_touched;
        self.base_contact_ticks = if base_touched { self.base_contact_ticks + 1 } else { 0 };
        let contact_s = f64::from(self.base_contact_ticks) * TICK_S;
        let collided = base_touched && contact_s > f64::from(config.base_contact_s.unwrap_or(0.0));
        let began_m = stage.spawns[self.episode.pose].base.position_m[2];
        let fell = config.fall_m.is_some_and(|fall_m| z_m < began_m - fall_m);
        if collided || fell || !(x_m + y_m + z_m).is_finite() {
            return Some(End::Terminated);
        }
        let terrain = &stage.terrain;
        let inside = [(x_m, 0), (y_m, 1)].into_iter().all(|(at_m, axis)| {
            at_m >= terrain.min_m[axis] + MAP_MARGIN_M && at_m <= terrain.max_m[axis] - MAP_MARGIN_M
        });
        let is_over = self.tick >= self.episode.ticks;
        if is_over && self.target.is_some() {
            return Some(End::Finished);
        }
        (is_over || !inside).then_some(End::TimedOut)
    }

    /// The command, and both views of the present tick.
    pub(super) fn sense(&mut self) {
        let ground = Arc::clone(&self.ground);
        let terrain = &ground.stage(self.terrain, self.level, self.episode.variant).terrain;
        let known = Known {
            height_error_m: self.height_error_m(),
            variation: &self.episode.variation,
            latency_ticks: self.episode.latency_ticks,
            air_time_s: &self.air_time_s,
        };
        let measured = self.plant.measure();
        let time_s = f64::from(self.tick) * TICK_S;
        let by_velocity = self.path.command(&measured.base, &self.episode.rules);
        self.command = self.target.map_or(by_velocity, |target| {
            target.command(&BaseInOdom::from(&measured.base), by_velocity.velocity, time_s)
        });
        self.views.fill((terrain, measured), time_s, &self.command, &self.last_action, &known);
    }
}

/// What an expert is told: velocities as they are, and on the way to a target the velocity that goes along,
/// slower over the last half metre.
pub(super) fn for_an_expert(command: &Command) -> Command {
    if command.kind == CommandKind::Velocity {
        return *command;
    }
    let [forward, left, yaw_rate] = command.velocity;
    Command::velocity(forward * (command.target[0] / SLOWING_M).clamp(0.0, 1.0), left, yaw_rate)
}
