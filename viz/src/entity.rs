//! Where things are in a recording.

use shared_types::graph::Graph;
use shared_types::process::Program;
use shared_types::topics::CHAIN;

/// Numbers at the control rate.
pub(crate) const SIGNALS: &str = "/signals";
/// Numbers that are only drawn, at a lower rate.
pub(crate) const DRAWN: &str = "/drawn";
/// Constant lines that plots need: thresholds and limits.
pub(crate) const GUIDES: &str = "/guides";
/// Names of the singularities, in the order of their numbers: a static component of [`SIGNALS`].
pub(crate) const SINGULARITY_NAMES: &str = "singularity:names";
/// The state of the run, in words.
pub(crate) const NOW: &str = "/now";
/// The text log.
pub(crate) const LOG: &str = "/log";
/// Between the time and the words of a line of the log.
pub(crate) const AFTER_TIME: &str = " s\u{2003}";
/// Everything with a place; base axes.
pub(crate) const WORLD: &str = "/world";
/// The way of the hand.
pub(crate) const PATH_ACTUAL: &str = "/world/path/actual";
/// The way it should have gone.
pub(crate) const PATH_DESIRED: &str = "/world/path/desired";
/// The way of the elbow of an arm whose joints can move while its hand stands still.
pub(crate) const PATH_ELBOW: &str = "/world/path/elbow";
/// The way of the other law's hand, in a race.
pub(crate) const PATH_RIVAL: &str = "/world/path/rival";
/// The way of a hand that should stand still, off its place, 50 times as large.
pub(crate) const PATH_MAGNIFIED: &str = "/world/path/magnified";
/// The end-effector frame.
pub(crate) const HAND: &str = "/world/hand";
/// The desired end-effector frame.
pub(crate) const TARGET: &str = "/world/target";
/// The links of the arm; their number follows.
pub(crate) const LINK: &str = "/world/arm/link";
/// How far the joints have turned in null-space motion.
pub(crate) const TURNED: &str = "/world/null_motion/turned";
/// The frame of each singularity; its name follows.
pub(crate) const SINGULARITY: &str = "/world/singularity/";
/// The part of the mark whose hidden words name what is lost, while the arm is inside.
pub(crate) const AXES: &str = "axes";
/// The two captions; their number follows.
pub(crate) const CAPTION: &str = "/world/caption/";
pub(crate) const CAPTIONS: &str = "/world/caption/**";

/// One of several links: the arm's, a ghost's, the other law's in a race.
pub(crate) fn link(of: &str, index: usize) -> String {
    format!("{of}{}", index + 1)
}

/// How many processes have a lane: the writers of [`CHAIN`]'s topics, and the recorder.
pub(crate) const LIVES: usize = CHAIN.len() + 1;

/// The names of the processes whose lanes the state timeline has. Empty where no process is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lives([String; LIVES]);

impl Lives {
    /// Those of a graph. A process that writes several of the topics has one lane.
    #[must_use]
    pub fn of(graph: &Graph) -> Self {
        let mut names: [String; LIVES] = std::array::from_fn(|i| {
            let process = match CHAIN.get(i) {
                Some(topic) => graph.writer(topic),
                None => {
                    let mut all = graph.process.iter();
                    all.find(|one| one.program() == Some(Program::Recorder))
                }
            };
            process.map_or(String::new(), |process| process.name.clone())
        });
        for i in 1..LIVES {
            if names[..i].contains(&names[i]) {
                names[i].clear();
            }
        }
        Self(names)
    }

    /// The name of the process at a place; empty where there is none.
    pub(crate) fn name(&self, place: usize) -> &str {
        &self.0[place]
    }

    /// Place and name of each.
    pub(crate) fn named(&self) -> impl Iterator<Item = (usize, &str)> {
        let all = self.0.iter().map(String::as_str).enumerate();
        all.filter(|(_, name)| !name.is_empty())
    }
}

impl Default for Lives {
    /// Those of the built-in graph.
    fn default() -> Self {
        Self(Program::NAMES.map(str::to_owned))
    }
}

/// A lane of the state timeline. The viewer names a lane by its path and orders lanes by it, so it is as short as can be, with a number where lanes
/// have an order: `/wrist` for `mode/wrist`; `/0.fault`, the processes' ([`life`]), `/6.drive`.
pub(crate) fn state(lane: &str) -> String {
    match lane {
        "fault" => "/0.fault".to_owned(),
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
    let numbered = path.split_once('.');
    match numbered.and_then(|(place, name)| Some((place.parse().ok()?, name))) {
        Some((1..=LIVES, name)) => format!("process/{name}"),
        Some((_, name)) => name.to_owned(),
        None if path == "phase" => path.to_owned(),
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
        // A process may have any name.
        for process in [(0, "plant"), (2, "drive"), (3, "a.b"), (4, "recorder")] {
            assert_eq!(lane(&life(process)), format!("process/{}", process.1));
        }
    }
}
