//! Inequalities on the velocities, solved one after the other until they agree.

use rapier3d::math::Vector;

use super::{BASE_DOFS, Motion, Pressing, contact::Contact, inertia::Inertia, tree::Tree};

/// Natural frequency, Hz, and damping ratio at which the ground pushes out what is too deep.
const CONTACT_HZ: f32 = 60.0;
const CONTACT_DAMPING: f32 = 10.0;
/// Nothing is pushed out faster, m/s.
const PUSH_OUT_M_PER_S: f32 = 3.0;
/// A range is a row from this far before it, rad.
const RANGE_MARGIN_RAD: f32 = 0.05;

/// All rows of a substep.
///
/// ```text
/// normal:   J·u ≥ −b,  λ ≥ 0        b = d/Δt ahead of touching, else soft; 0 in the sweeps without pull
/// friction: J·u → 0,   |λ_t| ≤ µ·λ_n   in both tangents together
/// ```
#[derive(Clone)]
pub(super) struct Rows {
    dofs: usize,
    /// `[row][degree of freedom]`.
    jacobian: Vec<f32>,
    /// `M⁻¹·Jᵀ`, likewise.
    response: Vec<f32>,
    all: Vec<Row>,
    contacts: Vec<Touch>,
}

#[derive(Clone, Copy)]
struct Row {
    /// 1/(J·M⁻¹·Jᵀ).
    mass: f32,
    /// With and without pull, m/s.
    bias: [f32; 2],
    /// Factor on the impulse in the sweeps with pull.
    softness: f32,
    impulse: f32,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    /// Pushes alone.
    Push,
    /// The first of two tangents; the normal's row and the coefficient.
    Friction { normal: usize, coefficient: f32 },
    /// Solved with the row before it.
    SecondTangent,
}

#[derive(Clone, Copy)]
struct Touch {
    pair: [u32; 2],
    row: usize,
    normal_z: f32,
    tangents: [Vector; 2],
}

impl Rows {
    pub(super) fn new(dofs: usize) -> Self {
        Self { dofs, jacobian: Vec::new(), response: Vec::new(), all: Vec::new(), contacts: Vec::new() }
    }

    pub(super) fn start(&mut self) {
        self.jacobian.clear();
        self.response.clear();
        self.all.clear();
        self.contacts.clear();
    }

    /// Joints at the ends of their ranges.
    pub(super) fn add_ranges(&mut self, tree: &Tree, inertia: &Inertia, motion: &Motion, dt: f32) {
        for (index, joint) in tree.joints.iter().enumerate() {
            let position = motion.joint_position_rad[index];
            let reach = RANGE_MARGIN_RAD + motion.velocity[BASE_DOFS + index].abs() * dt;
            for (sign, left_rad) in
                [(1.0, position - joint.range_rad[0]), (-1.0, joint.range_rad[1] - position)]
            {
                if left_rad < reach {
                    let row = self.push_row();
                    row[BASE_DOFS + index] = sign;
                    let ahead = left_rad.max(0.0) / dt;
                    self.finish_row(inertia, [left_rad / dt, ahead], 1.0, Kind::Push);
                }
            }
        }
    }

    /// A normal and two tangents, begun with what the pair pressed before.
    pub(super) fn add_contact(
        &mut self,
        tree: &Tree,
        inertia: &Inertia,
        contact: Contact,
        motion: &Motion,
        dt: f32,
    ) {
        let frequency = std::f32::consts::TAU * CONTACT_HZ;
        let pull_per_s = frequency / (dt * frequency + 2.0 * CONTACT_DAMPING);
        let erp = dt * pull_per_s;
        let left = 1.0 / erp - 1.0;
        let compliance = left * left / ((1.0 + left) * 4.0 * CONTACT_DAMPING * CONTACT_DAMPING);
        let distance = contact.distance_m;
        let (bias, softness) = if distance > 0.0 {
            ([distance / dt; 2], 1.0)
        } else {
            ([(distance * pull_per_s).max(-PUSH_OUT_M_PER_S), 0.0], 1.0 / (1.0 + compliance))
        };
        let normal = self.all.len();
        let first = contact.normal.any_orthonormal_vector();
        let tangents = [first, contact.normal.cross(first)];
        self.push_along(tree, &contact, contact.normal);
        self.finish_row(inertia, bias, softness, Kind::Push);
        let friction = Kind::Friction { normal, coefficient: contact.friction };
        for (tangent, kind) in tangents.into_iter().zip([friction, Kind::SecondTangent]) {
            self.push_along(tree, &contact, tangent);
            self.finish_row(inertia, [0.0; 2], 1.0, kind);
        }
        if let Some(before) = motion.pressing.iter().find(|pressing| pressing.pair == contact.pair) {
            self.all[normal].impulse = before.normal_ns;
            for (offset, tangent) in tangents.iter().enumerate() {
                self.all[normal + 1 + offset].impulse = before.friction_ns.dot(*tangent);
            }
        }
        self.contacts.push(Touch { pair: contact.pair, row: normal, normal_z: contact.normal.z, tangents });
    }

