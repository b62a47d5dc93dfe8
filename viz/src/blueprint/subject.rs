//! The subject of a layout: the run's properties that it depends on.

use glam::Vec3;
use shared_types::scenario::Segment;

use crate::signals::Lives;
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

/// Colours of errors orthogonal to ζ and along it.
pub(crate) const ACROSS: Rgba = [110, 215, 150, 255];
pub(crate) const ALONG: Rgba = [250, 150, 210, 255];

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
    /// Faults are planned, or have come: plots have a bar for them.
    pub(crate) faults: bool,
    /// The run is longer than the minute around the cursor that plots show by themselves.
    pub(crate) is_long: bool,
    /// The task is to stand still with the hand while the joints move.
    pub(crate) stands_still: bool,
    /// The task has no orientation, hence no error of it.
    pub(crate) without_orientation: bool,
    /// Torque over its limit is undefined: some joint has no limit.
    pub(crate) unlimited_torque: bool,
    /// The same for speeds.
    pub(crate) unlimited_speed: bool,
    /// Where each segment of the task takes the hand, as far as the scenario itself says it.
    pub(crate) ways: Vec<Way>,
    pub(crate) eye: Eye,
    /// Near the singular frame, across ζ.
    pub(crate) close_up: Eye,
    pub(crate) floor_m: f32,
    /// The processes that have lanes.
    pub(crate) lives: Lives,
}

/// The end of a segment of the task; base axes, m.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Way {
    To(Vec3),
    By(Vec3),
}

impl Way {
    /// That of a segment which gives a place or a way in base axes.
    pub(crate) fn of(segment: &Segment) -> Option<Self> {
        let vector = |v: [f64; 3]| Vec3::from(v.map(|x| x as f32));
        let slide = segment.slide.as_ref().and_then(|slide| {
            let axis = ["x", "y", "z"]
                .iter()
                .position(|axis| *axis == slide.along)?;
            Some(Vec3::AXES[axis] * slide.by_m as f32)
        });
        segment.to_m.map(|place| Self::To(vector(place))).or(segment
            .by_m
            .map(vector)
            .or(slide)
            .map(Self::By))
    }

    /// The hand's place after it.
    pub(crate) fn after(self, place: Vec3) -> Vec3 {
        match self {
            Self::To(end) => end,
            Self::By(way) => place + way,
        }
    }
}

/// From where the arm is seen; base axes, m.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) up: Vec3,
}
