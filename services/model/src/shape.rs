//! Visual and collision geometry.

use crate::pose::Pose;
use nalgebra::Vector3;

/// The form of a shape, m, centred at its frame, with its long axis along z.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry {
    /// A box of full side lengths `size`.
    Box {
        /// Side lengths.
        size: Vector3<f64>,
    },
    /// A cylinder.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Length along z.
        length: f64,
    },
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A capsule.
    Capsule {
        /// Radius.
        radius: f64,
        /// Length along z between the centres of the caps.
        length: f64,
    },
    /// A mesh in a file of its own.
    Mesh {
        /// As the robot's file names it: a path from its folder, or a URL.
        file: String,
        /// Factors of the file's lengths, which give metres.
        scale: Vector3<f64>,
    },
}

/// A piece of visual or collision geometry fixed to a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Index of the joint whose link carries it; `None` for the base.
    pub joint: Option<usize>,
    /// The shape's frame in that link's frame.
    pub X_LS: Pose,
    /// Its form.
    pub geometry: Geometry,
    /// Red, green, blue, opacity in 0..=1, where the URDF gives the material a colour.
    pub colour: Option<[f64; 4]>,
    /// Whether it is collision geometry, for the eye only where the link's own meshes cannot be read.
    pub stands_in: bool,
    /// Whether it is what can touch the world: collision geometry, or visual geometry of a link that has none.
    pub touches: bool,
}
