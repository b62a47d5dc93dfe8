//! Where things are in a recording.

use shared_types::process::Program;

/// Numbers at the control rate.
pub(crate) const SIGNALS: &str = "/signals";
/// Numbers that are only drawn, at a lower rate.
pub(crate) const DRAWN: &str = "/drawn";
/// Constant lines that plots need: thresholds and limits.
pub(crate) const GUIDES: &str = "/guides";
/// Lines that hatch the band of a plot in which the arm is treated as singular.
pub(crate) const BAND_LINES: usize = 32;
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
/// The way of a hand that should stand still, off its place, [`MAGNIFIED`] times as large.
pub(crate) const PATH_MAGNIFIED: &str = "/world/path/magnified";
/// How much larger.
pub(crate) const MAGNIFIED: f32 = 50.0;
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

/// The way of the other law's hand, in a race.
pub(crate) const RIVAL_PATH: &str = "/world/path/rival";

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

/// A link of the other law's arm, in a race.
pub(crate) fn rival_link(index: usize) -> String {
    format!("/world/rival/link{}", index + 1)
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

/// The sector that ζ has swept.
pub(crate) fn sector(name: &str) -> String {
    format!("/world/zeta/{name}/sector")
}

/// ζ as it was when the arm entered.
pub(crate) fn entry(name: &str) -> String {
    format!("/world/zeta/{name}/entry")
}

/// How far ζ has turned, in words.
pub(crate) fn swept(name: &str) -> String {
    format!("/world/zeta/{name}/words")
}

/// A line on a link that shows why the arm is singular.
pub(crate) fn reason(name: &str, link: usize) -> String {
    format!("/world/arm/link{}/why_{name}", link + 1)
}

/// The mark's words, above it.
pub(crate) fn label(name: &str) -> String {
    format!("/world/label/{name}")
}

/// Between the time and the words of a line of the log.
pub(crate) const AFTER_TIME: &str = " s\u{2003}";

/// Processes that have a lane of the state timeline.
pub(crate) const PROCESSES: [&str; Program::ALL.len()] = Program::NAMES;
/// The other lanes that are no singularity's.
const LANES: [&str; 3] = ["drive", "phase", "fault"];

/// A lane of the state timeline. The viewer names a lane by its path and orders lanes by it, so it is as short as can be, with a number where lanes
/// have an order: `/wrist` for `mode/wrist`; `/0.fault`, `/1.plant` and so on in the order of the data, `/6.drive`.
pub(crate) fn state(lane: &str) -> String {
    let name = lane.rsplit('/').next().unwrap_or(lane);
    let place = match lane {
        "fault" => Some(0),
        "drive" => Some(PROCESSES.len() + 1),
        lane if lane.starts_with("process/") => PROCESSES.iter().position(|process| *process == name).map(|place| place + 1),
        _ => None,
    };
    place.map_or_else(|| format!("/{name}"), |place| format!("/{place}.{name}"))
}

/// The lane at a path.
pub(crate) fn lane(path: &str) -> String {
    let path = path.trim_start_matches('/');
    // Without its number; older recordings have none.
    let name = path.split_once('.').filter(|(place, _)| place.bytes().all(|byte| byte.is_ascii_digit())).map_or(path, |(_, name)| name);
    match name {
        name if PROCESSES.contains(&name) => format!("process/{name}"),
        name if LANES.contains(&name) => name.to_owned(),
        name => format!("mode/{name}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lane_is_known_by_its_path() {
        for name in ["mode/wrist", "mode/s1", "process/plant", "process/recorder", "drive", "phase", "fault"] {
            assert_eq!(lane(&state(name)), name);
        }
        assert_eq!((lane("/plant"), lane("/fault")), ("process/plant".to_owned(), "fault".to_owned()), "as in older recordings");
        let order = ["fault", "process/plant", "process/estimator", "process/recorder", "drive"].map(state);
        assert!(order.is_sorted(), "{order:?}");
    }
}
