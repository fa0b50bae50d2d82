//! The gait itself: phase, legs that stand, legs that swing, one tick at a time.

use nalgebra::{Vector2, Vector3};
use vocaloco_plugin_api::abi::abi_stable::std_types::{ROption::RSome, RVec};
use vocaloco_plugin_api::{
    Command, CommandKind, Description, ErrorCode, Host, JointTarget, Needs, Range, RobotDescription,
    RobotState, Skill, SkillError,
};

use crate::{
    balance,
    body::{Body, Estimate, attitude},
    foothold::{self, Reach},
    ground::{Ground, PATCH},
    kinematics::{FootPose, Leg},
    parameters::Parameters,
    swing::Swing,
};

const RATE_HZ: f64 = 50.0;
pub(crate) const TICK_S: f64 = 1.0 / RATE_HZ;
const GRAVITY_M_PER_S2: f64 = 9.81;
/// Rotational inertia of a quadruped per its mass, m², about x, y and z.
const GYRATION_M2: [f64; 3] = [0.05, 0.11, 0.13];
/// Horizontal and vertical acceleration that the balance may ask for, m/s².
const LARGEST_ACCELERATION: f64 = 5.0;
/// Share of the stance over which a foot takes up and gives up its load.
const LOAD_RAMP: f64 = 0.15;
const LOAD_START: f64 = 0.3;
/// Share of the swing before which a contact is a stumble, not a landing.
const LANDING_SHARE: f64 = 0.5;
/// Ticks without contact after which a standing foot has lost the ground.
const LOST_TICKS: u32 = 2;
/// Slowest pace on steep ground, per commanded velocity.
const SLOWEST_PACE: f64 = 0.6;
/// Velocity error beyond which the cycle is not quickened further.
const LARGEST_HURRIED_M_PER_S: f64 = 1.0;
/// A swing held back by more than this after this share of it comes down where it is.
const HELD_M: f64 = 0.03;
const GIVING_UP_SHARE: f64 = 0.75;
/// A swing held back by this much makes the body wait all it may.
const MOST_HELD_M: f64 = 0.15;
/// Height and pitch errors at which a robot has risen.
const RISEN_M: f64 = 0.02;
const RISEN_RAD: f64 = 0.1;
/// How far below its foothold a foot looks for the ground, m.
const SEARCH_DEPTH_M: f64 = 0.12;

/// No joint, base or gravity is measured beyond this in any unit; what is would be integrated.
const LARGEST_MEASURED: f32 = 1e3;

/// What a leg is doing.
#[derive(Clone, Copy, Debug, Default)]
struct LegState {
    swinging: bool,
    landed: bool,
    /// In the yaw-aligned frame, moved against the base's motion each tick.
    lifted_at: Vector3<f64>,
    foothold: Option<Vector2<f64>>,
    searched_m: f64,
    /// How far the swing was held back before an edge in the last tick.
    held_m: f64,
    /// Ticks without contact in this stance.
    airborne: u32,
    joints: Vector3<f64>,
}

/// A trot over terrain, as a skill.
pub struct Gait {
    parameters: Parameters,
    legs: [Leg; 4],
    mass_kg: f64,
    base_mass_kg: f64,
    phase: f64,
    /// Time left to stand on four feet before the first step.
    rising_s: f64,
    aimed: Vector3<f64>,
    estimate: Estimate,
    states: [LegState; 4],
}

impl Skill for Gait {
    fn describe() -> Description {
        Description {
            name: "gait".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            summary: "A trot with footholds from the terrain ahead, inverse kinematics and balance".into(),
            joints: RVec::new(),
            rate_hz: RATE_HZ,
            command: CommandKind::Velocity,
            forward_m_per_s: Range { min: 0.0, max: 0.8 },
            needs: Needs { policy: false, terrain: RSome(PATCH), foot_contacts: true, joint_torques: false },
            parameters: Parameters::table().into(),
        }
    }

