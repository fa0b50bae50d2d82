//! The part of MJCF that describes our robots, taken from the parser's tree and checked.

use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

use mjcf_rs::Pose;
use mjcf_rs::body::{Geom, GeomType, InertiaSpec, Inertial, JointType};
use mjcf_rs::glam::{DMat3, DQuat, DVec3};

use super::settings::read_text;
use super::{ReadFile, RobotError, ShapeKind};

/// One MJCF body with what hangs on it, in file order: parents come first.
pub(super) struct Body {
    pub(super) name: String,
    /// Index of the parent in [`File::bodies`]; none for the root.
    pub(super) parent: Option<usize>,
    pub(super) origin_in_parent_m: [f64; 3],
    pub(super) mass_kg: f64,
    pub(super) com_in_link_m: [f64; 3],
    pub(super) inertia_kg_m2: [[f64; 3]; 3],
    pub(super) hinge: Option<Hinge>,
    pub(super) shapes: Vec<(String, ShapeKind, Pose)>,
}

/// The hinge that carries a body.
pub(super) struct Hinge {
    pub(super) name: String,
    pub(super) axis: [f64; 3],
    pub(super) range_rad: [f64; 2],
    pub(super) armature_kg_m2: f64,
}

/// The checked file.
pub(super) struct File {
    pub(super) path: PathBuf,
    pub(super) sha256: String,
    pub(super) bodies: Vec<Body>,
}

impl File {
    pub(super) fn read(path: &Path, read: ReadFile<'_>) -> Result<Self, RobotError> {
        let (text, sha256) = read_text(path, read)?;
        super::nesting::check(&text)
            .map_err(|(found, wanted)| RobotError::field(path, "file", found, wanted))?;
        let folder = path.parent().unwrap_or(Path::new("."));
        // The parser is a guest here: what it trips over is a robot that is refused.
        let parsed = catch_unwind(|| mjcf_rs::Model::from_str(&text, folder));
        let model = parsed
            .map_err(|_| RobotError::malformed(path, &"the parser panicked"))?
            .map_err(|error| RobotError::malformed(path, &error))?;
        let reader = Reader { path };
        let mut bodies = Vec::new();
        for (id, entry) in model.bodies_iter() {
            // The world is body 0 of the parser and has no place here.
            let parent = entry.parent.filter(|&parent| parent != 0).map(|parent| parent - 1);
            debug_assert_eq!(id - 1, bodies.len(), "the parser keeps file order");
            bodies.push(reader.body(&entry.body, parent)?);
        }
        Ok(Self { path: path.to_owned(), sha256, bodies })
    }
}

/// Beyond any length, mass or inertia of a robot.
const BEYOND: f64 = 1e6;

struct Reader<'a> {
    path: &'a Path,
}

