//! Inequalities on the velocities, solved one after the other until they agree.

use rapier3d::math::Vector;

use super::{
    BASE_DOFS, BASE_SLOTS, Motion, Pressing, add, contact::Contact, dot, inertia::Inertia, slots, tree::Tree,
};

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
///
/// Solved in coordinates in which the mass matrix `Lᵀ·L` is one:
///
/// ```text
/// W = J·L⁻¹,   J·u = J·u_free + W·z,   z = Wᵀ·λ,   u = u_free + L⁻¹·z
/// ```
#[derive(Clone)]
pub(super) struct Rows {
    slots: usize,
    /// `W`, `[row][slot]`.
    reach: Vec<f32>,
    /// `u_free`, by slot.
    free: Vec<f32>,
    /// `z`, by slot.
    change: Vec<f32>,
    moved: Vec<f32>,
    all: Vec<Row>,
    contacts: Vec<Touch>,
}

#[derive(Clone, Copy)]
struct Row {
    /// 1/(W·Wᵀ).
    mass: f32,
    /// `J·u_free`, m/s.
    speed: f32,
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
    pub(super) fn new(joints: usize) -> Self {
        let slots = slots(joints);
        Self {
            slots,
            reach: Vec::new(),
            free: vec![0.0; slots],
            change: vec![0.0; slots],
            moved: vec![0.0; slots],
            all: Vec::new(),
            contacts: Vec::new(),
        }
    }

    /// No rows yet, at a velocity by degree of freedom.
    pub(super) fn start(&mut self, velocity: &[f32]) {
        self.reach.clear();
        self.all.clear();
        self.contacts.clear();
        self.change.fill(0.0);
        let (base, joints) = velocity.split_at(BASE_DOFS);
        self.free[..BASE_DOFS].copy_from_slice(base);
        self.free[BASE_SLOTS..][..joints.len()].copy_from_slice(joints);
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
                    row[BASE_SLOTS + index] = sign;
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
        let from = self.reach.len();
        self.reach.resize(from + self.slots, 0.0);
        &mut self.reach[from..]
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
                row[BASE_SLOTS + joint] += sign * placed.axis.cross(arm).dot(direction);
            }
        }
    }

    /// Makes the last row of J one of W.
    fn finish_row(&mut self, inertia: &Inertia, bias: [f32; 2], softness: f32, kind: Kind) {
        let from = self.reach.len() - self.slots;
        let row = &mut self.reach[from..];
        let speed = dot(row, &self.free);
        inertia.solve_transposed(row);
        let effect = dot(row, row);
        let mass = if effect > 1e-9 { 1.0 / effect } else { 0.0 };
        self.all.push(Row { mass, speed, bias, softness, impulse: 0.0, kind });
    }

    /// Applies what the rows were begun with.
    pub(super) fn warm_start(&mut self) {
        for (row, reach) in self.all.iter().zip(self.reach.chunks_exact(self.slots)) {
            if row.impulse != 0.0 {
                add(&mut self.change, reach, row.impulse);
            }
        }
    }

    /// The velocity with the impulses so far, by degree of freedom.
    pub(super) fn write_velocity(&mut self, inertia: &Inertia, velocity: &mut [f32]) {
        self.moved.copy_from_slice(&self.change);
        inertia.solve(&mut self.moved);
        let (base, joints) = velocity.split_at_mut(BASE_DOFS);
        let write = |to: &mut [f32], from: usize| {
            for ((to, free), moved) in to.iter_mut().zip(&self.free[from..]).zip(&self.moved[from..]) {
                *to = free + moved;
            }
        };
        write(base, 0);
        write(joints, BASE_SLOTS);
    }

    /// Each row once.
    pub(super) fn sweep(&mut self, pulled: bool) {
        let Self { slots, reach, change, all, .. } = self;
        let reach = |row: usize| &reach[row * *slots..][..*slots];
        for index in 0..all.len() {
            let row = all[index];
            match row.kind {
                Kind::Push => {
                    let (bias, softness) =
                        if pulled { (row.bias[0], row.softness) } else { (row.bias[1], 1.0) };
                    let speed = row.speed + dot(reach(index), change);
                    let impulse = (softness * (row.impulse - row.mass * (speed + bias))).max(0.0);
                    add(change, reach(index), impulse - row.impulse);
                    all[index].impulse = impulse;
                }
                Kind::Friction { normal, coefficient } => {
                    let both = [row, all[index + 1]];
                    let asked = [0, 1].map(|offset| {
                        let Row { mass, speed, impulse, .. } = both[offset];
                        impulse - mass * (speed + dot(reach(index + offset), change))
                    });
                    let length = (asked[0] * asked[0] + asked[1] * asked[1]).sqrt();
                    let bound = coefficient * all[normal].impulse;
                    let share = if length > bound { bound / length } else { 1.0 };
                    for (offset, asked) in asked.into_iter().enumerate() {
                        let impulse = asked * share;
                        add(change, reach(index + offset), impulse - both[offset].impulse);
                        all[index + offset].impulse = impulse;
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