    fn create(parameters: &str, robot: &RobotDescription, _host: Host) -> Result<Self, SkillError> {
        let parameters = Parameters::parse(parameters)?;
        let legs: [Leg; 4] = Leg::of(robot)?.try_into().map_err(|legs: Vec<Leg>| {
            SkillError::new(
                ErrorCode::Robot,
                format!("robot {}: found {} legs, wanted 4", robot.name, legs.len()),
            )
        })?;
        Ok(Self {
            phase: parameters.initial_phase,
            rising_s: 0.0,
            parameters,
            legs,
            mass_kg: robot.mass_kg,
            base_mass_kg: robot.base_mass_kg,
            aimed: Vector3::zeros(),
            estimate: Estimate::default(),
            states: [LegState::default(); 4],
        })
    }

    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), SkillError> {
        self.check(state)?;
        let velocity = state.base_linear_velocity_m_per_s;
        self.aimed = Vector3::new(f64::from(velocity[0]).max(0.0), 0.0, 0.0);
        self.phase = self.phase_of(state);
        let standing = state.foot_contact.iter().all(|contact| *contact != 0);
        self.rising_s = if standing { self.parameters.rise_s } else { 0.0 };
        self.estimate = Estimate::of(state);
        let rotation = self.estimate.rotation();
        for index in 0..4 {
            let leg = &self.legs[index];
            let joints = leg.joints.map(|joint| f64::from(state.joint_position_rad[joint])).into();
            // A foot in the air has yet to find the ground, from where it is.
            self.states[index] = LegState {
                landed: state.foot_contact[index] != 0,
                lifted_at: rotation * leg.pose(&joints).position,
                joints,
                ..LegState::default()
            };
        }
        Ok(())
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        self.check(state)?;
        if command.kind != CommandKind::Velocity || !command.velocity.iter().all(|value| value.is_finite()) {
            return Err(SkillError::new(ErrorCode::Input, "command: wanted a finite velocity"));
        }
        let feet: [FootPose; 4] = std::array::from_fn(|index| {
            self.legs[index]
                .pose(&self.legs[index].joints.map(|joint| f64::from(state.joint_position_rad[joint])).into())
        });
        let lowest = feet.iter().map(|foot| foot.position.z).fold(f64::INFINITY, f64::min);
        let ground = Ground::new(state.terrain_m.as_slice(), lowest).ok_or_else(|| {
            SkillError::new(
                ErrorCode::Input,
                format!(
                    "terrain: found {} heights, wanted {}",
                    state.terrain_m.len(),
                    PATCH.rows() * PATCH.columns(),
                ),
            )
        })?;
        let hip_x_m = self.legs.iter().map(|leg| leg.hip().x).fold(0.0, f64::max);
        let body = self.estimate.update(state, &ground, hip_x_m, &self.parameters);
        self.rise(&body);
        self.aim(command, &body);
        for leg in &mut self.states {
            leg.follow(&body);
        }
        let loads = self.advance(state, &body, &feet);
        let forces = self.forces(command, &body, &feet, &loads);
        for (index, foot) in feet.iter().enumerate() {
            let target = if loads[index] > 0.0 {
                self.stand(command, &body, foot)
            } else {
                self.swing(index, command, &body, &ground, &(body.rotation * foot.position))
            };
            self.drive(index, &body, foot, &target, loads[index] > 0.0, &forces[index], joints);
        }
        let error = (body.velocity - self.aimed).xy().norm().min(LARGEST_HURRIED_M_PER_S);
        if self.rising_s > 0.0 {
            return Ok(());
        }
        let quickened = 1.0 + self.parameters.hurry * error;
        self.phase = fraction(self.phase + quickened * TICK_S / self.parameters.period_s);
        Ok(())
    }
}

impl LegState {
    /// Points fixed in the world move against the base in its own frame.
    fn follow(&mut self, body: &Body) {
        let turn = -body.rates.z * TICK_S;
        let moved = |point: Vector3<f64>| {
            let point = point - body.velocity * TICK_S;
            Vector3::new(point.x - turn * point.y, point.y + turn * point.x, point.z)
        };
        self.lifted_at = moved(self.lifted_at);
        self.foothold = self.foothold.map(|point| moved(Vector3::new(point.x, point.y, 0.0)).xy());
    }
}

