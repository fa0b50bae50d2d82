//! Collision shapes of a link.

/// What touching something with a shape means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A foot, by its index in the robot's feet.
    Foot(usize),
    /// Part of the base: a contact ends a rollout.
    Base,
    /// Any other part: may touch, but is reported.
    Limb,
}

/// A primitive; capsules and cylinders lie along the shape's z axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ShapeKind {
    /// A ball.
    Sphere {
        /// Radius, m.
        radius_m: f64,
    },
    /// A segment with a radius.
    Capsule {
        /// Radius, m.
        radius_m: f64,
        /// Half the length of the segment, without the caps, m.
        half_length_m: f64,
    },
    /// A cylinder.
    Cylinder {
        /// Radius, m.
        radius_m: f64,
        /// Half the length, m.
        half_length_m: f64,
    },
    /// A box.
    Box {
        /// Half the extents along x, y, z, m.
        half_extents_m: [f64; 3],
    },
}

/// A primitive placed in its link.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Name of the MJCF geom.
    pub name: String,
    /// The primitive.
    pub kind: ShapeKind,
    /// Centre in the link's frame, m.
    pub centre_in_link_m: [f64; 3],
    /// Orientation in the link's frame, quaternion x, y, z, w.
    pub orientation_in_link_xyzw: [f64; 4],
    /// What a contact of this shape means.
    pub role: Role,
}
