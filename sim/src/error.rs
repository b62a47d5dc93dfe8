//! Why an arm cannot be simulated.

use model::{ModelError, PostureError};

/// Why an arm cannot be simulated as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// The robot has no model of this size or at this frame.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The load cannot be carried.
    #[error("{0}")]
    Load(String),
    /// The start posture is not one.
    #[error("the start posture cannot be: {0}")]
    Start(#[from] PostureError),
    /// The arm starts in the floor.
    #[error(
        "{link} starts in the floor at z = {floor_m} m: lower plant.floor_m, or start from another posture"
    )]
    StartInFloor {
        /// The link.
        link: String,
        /// The floor's height in B; m.
        floor_m: f64,
    },
    /// The hand starts in a surface.
    #[error(
        "the hand starts {depth_mm:.1} mm inside plant.surface.{surface}: let its normal point to the hand, move the surface, or start from another posture"
    )]
    StartInSurface {
        /// Index of the surface.
        surface: usize,
        /// How deep; mm.
        depth_mm: f64,
    },
    /// Dry friction is not smooth.
    #[error(
        "plant.model = \"reference\" integrates smooth dynamics and has no dry friction, but joint {joint} of '{robot}' has {coulomb} N·m of it: use plant.model = \"rapier\", or plant.friction = false"
    )]
    DryFriction {
        /// The robot's name.
        robot: String,
        /// The first such joint.
        joint: String,
        /// Its Coulomb friction; N·m.
        coulomb: f64,
    },
    /// A link's inertia has a negative principal value.
    #[error(
        "{link} has a principal inertia of {least} kg·m²: move inertia to it from a neighbour, or use plant.model = \"reference\""
    )]
    NotRealisable {
        /// The link.
        link: String,
        /// The smallest principal inertia; kg·m².
        least: f64,
    },
    /// A joint moves nothing.
    #[error(
        "the mass matrix of '{robot}' is singular at the start posture: give the outer links mass, or the joints armature"
    )]
    SingularMass {
        /// The robot's name.
        robot: String,
    },
}
