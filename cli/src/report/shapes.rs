//! What stands still in the page's pictures: the ground of a course and the robot's body as boxes.

use vocaloco_core::robot::{RobotModel, Role, ShapeKind};
use vocaloco_sim::{
    plant::BasePose,
    terrain::{Solid, Terrain},
};

/// The box around all of the base's shapes.
pub(super) fn base_boxes(robot: &RobotModel) -> Vec<[[f64; 3]; 2]> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    let shapes = robot.links.iter().flat_map(|link| &link.shapes).filter(|shape| shape.role == Role::Base);
    for shape in shapes {
        let turned = BasePose {
            position_m: [0.0; 3],
            orientation_xyzw: shape.orientation_in_link_xyzw.map(|part| part as f32),
        };
        let along = |axis: [f32; 3]| turned.vector_in_world(axis).map(|part| f64::from(part.abs()));
        let (x, y, z) = (along([1.0, 0.0, 0.0]), along([0.0, 1.0, 0.0]), along([0.0, 0.0, 1.0]));
        for axis in 0..3 {
            let half = match shape.kind {
                ShapeKind::Sphere { radius_m } => radius_m,
                ShapeKind::Capsule { radius_m, half_length_m } => z[axis] * half_length_m + radius_m,
                ShapeKind::Cylinder { radius_m, half_length_m } => {
                    z[axis] * half_length_m + (x[axis] + y[axis]) * radius_m
                }
                ShapeKind::Box { half_extents_m: [a, b, c] } => x[axis] * a + y[axis] * b + z[axis] * c,
            };
            low[axis] = low[axis].min(shape.centre_in_link_m[axis] - half);
            high[axis] = high[axis].max(shape.centre_in_link_m[axis] + half);
        }
    }
    if low[0] > high[0] {
        return Vec::new();
    }
    let at = |f: fn(f64, f64) -> f64| [0, 1, 2].map(|axis| f(low[axis], high[axis]));
    vec![[at(|low, high| 0.5 * (low + high)), at(|low, high| 0.5 * (high - low))]]
}

/// The ground as boxes side by side along x, each of one height: courses do not vary across, and
/// boxes that overlap could not be painted back to front.
pub(super) fn strips(terrain: &Terrain) -> Vec<[f32; 6]> {
    let [[low_x, low_y], [high_x, high_y]] = [terrain.min_m, terrain.max_m];
    let mut edges_m = vec![low_x, high_x];
    for solid in &terrain.solids {
        if let Solid::Box { centre_m, half_extents_m } = solid {
            edges_m.extend([centre_m[0] - half_extents_m[0], centre_m[0] + half_extents_m[0]]);
        }
    }
    edges_m.retain(|x| (low_x..=high_x).contains(x));
    edges_m.sort_by(f32::total_cmp);
    edges_m.dedup_by(|a, b| (*a - *b).abs() < 1e-4);
    let middle_y = 0.5 * (low_y + high_y);
    let height_m = |pair: &[f32]| terrain.height_m(0.5 * (pair[0] + pair[1]), middle_y);
    let floor_m = edges_m.windows(2).map(height_m).fold(f32::INFINITY, f32::min) - 0.5;
    edges_m
        .windows(2)
        .map(|pair| {
            let half_z = 0.5 * (height_m(pair) - floor_m);
            let centre = [0.5 * (pair[0] + pair[1]), middle_y, floor_m + half_z];
            let half = [0.5 * (pair[1] - pair[0]), 0.5 * (high_y - low_y), half_z];
            [centre[0], centre[1], centre[2], half[0], half[1], half[2]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use vocaloco_sim::terrain::CourseKind;

    use super::*;

    #[test]
    fn strips_have_the_ground_of_the_course_and_do_not_overlap() {
        for kind in CourseKind::ALL {
            let terrain = Terrain::course(kind, 0.12, 3);
            let strips = strips(&terrain);
            let edges = match kind {
                CourseKind::StairsUp | CourseKind::StairsDown => 3,
                CourseKind::Mixed => 6,
                CourseKind::Obstacles => 6 + 1 + 2,
            };
            assert_eq!(strips.len(), edges + 1, "{kind:?}: every edge parts two levels");
            for pair in strips.windows(2) {
                let gap_m = (pair[1][0] - pair[1][3]) - (pair[0][0] + pair[0][3]);
                assert!(gap_m.abs() < 1e-4, "{kind:?}: {gap_m} m apart");
            }
            for [x, y, z, _, _, half_z] in strips {
                assert!((terrain.height_m(x, y) - (z + half_z)).abs() < 1e-5, "{kind:?} at x {x} m");
            }
        }
    }

    #[test]
    fn the_box_around_the_base_holds_its_rounded_edges() {
        let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../manifests/robots");
        let boxes = base_boxes(&RobotModel::load(&robots, "anymal_d").unwrap());
        let [centre, half] = boxes[0];
        for (found, wanted) in centre.iter().chain(&half).zip([0.0, 0.0, 0.0, 0.447, 0.14, 0.128]) {
            assert!((found - wanted).abs() < 1e-6, "{found} for {wanted}");
        }
    }
}