impl Reader<'_> {
    fn refuse(&self, field: String, found: impl Into<String>, wanted: &str) -> RobotError {
        RobotError::field(self.path, field, found, wanted)
    }

    fn body(&self, body: &mjcf_rs::body::Body, parent: Option<usize>) -> Result<Body, RobotError> {
        let name = body
            .name
            .clone()
            .ok_or_else(|| self.refuse("body.name".into(), "none", "a name on every body"))?;
        if body.pose.rotation.w.abs() < 1.0 - 1e-9 {
            return Err(self.refuse(
                format!("{name}.quat"),
                "a rotation",
                "a frame parallel to its parent's",
            ));
        }
        let inertial = body
            .inertial
            .as_ref()
            .ok_or_else(|| self.refuse(format!("{name}.inertial"), "none", "mass and inertia in the file"))?;
        self.numbers(&format!("{name}.pos"), &body.pose.translation.to_array())?;
        self.pose(&format!("{name}.inertial"), &inertial.pose)?;
        let hinge = self.hinge(&name, body, parent)?;
        let shapes = body.geoms.iter().map(|geom| self.shape(&name, geom)).collect::<Result<_, _>>()?;
        Ok(Body {
            parent,
            origin_in_parent_m: body.pose.translation.to_array(),
            mass_kg: self.positive(format!("{name}.inertial.mass"), inertial.mass)?,
            com_in_link_m: inertial.pose.translation.to_array(),
            inertia_kg_m2: self.inertia(&name, inertial)?,
            hinge,
            shapes,
            name,
        })
    }

    fn positive(&self, field: String, value: f64) -> Result<f64, RobotError> {
        if value > 0.0 && value < BEYOND {
            Ok(value)
        } else {
            Err(self.refuse(field, value.to_string(), "a positive number less than a million"))
        }
    }

    /// Phrased so that what is no number fails.
    fn numbers(&self, field: &str, values: &[f64]) -> Result<(), RobotError> {
        if values.iter().all(|value| value.abs() < BEYOND) {
            return Ok(());
        }
        Err(self.refuse(field.to_owned(), format!("{values:?}"), "finite numbers less than a million"))
    }

    fn pose(&self, of: &str, pose: &Pose) -> Result<(), RobotError> {
        self.numbers(&format!("{of}.pos"), &pose.translation.to_array())?;
        self.numbers(&format!("{of}.quat"), &pose.rotation.to_array())
    }

    fn hinge(
        &self,
        body: &str,
        of: &mjcf_rs::body::Body,
        parent: Option<usize>,
    ) -> Result<Option<Hinge>, RobotError> {
        let [joint] = of.joints.as_slice() else {
            return Err(self.refuse(
                format!("{body}.joint"),
                format!("{} joints", of.joints.len()),
                "one joint to a body",
            ));
        };
        if parent.is_none() {
            return match joint.type_ {
                JointType::Free => Ok(None),
                _ => Err(self.refuse(format!("{body}.joint"), format!("{:?}", joint.type_), "a free joint")),
            };
        }
        let name = joint
            .name
            .clone()
            .ok_or_else(|| self.refuse(format!("{body}.joint.name"), "none", "a name on every joint"))?;
        if joint.type_ != JointType::Hinge {
            return Err(self.refuse(format!("{name}.type"), format!("{:?}", joint.type_), "a hinge"));
        }
        if joint.pos.iter().any(|&offset| offset != 0.0) || joint.ref_ != 0.0 {
            return Err(self.refuse(
                format!("{name}.pos or ref"),
                format!("{:?}, {}", joint.pos, joint.ref_),
                "the joint at its body's origin, zero as drawn",
            ));
        }
        if joint.damping != 0.0 || joint.stiffness != 0.0 || joint.frictionloss != 0.0 {
            return Err(self.refuse(
                format!("{name}.damping, stiffness or frictionloss"),
                format!("{}, {}, {}", joint.damping, joint.stiffness, joint.frictionloss),
                "0: passive joint forces are not modelled",
            ));
        }
        let axis = DVec3::from_array(joint.axis)
            .try_normalize()
            .ok_or_else(|| self.refuse(format!("{name}.axis"), "no direction", "a unit vector"))?;
        let range = joint
            .range
            .filter(|range| range[0] < range[1] && range.iter().all(|limit| limit.is_finite()))
            .ok_or_else(|| {
                self.refuse(format!("{name}.range"), format!("{:?}", joint.range), "lower < upper, rad")
            })?;
        if !(joint.armature >= 0.0 && joint.armature.is_finite()) {
            return Err(self.refuse(format!("{name}.armature"), joint.armature.to_string(), "0 or more"));
        }
        Ok(Some(Hinge { name, axis: axis.to_array(), range_rad: range, armature_kg_m2: joint.armature }))
    }

    fn inertia(&self, body: &str, inertial: &Inertial) -> Result<[[f64; 3]; 3], RobotError> {
        let in_inertial = match inertial.inertia {
            InertiaSpec::Diagonal(diagonal) => DMat3::from_diagonal(DVec3::from_array(diagonal)),
            InertiaSpec::Full([xx, yy, zz, xy, xz, yz]) => {
                DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
            }
        };
        // Sylvester's criterion: all leading minors are positive.
        let [x, y, _] = [in_inertial.x_axis, in_inertial.y_axis, in_inertial.z_axis];
        let minors = [x.x, x.x * y.y - x.y * y.x, in_inertial.determinant()];
        if !minors.iter().all(|&minor| minor > 0.0 && minor.is_finite()) {
            return Err(self.refuse(
                format!("{body}.inertial"),
                format!("{:?}", inertial.inertia),
                "a positive definite inertia",
            ));
        }
        let link_from_inertial = DMat3::from_quat(inertial.pose.rotation);
        let inertia = link_from_inertial * in_inertial * link_from_inertial.transpose();
        // Symmetric, so rows are columns.
        Ok(inertia.to_cols_array_2d())
    }

    fn shape(&self, body: &str, geom: &Geom) -> Result<(String, ShapeKind, Pose), RobotError> {
        let name = geom
            .name
            .clone()
            .ok_or_else(|| self.refuse(format!("{body}.geom.name"), "none", "a name on every geom"))?;
        let mut pose = geom.pose;
        let mut half_length_m = geom.size[1];
        if let Some([x0, y0, z0, x1, y1, z1]) = geom.fromto {
            let (from, to) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
            let along = (to - from).try_normalize().ok_or_else(|| {
                self.refuse(format!("{name}.fromto"), "two equal points", "two different points")
            })?;
            pose = Pose::from_parts((from + to) * 0.5, DQuat::from_rotation_arc(DVec3::Z, along));
            half_length_m = (to - from).length() * 0.5;
        }
        self.pose(&name, &pose)?;
        let radius_m = self.positive(format!("{name}.size"), geom.size[0])?;
        let kind = match geom.type_ {
            GeomType::Sphere => ShapeKind::Sphere { radius_m },
            GeomType::Capsule | GeomType::Cylinder => {
                let half_length_m = self.positive(format!("{name}.size"), half_length_m)?;
                if geom.type_ == GeomType::Capsule {
                    ShapeKind::Capsule { radius_m, half_length_m }
                } else {
                    ShapeKind::Cylinder { radius_m, half_length_m }
                }
            }
            GeomType::Box => {
                self.positive(format!("{name}.size"), geom.size[1])?;
                self.positive(format!("{name}.size"), geom.size[2])?;
                ShapeKind::Box { half_extents_m: geom.size }
            }
            other => {
                return Err(self.refuse(
                    format!("{name}.type"),
                    format!("{other:?}"),
                    "sphere, capsule, cylinder or box",
                ));
            }
        };
        Ok((name, kind, pose))
    }
}
