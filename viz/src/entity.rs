//! Where things are in a recording.

use shared_types::process::Program;

use crate::signals::LIVES;

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
/// Of a steered arm, the twist that is asked for: the arrow of its motion, ...
pub(crate) const ASKED: &str = "/world/asked/motion";
/// ... and the arc of its turn, with the line to the place that is asked for.
pub(crate) const ASKED_TURN: &str = "/world/asked/turn";
/// Its hand half a second ahead, ...
pub(crate) const AHEAD: &str = "/world/ahead/hand";
/// ... and the way there.
pub(crate) const AHEAD_WAY: &str = "/world/ahead/way";
/// Why it is no faster, below the hand.
pub(crate) const REASON: &str = "/world/hand/reason";
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

/// The other lanes that are no singularity's.
const LANES: [&str; 3] = ["drive", "phase", "fault"];

/// A lane of the state timeline. The viewer names a lane by its path and orders lanes by it, so it is as short as can be, with a number where lanes
/// have an order: `/wrist` for `mode/wrist`; `/0.fault`, the processes' ([`life`]), `/6.drive`.
pub(crate) fn state(lane: &str) -> String {
    match lane {
        "fault" => format!("/0.{lane}"),
        "drive" => format!("/{}.{lane}", LIVES + 1),
        _ => format!("/{}", lane.rsplit('/').next().unwrap_or(lane)),
    }
}

/// The lane of a process: `/1.plant` and so on in the order of the data.
pub(crate) fn life((place, name): (usize, &str)) -> String {
    format!("/{}.{name}", place + 1)
}

/// The lane at a path.
pub(crate) fn lane(path: &str) -> String {
    let path = path.trim_start_matches('/');
    match path
        .split_once('.')
        .and_then(|(place, name)| Some((place.parse().ok()?, name)))
    {
        Some((1..=LIVES, name)) => format!("process/{name}"),
        Some((_, name)) => name.to_owned(),
        // Older recordings have no numbers.
        None if Program::NAMES.contains(&path) => format!("process/{path}"),
        None if LANES.contains(&path) => path.to_owned(),
        None => format!("mode/{path}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lane_is_known_by_its_path() {
        for name in ["mode/wrist", "mode/s1", "drive", "phase", "fault"] {
            assert_eq!(lane(&state(name)), name);
        }
        for (place, name) in ["plant", "c", "drive", "a.b", "recorder"]
            .into_iter()
            .enumerate()
        {
            assert_eq!(
                lane(&life((place, name))),
                format!("process/{name}"),
                "a process may have any name"
            );
        }
        assert_eq!(
            (lane("/plant"), lane("/fault")),
            ("process/plant".to_owned(), "fault".to_owned()),
            "as in older recordings"
        );
        let order = [
            state("fault"),
            life((0, "plant")),
            life((1, "estimator")),
            life((4, "recorder")),
            state("drive"),
        ];
        assert!(order.is_sorted(), "{order:?}");
    }
}