impl Gait {
    fn check(&self, state: &RobotState<'_>) -> Result<(), SkillError> {
        let joints = 1 + self.legs.iter().flat_map(|leg| leg.joints).max().unwrap_or(0);
        let refuse = |what: String| Err(SkillError::new(ErrorCode::Input, what));
        if state.joint_position_rad.len() < joints || state.joint_velocity_rad_per_s.len() < joints {
            return refuse(format!("joints: found {}, wanted {joints}", state.joint_position_rad.len()));
        }
        if state.foot_contact.len() != 4 {
            return refuse(format!("foot_contact: found {}, wanted 4", state.foot_contact.len()));
        }
        let numbers = state.joint_position_rad.iter().chain(state.joint_velocity_rad_per_s.iter());
        let vectors = [
            state.base_linear_velocity_m_per_s,
            state.base_angular_velocity_rad_per_s,
            state.projected_gravity,
        ];
        // Phrased as "is inside", so NaN is refused too.
        let plausible = |value: &f32| (-LARGEST_MEASURED..=LARGEST_MEASURED).contains(value);
        if let Some(value) = numbers.chain(vectors.as_flattened()).find(|value| !plausible(value)) {
            return refuse(format!("state: found {value}, wanted numbers within ±{LARGEST_MEASURED}"));
        }
        Ok(())
    }

    /// Diagonal pairs share a phase; the first pair is the one with the left fore leg.
    fn in_first_pair(&self, leg: usize) -> bool {
        let hip = self.legs[leg].hip();
        hip.x * hip.y > 0.0
    }

    fn leg_phase(&self, leg: usize) -> f64 {
        if self.rising_s > 0.0 {
            return 0.5 * self.parameters.duty;
        }
        fraction(self.phase + if self.in_first_pair(leg) { 0.0 } else { 0.5 })
    }

    /// The phase that fits the feet as they are: a pair with a foot in the air goes on swinging.
    fn phase_of(&self, state: &RobotState<'_>) -> f64 {
        let airborne = |first: bool| {
            (0..4).filter(|&leg| self.in_first_pair(leg) == first).any(|leg| state.foot_contact[leg] == 0)
        };
        let mid_swing = 0.5 * (1.0 + self.parameters.duty);
        match (airborne(true), airborne(false)) {
            (true, false) => mid_swing,
            (false, true) => fraction(mid_swing + 0.5),
            _ => self.parameters.initial_phase,
        }
    }

    /// A robot that starts low or tilted first stands up: on two feet the drives can hardly lift it.
    fn rise(&mut self, body: &Body) {
        let p = &self.parameters;
        let tilt_rad = (body.wanted_pitch_rad(p) - body.pitch).abs();
        let risen = body.height_error_m(p) < RISEN_M && tilt_rad < RISEN_RAD;
        self.rising_s = if risen { 0.0 } else { (self.rising_s - TICK_S).max(0.0) };
    }

    fn aim(&mut self, command: &Command, body: &Body) {
        let p = &self.parameters;
        let slope = body.line.slope.clamp(-1.0, 1.0);
        let pace = p.pace + p.uphill_pace * slope.max(0.0) + p.downhill_pace * (-slope).max(0.0);
        let wanted = Vector3::new(
            f64::from(command.velocity[0]) * pace.max(SLOWEST_PACE),
            f64::from(command.velocity[1]),
            0.0,
        );
        // The body waits for a foot that has yet to get over an edge.
        let held_m = self.states.iter().map(|leg| leg.held_m).fold(0.0, f64::max);
        let wanted = wanted * (1.0 - p.wait * (held_m / MOST_HELD_M).min(1.0));
        let wanted = if self.rising_s > 0.0 { Vector3::zeros() } else { wanted };
        let step = self.parameters.acceleration_m_per_s2 * TICK_S;
        self.aimed += (wanted - self.aimed).map(|difference| difference.clamp(-step, step));
    }

