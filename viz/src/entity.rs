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
#[derive(Clone, Debug, Default)]
pub(crate) struct Lives([String; LIVES]);

impl Lives {
    /// Those of a graph. A process that writes several of the topics has one lane.
    pub(crate) fn of(graph: &Graph) -> Self {
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

/// The lane of faults, above those of the processes; and the drive's, below them.
pub(crate) const FAULT: &str = "/0.fault";
pub(crate) const DRIVE: &str = "/6.drive";
pub(crate) const PHASE: &str = "/phase";

/// The lane of a process: `/1.plant` and so on in the order of the data.
pub(crate) fn life((place, name): (usize, &str)) -> String {
    format!("/{}.{name}", place + 1)
}
