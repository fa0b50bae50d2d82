//! The mass matrix by composite inertias, factored along the tree, and the forces of motion.

use rapier3d::math::{Matrix, Vector};

use super::{BASE_DOFS, BASE_SLOTS, GRAVITY_M_PER_S2, Motion, add, dot, slots, tree::Tree};

/// Mass matrix `M = Lᵀ·L` and generalised bias force `h`; everything about the base's origin.
///
/// Rows and columns are in slots: the base's degrees of freedom from 0 on, the joints from
/// [`BASE_SLOTS`] on, zeros between and behind them.
///
/// # Source
/// Featherstone, *Rigid Body Dynamics Algorithms* (2008): composite inertias, section 6.2; the factor
/// that keeps the tree's zeros, section 6.5.
#[derive(Clone)]
pub(super) struct Inertia {
    slots: usize,
    /// `[row][column]`, the lower triangle; the factor L after [`assemble`](Self::assemble).
    factor: Vec<f32>,
    /// The base's part of the factor below its diagonal, zeros elsewhere.
    base_factor: [[f32; BASE_SLOTS]; BASE_DOFS],
    inverse_diagonal: Vec<f32>,
    /// By joint, the slots of the joints between it and the base, ascending.
    before: Vec<Vec<usize>>,
    composite: Vec<Composite>,
    moving: Vec<Moving>,
    acceleration: Vec<f32>,
}

/// Mass, first moment and inertia about the base's origin of a link and all behind it, with the force
/// and moment that their motion takes.
#[derive(Clone, Copy, Default)]
struct Composite {
    mass: f32,
    moment: Vector,
    inertia: Matrix,
    force: Vector,
    torque: Vector,
}

/// Velocity, and acceleration while joints and base keep theirs, of a link's origin.
#[derive(Clone, Copy, Default)]
struct Moving {
    angular: Vector,
    angular_acceleration: Vector,
    acceleration: Vector,
}

impl Inertia {
    pub(super) fn for_tree(tree: &Tree) -> Self {
        let slots = slots(tree.joints.len());
        let before =
            |path: &Vec<usize>| path[..path.len() - 1].iter().map(|joint| BASE_SLOTS + joint).collect();
        Self {
            slots,
            factor: vec![0.0; slots * slots],
            base_factor: [[0.0; BASE_SLOTS]; BASE_DOFS],
            inverse_diagonal: vec![0.0; slots],
            before: tree.path[1..].iter().map(before).collect(),
            composite: vec![Composite::default(); tree.bodies.len()],
            moving: vec![Moving::default(); tree.bodies.len()],
            acceleration: vec![0.0; slots],
        }
    }

    /// Mass matrix, its factor and the bias force where the tree is now.
    pub(super) fn assemble(&mut self, tree: &Tree, motion: &Motion, base_mass_offset_kg: f32) {
        self.gather(tree, motion, base_mass_offset_kg);
        for link in (1..tree.bodies.len()).rev() {
            let behind = self.composite[link];
            let parent = &mut self.composite[tree.joints[link - 1].parent];
            parent.mass += behind.mass;
            parent.moment += behind.moment;
            parent.inertia += behind.inertia;
            parent.force += behind.force;
            parent.torque += behind.torque;
        }
        self.fill(tree);
        self.factorise();
    }

    /// Each link's own part, the base first.
    fn gather(&mut self, tree: &Tree, motion: &Motion, base_mass_offset_kg: f32) {
        let spin = &motion.velocity;
        for (link, body) in tree.bodies.iter().enumerate() {
            let placed = &tree.placed[link];
            let moving = if link == 0 {
                Moving { angular: Vector::new(spin[3], spin[4], spin[5]), ..Moving::default() }
            } else {
                let parent_link = tree.joints[link - 1].parent;
                let parent = self.moving[parent_link];
                let arm = placed.origin - tree.placed[parent_link].origin;
                let own = placed.axis * spin[BASE_DOFS + link - 1];
                Moving {
                    angular: parent.angular + own,
                    angular_acceleration: parent.angular_acceleration + parent.angular.cross(own),
                    acceleration: parent.acceleration
                        + parent.angular_acceleration.cross(arm)
                        + parent.angular.cross(parent.angular.cross(arm)),
                }
            };
            self.moving[link] = moving;
            let scale = if link == 0 { 1.0 + base_mass_offset_kg / body.mass_kg } else { 1.0 };
            let mass = body.mass_kg * scale;
            let arm = placed.axes * body.com_in_link;
            let com = placed.origin + arm;
            let about_com = placed.axes * (body.inertia * scale) * placed.axes.transpose();
            let acceleration = moving.acceleration
                + moving.angular_acceleration.cross(arm)
                + moving.angular.cross(moving.angular.cross(arm))
                + Vector::new(0.0, 0.0, GRAVITY_M_PER_S2);
            let force = acceleration * mass;
            let torque = about_com * moving.angular_acceleration
                + moving.angular.cross(about_com * moving.angular)
                + com.cross(force);
            let outer = Matrix::from_cols(com * com.x, com * com.y, com * com.z);
            let offset = Matrix::from_diagonal(Vector::splat(com.length_squared())) - outer;
            self.composite[link] =
                Composite { mass, moment: com * mass, inertia: about_com + offset * mass, force, torque };
        }
    }