    /// Moves every leg on between standing and swinging; the share of load that each foot takes.
    fn advance(&mut self, state: &RobotState<'_>, body: &Body, feet: &[FootPose; 4]) -> [f64; 4] {
        std::array::from_fn(|index| {
            let phase = self.leg_phase(index);
            let duty = self.parameters.duty;
            let contact = state.foot_contact[index] != 0;
            let leg = &mut self.states[index];
            if phase >= duty {
                if !leg.swinging {
                    *leg = LegState {
                        swinging: true,
                        lifted_at: body.rotation * feet[index].position,
                        joints: leg.joints,
                        ..LegState::default()
                    };
                }
                let share = (phase - duty) / (1.0 - duty);
                leg.landed |= contact && share > LANDING_SHARE;
                return if leg.landed { LOAD_START } else { 0.0 };
            }
            leg.swinging = false;
            leg.held_m = 0.0;
            leg.airborne = if contact { 0 } else { leg.airborne + 1 };
            if contact {
                leg.landed = true;
            } else if leg.landed && leg.airborne >= LOST_TICKS {
                // It slipped off an edge: down from where it is, to the ground below.
                let place = body.rotation * feet[index].position;
                leg.landed = false;
                leg.searched_m = 0.0;
                leg.lifted_at = place;
                leg.foothold = Some(place.xy());
            }
            if !leg.landed {
                leg.searched_m =
                    (leg.searched_m + self.parameters.search_speed_m_per_s * TICK_S).min(SEARCH_DEPTH_M);
                return 0.0;
            }
            let progress = phase / duty;
            let ramp = (progress / LOAD_RAMP).min((1.0 - progress) / LOAD_RAMP).clamp(0.0, 1.0);
            LOAD_START + (1.0 - LOAD_START) * ramp
        })
    }

    fn forces(
        &self,
        command: &Command,
        body: &Body,
        feet: &[FootPose; 4],
        loads: &[f64; 4],
    ) -> [Vector3<f64>; 4] {
        let p = &self.parameters;
        let bounded = |value: f64| value.clamp(-LARGEST_ACCELERATION, LARGEST_ACCELERATION);
        let climb = body.line.slope * self.aimed.x;
        let force = self.mass_kg
            * Vector3::new(
                bounded(p.forward_gain * (self.aimed.x - body.velocity.x)),
                bounded(p.sideways_gain * (self.aimed.y - body.velocity.y)),
                p.weight_share * GRAVITY_M_PER_S2
                    + bounded(
                        p.height_gain * body.height_error_m(p)
                            + p.height_rate_gain * (climb - body.velocity.z),
                    ),
            );
        let turning = Vector3::new(
            -p.roll_gain * body.roll - p.roll_rate_gain * body.rates.x,
            p.pitch_gain * (body.wanted_pitch_rad(p) - body.pitch) - p.pitch_rate_gain * body.rates.y,
            p.yaw_rate_gain * (f64::from(command.velocity[2]) - body.rates.z),
        );
        // The base origin is the base's own centre of mass.
        let legs: Vector3<f64> = feet.iter().map(|foot| foot.mass_moment).sum();
        let legs_kg: f64 = self.legs.iter().map(Leg::mass_kg).sum();
        let com = body.rotation * (legs / (self.base_mass_kg + legs_kg));
        let moment = com.cross(&force) + self.mass_kg * Vector3::from(GYRATION_M2).component_mul(&turning);
        let points = std::array::from_fn(|index| {
            let radius = Vector3::new(0.0, 0.0, self.legs[index].foot_radius_m);
            (body.rotation * feet[index].position - radius, loads[index])
        });
        balance::distribute(&points, &force, &moment)
    }

