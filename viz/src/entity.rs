//! Where things are in a recording.

/// Numbers at the control rate.
pub(crate) const SIGNALS: &str = "/signals";
/// Constant lines that plots need: thresholds and limits.
pub(crate) const GUIDES: &str = "/guides";
/// Names of the singularities, in the order of their numbers: a static component of [`SIGNALS`].
pub(crate) const SINGULARITY_NAMES: &str = "singularity:names";
/// The state of the run, in words.
pub(crate) const NOW: &str = "/now";
/// The text log.
pub(crate) const LOG: &str = "/log";
/// Everything with a place; base axes.
pub(crate) const WORLD: &str = "/world";
/// The way of the hand.
pub(crate) const PATH_ACTUAL: &str = "/world/path/actual";
/// The way it should have gone.
pub(crate) const PATH_DESIRED: &str = "/world/path/desired";
/// The base's figure and the floor's mark.
pub(crate) const BASE: &str = "/world/arm/base";
/// The end-effector frame.
pub(crate) const HAND: &str = "/world/hand";
/// The desired end-effector frame.
pub(crate) const TARGET: &str = "/world/target";
/// The hand's reachable speeds.
pub(crate) const VELOCITY: &str = "/world/manipulability/velocity";
/// Its accelerations under unit forces.
pub(crate) const MOBILITY: &str = "/world/manipulability/mobility";
/// The ways of the joints in null-space motion.
pub(crate) const TRAIL: &str = "/world/null_motion/trail";

/// How far the joints have turned in it.
pub(crate) const TURNED: &str = "/world/null_motion/turned";

/// A link's figure.
pub(crate) fn link(index: usize) -> String {
    format!("/world/arm/link{}", index + 1)
}

/// Where a link has been in null-space motion.
pub(crate) fn ghost(index: usize) -> String {
    format!("/world/null_motion/link{}", index + 1)
}

/// A singularity's frame.
pub(crate) fn singularity(name: &str) -> String {
    format!("/world/singularity/{name}")
}

/// A singularity's mark, which grows.
pub(crate) fn glyph(name: &str) -> String {
    format!("/world/singularity/{name}/glyph")
}

/// Where the mark's ends pass as the arm enters the neighbourhood.
pub(crate) fn edge(name: &str) -> String {
    format!("/world/singularity/{name}/edge")
}

/// Where ζ has been.
pub(crate) fn fan(name: &str) -> String {
    format!("/world/zeta/{name}")
}

/// The mark's words, above it.
pub(crate) fn label(name: &str) -> String {
    format!("/world/label/{name}")
}

/// Lanes of the state timeline.
pub(crate) const STATE: &str = "/state";

/// A lane of the state timeline.
pub(crate) fn state(lane: &str) -> String {
    format!("{STATE}/{lane}")
}
