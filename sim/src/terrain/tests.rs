use super::*;
use crate::stream::{stream, uniform};
use rapier3d::{math::Vector, parry::query::Ray};
use vocaloco_core::heightfield::{CENTRE, COLUMNS};

/// Height of the highest hit of a ray from far above, over all the shapes the physics gets.
fn ray_height_m(terrain: &Terrain, x_m: f32, y_m: f32) -> Option<f32> {
    let ray = Ray::new(Vector::new(x_m, y_m, 20.0), Vector::new(0.0, 0.0, -1.0));
    let hits = terrain.solids.iter().filter_map(|solid| {
        let (shape, pose) = solid.shape();
        shape.cast_ray(&pose, &ray, 40.0, true).map(|distance_m| 20.0 - distance_m)
    });
    hits.reduce(f32::max)
}

fn at(x_m: f32, y_m: f32, yaw_rad: f32) -> Vantage {
    Vantage { position_m: [x_m, y_m, 0.5], yaw_rad }
}

#[test]
fn height_matches_the_collider() {
    for (kind, size_m) in [
        (TerrainKind::Flat, 0.0),
        (TerrainKind::Rough, 0.15),
        (TerrainKind::Slope, 0.37),
        (TerrainKind::Discrete, 0.23),
        (TerrainKind::StairsUp, 0.17),
        (TerrainKind::StairsDown, 0.17),
        (TerrainKind::Wall, 0.5),
        (TerrainKind::Gap, 0.45),
    ] {
        let terrain = Terrain::tile(kind, size_m, 5);
        let mut rng = stream(1, "points", &[kind as u64]);
        let mut slipped = 0;
        for n in 0..2000 {
            let x_m = uniform(&mut rng, terrain.min_m[0], terrain.max_m[0]);
            let y_m = uniform(&mut rng, terrain.min_m[1], terrain.max_m[1]);
            let height_m = terrain.height_m(x_m, y_m);
            // Rays slip through the seams of parry's heightfields now and then.
            let Some(hit_m) = ray_height_m(&terrain, x_m, y_m) else {
                slipped += 1;
                continue;
            };
            assert!(
                (height_m - hit_m).abs() < 1e-4,
                "{kind} point {n} ({x_m}, {y_m}): height_m {height_m}, ray {hit_m}"
            );
        }
        assert!(slipped <= 2, "{kind}: {slipped} of 2000 rays met nothing");
    }
}

#[test]
fn the_lookup_finds_the_highest_of_all_solids() {
    for (kind, size_m) in
        [(TerrainKind::Discrete, 0.2), (TerrainKind::StairsDown, 0.1), (TerrainKind::Gap, 0.3)]
    {
        let terrain = Terrain::tile(kind, size_m, 8);
        let mut rng = stream(2, "points", &[kind as u64]);
        for n in 0..5000 {
            let x_m = uniform(&mut rng, terrain.min_m[0], terrain.max_m[0]);
            let y_m = uniform(&mut rng, terrain.min_m[1], terrain.max_m[1]);
            let highest_m =
                terrain.solids.iter().map(|solid| solid.height_m(x_m, y_m)).fold(f32::NEG_INFINITY, f32::max);
            assert_eq!(terrain.height_m(x_m, y_m), highest_m, "{kind} point {n} ({x_m}, {y_m})");
        }
    }
}

#[test]
fn a_gap_is_not_read_as_a_wall() {
    let gap = Terrain::tile(TerrainKind::Gap, 0.5, 0);
    // Base 1 m before the edge at x = 1.8 m: the gap spans 1.0 to 1.5 m ahead, rows 20 to 25.
    let field = gap.heightfield(&at(0.8, 0.0, 0.0)).prepare(None).unwrap();
    let cell = |row: usize| field.as_slice()[row * COLUMNS + CENTRE[1]];
    assert_eq!([cell(19), cell(26)], [0.0, 0.0], "the ground before and behind");
    for row in 21..25 {
        assert_eq!(cell(row), -1.0, "row {row} is a hole, clipped at 1 m down");
    }
    assert!(field.as_slice().iter().all(|h| *h <= 0.0), "nothing stands up");
}

#[test]
fn outside_the_map_is_unknown() {
    let course = Terrain::course(CourseKind::StairsUp, 0.1, 6);
    assert!(course.height_m(-0.01, 0.0).is_nan());
    assert!(course.height_m(1.0, 2.01).is_nan());
    assert!(course.height_m(f32::NAN, 0.0).is_nan());
    // 0.35 m from the start, the rear 65 cm of the field (rows 0 to 6) hang over the edge.
    let field = course.heightfield(&at(0.35, 0.0, 0.0));
    for row in 0..10 {
        assert_eq!(field.cells_m[row][5].is_nan(), row <= 6, "row {row}");
    }
}