    fn push_row(&mut self) -> &mut [f32] {
        let from = self.jacobian.len();
        self.jacobian.resize(from + self.dofs, 0.0);
        &mut self.jacobian[from..]
    }

    /// Velocity of side 2 against side 1 at the point, along a direction.
    fn push_along(&mut self, tree: &Tree, contact: &Contact, direction: Vector) {
        let row = self.push_row();
        let moment = contact.point.cross(direction);
        for (link, sign) in contact.links.into_iter().zip([-1.0, 1.0]) {
            let Some(link) = link else { continue };
            for axis in 0..3 {
                row[axis] += sign * direction[axis];
                row[3 + axis] += sign * moment[axis];
            }
            for joint in &tree.path[link] {
                let placed = &tree.placed[joint + 1];
                let arm = contact.point - placed.origin;
                row[BASE_DOFS + joint] += sign * placed.axis.cross(arm).dot(direction);
            }
        }
    }

    fn finish_row(&mut self, inertia: &Inertia, bias: [f32; 2], softness: f32, kind: Kind) {
        let from = self.response.len();
        self.response.extend_from_slice(&self.jacobian[from..]);
        inertia.solve(&mut self.response[from..]);
        let effect = dot(&self.jacobian[from..], &self.response[from..]);
        let mass = if effect > 1e-9 { 1.0 / effect } else { 0.0 };
        self.all.push(Row { mass, bias, softness, impulse: 0.0, kind });
    }

    /// Applies what the rows were begun with.
    pub(super) fn warm_start(&self, velocity: &mut [f32]) {
        for (row, response) in self.all.iter().zip(self.response.chunks_exact(self.dofs)) {
            if row.impulse != 0.0 {
                add(velocity, response, row.impulse);
            }
        }
    }

    /// Each row once.
    pub(super) fn sweep(&mut self, velocity: &mut [f32], pulled: bool) {
        let dofs = self.dofs;
        let span = |row: usize| row * dofs..(row + 1) * dofs;
        for index in 0..self.all.len() {
            let row = self.all[index];
            let relative = |velocity: &[f32], row: usize| dot(&self.jacobian[span(row)], velocity);
            match row.kind {
                Kind::Push => {
                    let (bias, softness) =
                        if pulled { (row.bias[0], row.softness) } else { (row.bias[1], 1.0) };
                    let asked = row.impulse - row.mass * (relative(velocity, index) + bias);
                    let impulse = (softness * asked).max(0.0);
                    add(velocity, &self.response[span(index)], impulse - row.impulse);
                    self.all[index].impulse = impulse;
                }
                Kind::Friction { normal, coefficient } => {
                    let second = self.all[index + 1];
                    let asked = [
                        row.impulse - row.mass * relative(velocity, index),
                        second.impulse - second.mass * relative(velocity, index + 1),
                    ];
                    let length = (asked[0] * asked[0] + asked[1] * asked[1]).sqrt();
                    let bound = coefficient * self.all[normal].impulse;
                    let share = if length > bound { bound / length } else { 1.0 };
                    for (offset, asked) in asked.into_iter().enumerate() {
                        let impulse = asked * share;
                        let change = impulse - self.all[index + offset].impulse;
                        add(velocity, &self.response[span(index + offset)], change);
                        self.all[index + offset].impulse = impulse;
                    }
                }
                Kind::SecondTangent => {}
            }
        }
    }

    /// Notes what presses now.
    pub(super) fn keep(&self, pressing: &mut Vec<Pressing>) {
        pressing.clear();
        for touch in &self.contacts {
            let impulse = |offset: usize| self.all[touch.row + offset].impulse;
            if impulse(0) > 0.0 {
                pressing.push(Pressing {
                    pair: touch.pair,
                    normal_ns: impulse(0),
                    normal_z: touch.normal_z,
                    friction_ns: touch.tangents[0] * impulse(1) + touch.tangents[1] * impulse(2),
                });
            }
        }
    }
}

/// Four sums side by side: one sum alone waits for each addition.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let (a_fours, a_rest) = a.as_chunks::<4>();
    let (b_fours, b_rest) = b.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for (a, b) in a_fours.iter().zip(b_fours) {
        for lane in 0..4 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

fn add(to: &mut [f32], direction: &[f32], times: f32) {
    for (to, direction) in to.iter_mut().zip(direction) {
        *to += times * direction;
    }
}