    /// Target of a standing foot in the base frame: where it is, less the body's wanted motion.
    fn stand(&self, command: &Command, body: &Body, foot: &FootPose) -> Vector3<f64> {
        let p = &self.parameters;
        // The damper pulls against the motion, and a held target lags by half a tick on average;
        // looking ahead by damping/stiffness and that half tick cancels both.
        let ahead_s = p.stance_damping / p.stance_stiffness + 0.5 * TICK_S;
        let place = body.rotation * foot.position;
        let turn = f64::from(command.velocity[2]) * ahead_s;
        let climb = body.line.slope * self.aimed.x;
        let moved = Vector3::new(
            place.x - self.aimed.x * ahead_s + turn * place.y,
            place.y - self.aimed.y * ahead_s - turn * place.x,
            place.z - climb * ahead_s - p.height_share * body.height_error_m(p),
        );
        let roll = body.roll * (1.0 - p.attitude_share);
        let pitch = body.pitch + p.attitude_share * (body.wanted_pitch_rad(p) - body.pitch);
        attitude(roll, pitch).inverse() * moved
    }

    /// Target of a swinging foot in the base frame; `place` is where it is, in the yaw-aligned one.
    fn swing(
        &mut self,
        index: usize,
        command: &Command,
        body: &Body,
        ground: &Ground<'_>,
        place: &Vector3<f64>,
    ) -> Vector3<f64> {
        let p = &self.parameters;
        let phase = self.leg_phase(index);
        let swing_s = (1.0 - p.duty) * p.period_s;
        let share = if phase >= p.duty { (phase - p.duty) / (1.0 - p.duty) } else { 1.0 };
        let leg = &self.legs[index];
        let radius = leg.foot_radius_m;

        let left_s = (1.0 - share) * swing_s;
        let nominal = self.nominal(index, command, body, left_s);
        let climb = body.line.slope * body.velocity.x;
        let travel = Vector3::new(body.velocity.x, body.velocity.y, climb) * left_s;
        let reach = Reach {
            hip: body.rotation * leg.hip() + travel,
            longest_m: leg.longest_m(),
            foot_radius_m: radius,
        };
        let state = &self.states[index];
        let chosen = match state.foothold {
            Some(kept) if share > 0.7 => kept,
            previous => Vector2::from(foothold::choose(
                ground,
                p,
                leg.hip().x > 0.0,
                nominal.into(),
                &reach,
                previous.map(Into::into),
            )),
        };
        let to = Vector3::new(chosen.x, chosen.y, ground.height_m(chosen.x, chosen.y) + radius);
        let from = state.lifted_at;
        let highest_m = ground.highest_between([from.x, from.y], chosen.into()) + radius;
        let ahead_s = p.swing_damping / p.swing_stiffness + 0.5 * TICK_S;
        let swing = Swing { from, to, highest_m };
        let (mut target, held_m) =
            swing.gated(&swing.at(share + ahead_s / swing_s, p), place, radius, ground, p);
        target.z -= state.searched_m;
        // Too late to get up there in this swing: down before the edge, rather than hang in the air.
        let given_up = held_m > HELD_M && share > GIVING_UP_SHARE;
        self.states[index].foothold = Some(if given_up { target.xy() } else { chosen });
        self.states[index].held_m = held_m;
        // Where the body will be by then.
        body.rotation.inverse() * (target - body.velocity * (0.5 * TICK_S))
    }

    /// Where a foot would land on flat, open ground, seen from where the base is now.
    fn nominal(&self, index: usize, command: &Command, body: &Body, left_s: f64) -> Vector2<f64> {
        let p = &self.parameters;
        let leg = &self.legs[index];
        let hip = leg.hip();
        let outward = hip.y.signum();
        let below =
            body.rotation * (hip + Vector3::new(0.0, leg.lateral_m() + outward * p.width_offset_m, 0.0));
        let expected = p.velocity_follow * body.velocity + (1.0 - p.velocity_follow) * self.aimed;
        let stance_s = p.duty * p.period_s;
        let offset = if hip.x > 0.0 { p.fore_offset_m } else { p.hind_offset_m };
        let turn = f64::from(command.velocity[2]) * (left_s + 0.5 * stance_s);
        let travel = expected * (left_s + p.step_ahead * stance_s)
            + (body.velocity - self.aimed) * p.step_velocity_gain_s;
        Vector2::new(
            below.x + travel.x + offset - p.slope_shift * body.line.slope * p.base_height_m - turn * below.y,
            below.y + travel.y + turn * below.x,
        )
    }