#[test]
fn stairs_have_the_stated_rise_and_tread() {
    let rise_m = 0.12;
    let up = Terrain::course(CourseKind::StairsUp, rise_m, 3);
    let down = Terrain::course(CourseKind::StairsDown, rise_m, 3);
    assert!((up.max_m[0] - (6.0 + 3.0 * 0.31)).abs() < 1e-5);
    for step in 0..=3 {
        let middle_of_tread = if step == 0 { 1.5 } else { 3.0 + (step as f32 - 0.5) * 0.31 };
        let x_m = if step == 3 { 5.0 } else { middle_of_tread };
        assert!((up.height_m(x_m, 1.0) - step as f32 * rise_m).abs() < 1e-5, "up, step {step}");
        assert!((down.height_m(x_m, 1.0) - (3 - step) as f32 * rise_m).abs() < 1e-5, "down, step {step}");
    }
    // The first riser stands at 3 m.
    assert!(up.height_m(2.999, 0.0).abs() < 1e-5 && (up.height_m(3.001, 0.0) - rise_m).abs() < 1e-5);
    let tile = Terrain::tile(TerrainKind::StairsUp, 0.2, 0);
    assert!((tile.height_m(7.0, 0.0) - 1.6).abs() < 1e-5, "eight steps of 20 cm");
}

#[test]
fn the_field_looks_ahead_along_the_yaw_and_left_is_left() {
    let wall = Terrain::tile(TerrainKind::Wall, 0.3, 0);
    // Facing +y, the wall (x ≥ 1.8) is to the right: columns run from left to right.
    let field = wall.heightfield(&at(1.5, 0.0, std::f32::consts::FRAC_PI_2));
    assert!((field.cells_m[10][10] - -0.2).abs() < 1e-5, "right: {}", field.cells_m[10][10]);
    assert!((field.cells_m[10][0] - -0.5).abs() < 1e-5, "left: {}", field.cells_m[10][0]);
    // Facing +x it is ahead.
    let field = wall.heightfield(&at(0.8, 0.0, 0.0));
    assert!((field.cells_m[25][5] - -0.2).abs() < 1e-5);
    assert!((field.cells_m[5][5] - -0.5).abs() < 1e-5);
}

#[test]
fn an_elevation_gives_the_same_field_as_the_terrain() {
    let terrain = Terrain::tile(TerrainKind::StairsUp, 0.15, 0);
    let from = at(2.2, 0.3, 0.2);
    let extents = vocaloco_plugin_api::TerrainPatch {
        back_m: 1.2,
        front_m: 2.2,
        half_width_m: 0.7,
        resolution_m: 0.05,
    };
    let sampled = terrain.elevation(&from, &extents, 0.0).heightfield().unwrap();
    let direct = terrain.heightfield(&from);
    let differing = (sampled.cells_m.as_flattened().iter().zip(direct.cells_m.as_flattened()))
        .filter(|(a, b)| (*a - *b).abs() > 1e-6)
        .count();
    // Only a point within rounding of an edge may fall on the other side of it.
    assert!(differing <= 2, "{differing} cells differ");
}

#[test]
fn a_tile_repeats_and_another_seed_differs() {
    for kind in [TerrainKind::Rough, TerrainKind::Discrete] {
        let tile = |seed| Terrain::tile(kind, 0.1, seed).solids;
        assert_eq!(tile(3), tile(3), "{kind}");
        assert_ne!(tile(3), tile(4), "{kind}");
    }
}

#[test]
fn every_field_of_a_long_rollout_from_a_spawn_pose_is_known() {
    for kind in TerrainKind::ALL {
        let terrain = Terrain::tile(kind, kind.size_m(1.0), 2);
        for corner in 0..4 {
            let x_m = [terrain.spawn_min_m[0], terrain.spawn_max_m[0]][corner % 2];
            let y_m = [terrain.spawn_min_m[1], terrain.spawn_max_m[1]][corner / 2];
            for eighth in 0..8 {
                let yaw_rad = eighth as f32 * std::f32::consts::FRAC_PI_4;
                let ahead_m = 1.5;
                let end =
                    at(x_m + ahead_m * libm::cosf(yaw_rad), y_m + ahead_m * libm::sinf(yaw_rad), yaw_rad);
                assert_eq!(terrain.heightfield(&end).unknown_cells(), 0, "{kind} {end:?}");
            }
        }
    }
}

#[test]
fn ids_and_difficulties_go_back_and_forth() {
    for kind in TerrainKind::ALL {
        assert_eq!(TerrainKind::from_id(kind.id()), Some(kind));
        if kind != TerrainKind::Flat {
            assert!((kind.difficulty(kind.size_m(0.3)) - 0.3).abs() < 1e-6);
        }
    }
    assert_eq!(TerrainKind::from_id("lava"), None);
    let json = serde_json::to_string(&TerrainKind::StairsUp).unwrap();
    assert_eq!(json, "\"stairs_up\"");
}
