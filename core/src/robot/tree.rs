//! Brings the two files of a robot together.

use std::path::Path;

use mjcf_rs::glam::{DQuat, DVec3};
use vocaloco_plugin_api::{FootDescription, JointDescription, RobotDescription};

use super::mjcf::{Body, Hinge};
use super::{Link, RobotError, RobotModel, Role, Shape, ShapeKind, mjcf, settings};

pub(super) fn assemble(
    name: &str,
    settings: &settings::File,
    tree: &mjcf::File,
) -> Result<RobotModel, RobotError> {
    check_root(settings, tree)?;
    let joints = joints(settings, tree)?;
    let feet = feet(settings, tree)?;
    let links: Vec<Link> = tree.bodies.iter().map(|body| link(body, settings)).collect();
    let shape_names: Vec<&str> =
        links.iter().flat_map(|link| &link.shapes).map(|shape| shape.name.as_str()).collect();
    for base_shape in &settings.base_shapes {
        if !shape_names.contains(&base_shape.as_str()) {
            return Err(RobotError::field(
                &settings.path,
                "base_shapes",
                format!("{base_shape:?}"),
                format!("a geom of {}", tree.path.display()),
            ));
        }
    }
    let stand_height_m = stand_height_m(&joints, &feet);
    let file_name =
        |path: &Path| path.file_name().map_or_else(String::new, |file| file.to_string_lossy().into_owned());
    Ok(RobotModel {
        name: name.to_owned(),
        description: RobotDescription {
            name: name.into(),
            mass_kg: links.iter().map(|link| link.mass_kg).sum(),
            base_mass_kg: links[0].mass_kg,
            stand_height_m,
            joints: joints.into(),
            feet: feet.into(),
        },
        links,
        drive: settings.drive,
        stand: settings.stand,
        file_hashes: vec![
            (file_name(&tree.path), tree.sha256.clone()),
            (file_name(&settings.path), settings.sha256.clone()),
        ],
    })
}

fn check_root(settings: &settings::File, tree: &mjcf::File) -> Result<(), RobotError> {
    let roots: Vec<&Body> = tree.bodies.iter().filter(|body| body.parent.is_none()).collect();
    let [root] = roots.as_slice() else {
        let found = format!("{} bodies with a free joint", roots.len());
        return Err(RobotError::field(&tree.path, "worldbody", found, "one robot"));
    };
    if root.name != settings.base {
        return Err(RobotError::field(
            &settings.path,
            "base",
            format!("{:?}", settings.base),
            format!("{:?}, the root of {}", root.name, tree.path.display()),
        ));
    }
    // A free-root multibody of rapier behaves wrongly otherwise.
    if DVec3::from_array(root.com_in_link_m).length() > 0.0 {
        return Err(RobotError::field(
            &tree.path,
            format!("{}.inertial.pos", root.name),
            format!("{:?}", root.com_in_link_m),
            "0 0 0: the base's origin at its centre of mass",
        ));
    }
    Ok(())
}

fn hinge(body: &Body) -> Option<&Hinge> {
    body.hinge.as_ref()
}

fn joints(settings: &settings::File, tree: &mjcf::File) -> Result<Vec<JointDescription>, RobotError> {
    for name in settings.stand_position_rad.keys() {
        if !tree.bodies.iter().filter_map(hinge).any(|joint| &joint.name == name) {
            return Err(RobotError::field(
                &settings.path,
                "stand.position_rad",
                format!("{name:?}"),
                format!("a joint of {}", tree.path.display()),
            ));
        }
    }
    let mut joints = Vec::new();
    for body in &tree.bodies {
        let (Some(parent), Some(joint)) = (body.parent, hinge(body)) else { continue };
        let field = format!("stand.position_rad.{}", joint.name);
        let [lower_rad, upper_rad] = joint.range_rad;
        let stand_rad = *settings
            .stand_position_rad
            .get(&joint.name)
            .ok_or_else(|| RobotError::field(&settings.path, &field, "none", "a position, rad"))?;
        if !(lower_rad..=upper_rad).contains(&stand_rad) {
            return Err(RobotError::field(
                &settings.path,
                field,
                stand_rad.to_string(),
                format!("{lower_rad} to {upper_rad}"),
            ));
        }
        joints.push(JointDescription {
            name: joint.name.as_str().into(),
            // Joint i carries body i + 1, so the base's children get −1.
            parent: i32::try_from(parent).map_or(-1, |parent| parent - 1),
            origin_in_parent_m: body.origin_in_parent_m,
            axis: joint.axis,
            lower_rad,
            upper_rad,
            effort_nm: f64::from(settings.drive.effort_nm),
            velocity_limit_rad_per_s: f64::from(settings.drive.velocity_limit_rad_per_s),
            stand_rad,
            mass_kg: body.mass_kg,
            com_in_link_m: body.com_in_link_m,
        });
    }
    Ok(joints)
}

fn feet(settings: &settings::File, tree: &mjcf::File) -> Result<Vec<FootDescription>, RobotError> {
    settings
        .feet
        .iter()
        .map(|name| {
            let found = tree.bodies.iter().enumerate().find_map(|(index, body)| {
                let (_, kind, pose) = body.shapes.iter().find(|(shape, ..)| shape == name)?;
                match kind {
                    ShapeKind::Sphere { radius_m } if index > 0 => Some(FootDescription {
                        name: name.as_str().into(),
                        joint: u32::try_from(index - 1).ok()?,
                        centre_in_link_m: pose.translation.to_array(),
                        radius_m: *radius_m,
                    }),
                    _ => None,
                }
            });
            found.ok_or_else(|| {
                RobotError::field(
                    &settings.path,
                    "feet",
                    format!("{name:?}"),
                    format!("a sphere on a leg in {}", tree.path.display()),
                )
            })
        })
        .collect()
}

fn link(body: &Body, settings: &settings::File) -> Link {
    let shapes = body
        .shapes
        .iter()
        .map(|(name, kind, pose)| Shape {
            name: name.clone(),
            kind: *kind,
            centre_in_link_m: pose.translation.to_array(),
            orientation_in_link_xyzw: pose.rotation.to_array(),
            role: if let Some(foot) = settings.feet.iter().position(|foot| foot == name) {
                Role::Foot(foot)
            } else if settings.base_shapes.contains(name) {
                Role::Base
            } else {
                Role::Limb
            },
        })
        .collect();
    Link {
        name: body.name.clone(),
        mass_kg: body.mass_kg,
        com_in_link_m: body.com_in_link_m,
        inertia_kg_m2: body.inertia_kg_m2,
        armature_kg_m2: hinge(body).map_or(0.0, |joint| joint.armature_kg_m2),
        shapes,
    }
}

/// Height of the base origin above the lowest point of the feet in the stand, m.
fn stand_height_m(joints: &[JointDescription], feet: &[FootDescription]) -> f64 {
    let mut base_from_link: Vec<(DVec3, DQuat)> = Vec::with_capacity(joints.len());
    for joint in joints {
        let (origin, rotation) = usize::try_from(joint.parent)
            .map_or((DVec3::ZERO, DQuat::IDENTITY), |parent| base_from_link[parent]);
        base_from_link.push((
            origin + rotation * DVec3::from_array(joint.origin_in_parent_m),
            rotation * DQuat::from_axis_angle(DVec3::from_array(joint.axis), joint.stand_rad),
        ));
    }
    feet.iter().fold(0.0, |height: f64, foot| {
        let (origin, rotation) = base_from_link[foot.joint as usize];
        let centre = origin + rotation * DVec3::from_array(foot.centre_in_link_m);
        height.max(foot.radius_m - centre.z)
    })
}