    /// The lower triangle from the composites.
    fn fill(&mut self, tree: &Tree) {
        let slots = self.slots;
        let Composite { mass, moment, inertia, .. } = self.composite[0];
        let m = &mut self.factor;
        for axis in 0..3 {
            m[axis * slots..axis * slots + BASE_SLOTS].fill(0.0);
            m[axis * slots + axis] = mass;
            let row = (3 + axis) * slots;
            // Column k of h × v is h × e_k.
            let cross = [
                Vector::new(0.0, moment.z, -moment.y),
                Vector::new(-moment.z, 0.0, moment.x),
                Vector::new(moment.y, -moment.x, 0.0),
            ];
            for (column, cross) in cross.iter().enumerate() {
                m[row + column] = cross[axis];
                m[row + 3 + column] = inertia.col(column)[axis];
            }
        }
        for joint in 0..tree.joints.len() {
            let link = joint + 1;
            let Composite { mass, moment, inertia, .. } = self.composite[link];
            let (angular, linear) = subspace(tree, joint);
            let momentum = linear * mass + angular.cross(moment);
            let spin = inertia * angular + moment.cross(linear);
            let row = &mut m[(BASE_SLOTS + joint) * slots..][..slots];
            row[..3].copy_from_slice(&momentum.to_array());
            row[3..6].copy_from_slice(&spin.to_array());
            for before in &tree.path[link] {
                let (angular, linear) = subspace(tree, *before);
                row[BASE_SLOTS + before] = linear.dot(momentum) + angular.dot(spin);
            }
            row[BASE_SLOTS + joint] += tree.bodies[link].armature_kg_m2;
        }
    }

    /// Row by row from the last, each taken out of those that it reaches.
    fn factorise(&mut self) {
        let slots = self.slots;
        for (joint, before) in self.before.iter().enumerate().rev() {
            let slot = BASE_SLOTS + joint;
            let (above, row) = self.factor.split_at_mut(slot * slots);
            let row = &mut row[..slots];
            let inverse = 1.0 / row[slot].sqrt();
            self.inverse_diagonal[slot] = inverse;
            for value in &mut row[..BASE_SLOTS] {
                *value *= inverse;
            }
            for i in before {
                row[*i] *= inverse;
            }
            for (position, i) in before.iter().enumerate() {
                let share = row[*i];
                let other = &mut above[i * slots..][..slots];
                add(&mut other[..BASE_SLOTS], &row[..BASE_SLOTS], -share);
                for j in &before[..=position] {
                    other[*j] -= share * row[*j];
                }
            }
            for (i, share) in row[..BASE_DOFS].iter().enumerate() {
                add(&mut above[i * slots..][..BASE_SLOTS], &row[..BASE_SLOTS], -share);
            }
        }
        let mut base: [[f32; BASE_SLOTS]; BASE_DOFS] = [[0.0; BASE_SLOTS]; BASE_DOFS];
        for (k, row) in base.iter_mut().enumerate() {
            row[..=k].copy_from_slice(&self.factor[k * slots..][..=k]);
        }
        for k in (0..BASE_DOFS).rev() {
            let inverse = 1.0 / base[k][k].sqrt();
            self.inverse_diagonal[k] = inverse;
            let mut row = base[k].map(|value| value * inverse);
            row[k..].fill(0.0);
            base[k] = row;
            for i in 0..k {
                for j in 0..=i {
                    base[i][j] -= row[i] * row[j];
                }
            }
        }
        self.base_factor = base;
    }