    #[allow(clippy::too_many_arguments, reason = "one leg's share of a tick, named")]
    fn drive(
        &mut self,
        index: usize,
        body: &Body,
        foot: &FootPose,
        target: &Vector3<f64>,
        standing: bool,
        force: &Vector3<f64>,
        joints: &mut [JointTarget],
    ) {
        let p = &self.parameters;
        let leg = &self.legs[index];
        let start = if self.states[index].joints.iter().all(|value| value.is_finite()) {
            self.states[index].joints
        } else {
            leg.stand
        };
        let q = leg.inverse(target, &start);
        self.states[index].joints = q;
        let gravity = body.rotation.inverse() * Vector3::new(0.0, 0.0, -GRAVITY_M_PER_S2);
        let mut torque = -foot.mass_jacobian.tr_mul(&gravity);
        if standing {
            torque -= foot.jacobian.tr_mul(&(body.rotation.inverse() * force));
        }
        let (stiffness, damping) = if standing {
            (p.stance_stiffness, p.stance_damping)
        } else {
            (p.swing_stiffness, p.swing_damping)
        };
        for (place, &joint) in leg.joints.iter().enumerate() {
            joints[joint] = JointTarget {
                position_rad: q[place] as f32,
                stiffness_nm_per_rad: stiffness as f32,
                damping_nms_per_rad: damping as f32,
                feed_forward_nm: torque[place].clamp(-80.0, 80.0) as f32,
            };
        }
    }
}

fn fraction(value: f64) -> f64 {
    value - value.floor()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_robot::quadruped;

    /// Height of a foot's target below where the foot is measured, after some ticks in the stand on
    /// ground 5 cm below it, with contact on every foot but, from the third tick on, the first.
    fn lowered_m(contact_is_lost: bool) -> f64 {
        let robot = quadruped();
        let mut gait = Gait::create("", &robot, Host::default()).unwrap();
        let stand: Vec<f32> = robot.joints.iter().map(|joint| joint.stand_rad as f32).collect();
        let still = vec![0.0; stand.len()];
        let q = |leg: &Leg| leg.joints.map(|joint| f64::from(stand[joint])).into();
        let foot_m = gait.legs[0].pose(&q(&gait.legs[0])).position.z;
        let terrain_m =
            vec![(foot_m - gait.legs[0].foot_radius_m - 0.05) as f32; PATCH.rows() * PATCH.columns()];
        let mut joints = vec![JointTarget::default(); stand.len()];
        for tick in 0..8 {
            let foot_contact = [u8::from(tick < 3 || !contact_is_lost), 1, 1, 1];
            let state = RobotState {
                time_s: f64::from(tick) * TICK_S,
                joint_position_rad: stand.as_slice().into(),
                joint_velocity_rad_per_s: still.as_slice().into(),
                joint_torque_nm: [].as_slice().into(),
                base_linear_velocity_m_per_s: [0.0; 3],
                base_angular_velocity_rad_per_s: [0.0; 3],
                projected_gravity: [0.0, 0.0, -1.0],
                foot_contact: foot_contact.as_slice().into(),
                terrain_m: terrain_m.as_slice().into(),
            };
            if tick == 0 {
                gait.reset(&state).unwrap();
            }
            gait.act(&state, &Command::velocity(0.0, 0.0, 0.0), &mut joints).unwrap();
        }
        let target = gait.legs[0].joints.map(|joint| f64::from(joints[joint].position_rad)).into();
        foot_m - gait.legs[0].pose(&target).position.z
    }

    /// A foot that slipped off an edge once stood on in the air, and the robot fell over that leg.
    #[test]
    fn a_standing_foot_that_loses_the_ground_looks_for_it_again() {
        let (kept, lost) = (lowered_m(false), lowered_m(true));
        assert!(lost > kept + 0.02, "lowered by {lost} m without contact, {kept} m with it");
    }
}
