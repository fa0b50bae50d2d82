//! Contact forces for a wanted wrench on the body.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Regularisation: how much force and moment are given up where the feet can hardly provide them.
const FORCE_DAMPING: f64 = 0.01;
const MOMENT_DAMPING: f64 = 0.004;
/// Tangential per normal force, below the lowest friction that is trained for.
const FRICTION: f64 = 0.55;

/// Forces on the feet, one a foot, that together come nearest to `force` and `moment`.
///
/// ```text
/// f = W Aᵀ (A W Aᵀ + Λ)⁻¹ [force; moment],   A = [1 … 1; r₁× … r₄×]
/// ```
///
/// | argument | meaning | unit | frame |
/// |---|---|---|---|
/// | `feet` | contact points and their weights (0: carries nothing) | m, 1 | yaw-aligned, from the base origin |
/// | `force`, `moment` | wanted sum, moment about the base origin | N, N·m | yaw-aligned |
///
/// Each force is then clamped to push and to the friction cone.
pub(crate) fn distribute(
    feet: &[(Vector3<f64>, f64); 4],
    force: &Vector3<f64>,
    moment: &Vector3<f64>,
) -> [Vector3<f64>; 4] {
    let mut gram = Matrix6::<f64>::zeros();
    for (point, weight) in feet {
        let cross = point.cross_matrix();
        add(&mut gram, 0, 0, &(Matrix3::identity() * *weight));
        add(&mut gram, 0, 3, &(cross.transpose() * *weight));
        add(&mut gram, 3, 0, &(cross * *weight));
        add(&mut gram, 3, 3, &(cross * cross.transpose() * *weight));
    }
    for index in 0..3 {
        gram[(index, index)] += FORCE_DAMPING;
        gram[(index + 3, index + 3)] += MOMENT_DAMPING;
    }
    let wanted = Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
    let Some(cholesky) = gram.cholesky() else { return [Vector3::zeros(); 4] };
    let dual = cholesky.solve(&wanted);
    let (along, about) = (dual.fixed_rows::<3>(0).into_owned(), dual.fixed_rows::<3>(3).into_owned());
    feet.map(|(point, weight)| cone(weight * (along + point.cross_matrix().transpose() * about)))
}

fn add(gram: &mut Matrix6<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    let mut view = gram.fixed_view_mut::<3, 3>(row, column);
    view += block;
}

fn cone(force: Vector3<f64>) -> Vector3<f64> {
    let normal = force.z.max(0.0);
    let tangential = libm::hypot(force.x, force.y);
    let share = if tangential > FRICTION * normal { FRICTION * normal / tangential.max(1e-9) } else { 1.0 };
    Vector3::new(force.x * share, force.y * share, normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FEET: [(Vector3<f64>, f64); 4] = [
        (Vector3::new(0.36, 0.3, -0.5), 1.0),
        (Vector3::new(0.36, -0.3, -0.5), 1.0),
        (Vector3::new(-0.36, 0.3, -0.5), 1.0),
        (Vector3::new(-0.36, -0.3, -0.5), 1.0),
    ];

    #[test]
    fn forces_of_four_feet_add_up_to_the_wrench() {
        let (force, moment) = (Vector3::new(20.0, -10.0, 500.0), Vector3::new(5.0, -15.0, 3.0));
        let forces = distribute(&FEET, &force, &moment);
        let sum: Vector3<f64> = forces.iter().sum();
        let about: Vector3<f64> =
            FEET.iter().zip(&forces).map(|((point, _), force)| point.cross(force)).sum();
        assert!((sum - force).norm() < 0.02 * force.norm(), "{sum}");
        assert!((about - moment).norm() < 0.15 * moment.norm(), "{about}");
    }

    #[test]
    fn a_foot_in_the_air_carries_nothing_and_no_foot_pulls() {
        let mut feet = FEET;
        feet[2].1 = 0.0;
        let forces = distribute(&feet, &Vector3::new(0.0, 0.0, 500.0), &Vector3::new(0.0, 60.0, 0.0));
        assert_eq!(forces[2], Vector3::zeros());
        assert!(forces.iter().all(|force| force.z >= 0.0));
    }
}