    /// Turns `b` into `L⁻ᵀ·b`, by slot.
    pub(super) fn solve_transposed(&self, b: &mut [f32]) {
        let (base, joints) = b.split_at_mut(BASE_SLOTS);
        for joint in (0..self.before.len()).rev() {
            // A row that no contact reaches stays zero.
            if joints[joint] == 0.0 {
                continue;
            }
            let slot = BASE_SLOTS + joint;
            let value = joints[joint] * self.inverse_diagonal[slot];
            joints[joint] = value;
            let row = &self.factor[slot * self.slots..][..slot];
            add(base, &row[..BASE_SLOTS], -value);
            for i in &self.before[joint] {
                joints[i - BASE_SLOTS] -= row[*i] * value;
            }
        }
        for k in (0..BASE_DOFS).rev() {
            let value = base[k] * self.inverse_diagonal[k];
            base[k] = value;
            add(base, &self.base_factor[k], -value);
        }
    }

    /// Turns `b` into `L⁻¹·b`, by slot.
    pub(super) fn solve(&self, b: &mut [f32]) {
        let (base, joints) = b.split_at_mut(BASE_SLOTS);
        for k in 0..BASE_DOFS {
            let known: f32 = (0..k).map(|i| self.base_factor[k][i] * base[i]).sum();
            base[k] = (base[k] - known) * self.inverse_diagonal[k];
        }
        for (joint, before) in self.before.iter().enumerate() {
            let slot = BASE_SLOTS + joint;
            let row = &self.factor[slot * self.slots..][..slot];
            let mut known = dot(&row[..BASE_SLOTS], base);
            for i in before {
                known += row[*i] * joints[i - BASE_SLOTS];
            }
            joints[joint] = (joints[joint] - known) * self.inverse_diagonal[slot];
        }
    }

    /// ½·uᵀ·M·u.
    #[cfg(test)]
    pub(super) fn kinetic_energy_j(&self, velocity: &[f32]) -> f32 {
        let (base, joints) = velocity.split_at(BASE_DOFS);
        let through_base = |k: usize| -> f32 {
            let below: f32 = (0..k).map(|i| self.base_factor[k][i] * base[i]).sum();
            below + base[k] / self.inverse_diagonal[k]
        };
        let through_joint = |joint: usize| -> f32 {
            let row = &self.factor[(BASE_SLOTS + joint) * self.slots..];
            let reached = self.before[joint].iter().map(|i| row[*i] * joints[i - BASE_SLOTS]);
            let of_base: f32 = row.iter().zip(base).map(|(share, value)| share * value).sum();
            of_base + reached.sum::<f32>() + joints[joint] / self.inverse_diagonal[BASE_SLOTS + joint]
        };
        let rows = (0..BASE_DOFS).map(through_base).chain((0..joints.len()).map(through_joint));
        rows.map(|value| 0.5 * value.powi(2)).sum()
    }

    /// Adds what torques, gravity and motion do to the velocity in `dt`, nothing touched.
    pub(super) fn accelerate(&mut self, tree: &Tree, motion: &mut Motion, torque_nm: &[f32], dt: f32) {
        let mut acceleration = std::mem::take(&mut self.acceleration);
        let base = self.composite[0];
        acceleration.fill(0.0);
        acceleration[..3].copy_from_slice(&(-base.force).to_array());
        acceleration[3..BASE_DOFS].copy_from_slice(&(-base.torque).to_array());
        for (joint, torque) in torque_nm.iter().enumerate() {
            let Composite { force, torque: spin, .. } = self.composite[joint + 1];
            let (angular, linear) = subspace(tree, joint);
            acceleration[BASE_SLOTS + joint] = torque - linear.dot(force) - angular.dot(spin);
        }
        self.solve_transposed(&mut acceleration);
        self.solve(&mut acceleration);
        let (base, joints) = acceleration.split_at(BASE_SLOTS);
        let by_dof = base[..BASE_DOFS].iter().chain(joints);
        for (velocity, acceleration) in motion.velocity.iter_mut().zip(by_dof) {
            *velocity += acceleration * dt;
        }
        self.acceleration = acceleration;
    }
}

/// What a joint turning at 1 rad/s does to a body at the base's origin: rad/s and m/s.
fn subspace(tree: &Tree, joint: usize) -> (Vector, Vector) {
    let placed = &tree.placed[joint + 1];
    (placed.axis, placed.origin.cross(placed.axis))
}
