//! The mass matrix by composite inertias, factored along the tree, and the forces of motion.

use rapier3d::math::{Matrix, Vector};

use super::{BASE_DOFS, GRAVITY_M_PER_S2, Motion, tree::Tree};

/// Mass matrix `M = Lᵀ·L` and generalised bias force `h`; everything about the base's origin.
///
/// # Source
/// Featherstone, *Rigid Body Dynamics Algorithms* (2008): composite inertias, section 6.2; the factor
/// that keeps the tree's zeros, section 6.5.
#[derive(Clone)]
pub(super) struct Inertia {
    dofs: usize,
    /// `[row][column]`, the lower triangle; the factor L after [`assemble`](Self::assemble).
    factor: Vec<f32>,
    inverse_diagonal: Vec<f32>,
    /// By degree of freedom, the others that its row reaches, ascending.
    ancestors: Vec<Vec<usize>>,
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
        let dofs = tree.dofs();
        let mut ancestors: Vec<Vec<usize>> = (0..BASE_DOFS).map(|dof| (0..dof).collect()).collect();
        for path in &tree.path[1..] {
            let before = &path[..path.len() - 1];
            ancestors.push((0..BASE_DOFS).chain(before.iter().map(|joint| BASE_DOFS + joint)).collect());
        }
        Self {
            dofs,
            factor: vec![0.0; dofs * dofs],
            inverse_diagonal: vec![0.0; dofs],
            ancestors,
            composite: vec![Composite::default(); tree.bodies.len()],
            moving: vec![Moving::default(); tree.bodies.len()],
            acceleration: vec![0.0; dofs],
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
        let dofs = self.dofs;
        let Composite { mass, moment, inertia, .. } = self.composite[0];
        let m = &mut self.factor;
        for axis in 0..3 {
            m[axis * dofs..axis * dofs + 3].fill(0.0);
            m[axis * dofs + axis] = mass;
            let row = (3 + axis) * dofs;
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
            let row = (BASE_DOFS + joint) * dofs;
            m[row..row + 3].copy_from_slice(&momentum.to_array());
            m[row + 3..row + 6].copy_from_slice(&spin.to_array());
            for before in &tree.path[link] {
                let (angular, linear) = subspace(tree, *before);
                m[row + BASE_DOFS + before] = linear.dot(momentum) + angular.dot(spin);
            }
            m[row + BASE_DOFS + joint] += tree.bodies[link].armature_kg_m2;
        }
    }

    fn factorise(&mut self) {
        let dofs = self.dofs;
        for k in (0..dofs).rev() {
            let (above, row) = self.factor.split_at_mut(k * dofs);
            let diagonal = row[k].sqrt();
            let inverse = 1.0 / diagonal;
            self.inverse_diagonal[k] = inverse;
            row[k] = diagonal;
            let ancestors = &self.ancestors[k];
            for i in ancestors {
                row[*i] *= inverse;
            }
            for (position, i) in ancestors.iter().enumerate() {
                let share = row[*i];
                for j in &ancestors[..=position] {
                    above[i * dofs + j] -= share * row[*j];
                }
            }
        }
    }

    /// Turns `b` into `M⁻¹·b`.
    pub(super) fn solve(&self, b: &mut [f32]) {
        for k in (0..self.dofs).rev() {
            let value = b[k] * self.inverse_diagonal[k];
            b[k] = value;
            // A row that no contact reaches stays zero.
            if value != 0.0 {
                let row = &self.factor[k * self.dofs..];
                for i in &self.ancestors[k] {
                    b[*i] -= row[*i] * value;
                }
            }
        }
        for k in 0..self.dofs {
            let row = &self.factor[k * self.dofs..];
            let known: f32 = self.ancestors[k].iter().map(|i| row[*i] * b[*i]).sum();
            b[k] = (b[k] - known) * self.inverse_diagonal[k];
        }
    }

    /// ½·uᵀ·M·u.
    #[cfg(test)]
    pub(super) fn kinetic_energy_j(&self, velocity: &[f32]) -> f32 {
        let through_factor = |row: usize| -> f32 {
            let reached = self.ancestors[row].iter().chain([&row]);
            reached.map(|column| self.factor[row * self.dofs + column] * velocity[*column]).sum()
        };
        (0..self.dofs).map(|row| 0.5 * through_factor(row).powi(2)).sum()
    }

    /// Adds what torques, gravity and motion do to the velocity in `dt`, nothing touched.
    pub(super) fn accelerate(&mut self, tree: &Tree, motion: &mut Motion, torque_nm: &[f32], dt: f32) {
        let mut acceleration = std::mem::take(&mut self.acceleration);
        let base = self.composite[0];
        acceleration[..3].copy_from_slice(&(-base.force).to_array());
        acceleration[3..BASE_DOFS].copy_from_slice(&(-base.torque).to_array());
        for (joint, torque) in torque_nm.iter().enumerate() {
            let Composite { force, torque: spin, .. } = self.composite[joint + 1];
            let (angular, linear) = subspace(tree, joint);
            acceleration[BASE_DOFS + joint] = torque - linear.dot(force) - angular.dot(spin);
        }
        self.solve(&mut acceleration);
        for (velocity, acceleration) in motion.velocity.iter_mut().zip(&acceleration) {
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
