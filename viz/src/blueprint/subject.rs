//! The subject of a layout: the run's properties that it depends on.

use glam::Vec3;

use crate::solid::Rgba;

/// Colours of joints, in order.
pub(crate) const JOINTS: [Rgba; 8] = [
    [86, 156, 230, 255],
    [64, 200, 180, 255],
    [160, 210, 90, 255],
    [245, 190, 80, 255],
    [240, 110, 105, 255],
    [190, 140, 245, 255],
    [200, 200, 205, 255],
    [120, 130, 145, 255],
];

/// The properties of a run that its blueprint depends on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Subject {
    pub(crate) joints: usize,
    /// Name and colour of each singularity, in the report's order.
    pub(crate) singularities: Vec<(String, Rgba)>,
    /// Distinct ratios η_out / η_in.
    pub(crate) outer: Vec<f64>,
    /// The goal's tolerances: mm and degrees; `None` where it does not judge.
    pub(crate) goal: [Option<f64>; 2],
    /// Torque over its limit is undefined: some joint has no limit.
    pub(crate) unlimited_torque: bool,
    /// The same for speeds.
    pub(crate) unlimited_speed: bool,
    pub(crate) eye: Eye,
    /// Near the singular frame, across ζ.
    pub(crate) close_up: Eye,
    pub(crate) floor_m: f32,
}

/// From where the arm is seen; base axes, m.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) up: Vec3,
}
