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
/// The state of the run, in words.
pub(crate) const NOW: &str = "/now";
/// The text log.
pub(crate) const LOG: &str = "/log";
/// Everything with a place; base axes.
pub(crate) const WORLD: &str = "/world";
/// Ways: of the other law's hand, in a race; of a hand that should stand still, off its place, 50 times as large; of the hand; that it should have gone;
/// of the elbow of an arm whose joints can move while its hand stands still.
pub(crate) const WAYS: [&str; 5] = [
    "/world/path/rival",
    "/world/path/magnified",
    "/world/path/actual",
    "/world/path/desired",
    "/world/path/elbow",
];
/// The end-effector frame.
pub(crate) const HAND: &str = "/world/hand";
/// Base axes at the hand: the origin of the view that follows it.
pub(crate) const NEAR: &str = "/world/near";
/// The desired end-effector frame.
pub(crate) const TARGET: &str = "/world/target";
/// The links of the arm; their number follows.
pub(crate) const LINK: &str = "/world/arm/link";
/// The captions; their names follow.
pub(crate) const CAPTION: &str = "/world/caption/";
pub(crate) const CAPTIONS: &str = "/world/caption/**";
/// The names alone, for a view in which captions have no room.
pub(crate) const NAME: &str = "/world/name/";
pub(crate) const NAMES: &str = "/world/name/**";

/// One of several links: the arm's, a ghost's, the other law's in a race.
pub(crate) fn link(of: &str, index: usize) -> String {
    format!("{of}{}", index + 1)
}

/// The processes that have lanes, each with its place: the writers of [`CHAIN`]'s topics, of which one that writes several has one lane, and the recorder.
pub(crate) fn lives(graph: &Graph) -> Vec<(usize, String)> {
    let mut all = graph.process.iter();
    let recorder = all.find(|one| one.program() == Some(Program::Recorder));
    let writers = CHAIN.iter().map(|topic| graph.writer(topic));
    let mut out: Vec<(usize, String)> = Vec::new();
    for (place, process) in writers.chain([recorder]).enumerate() {
        let new = process.filter(|process| out.iter().all(|(_, name)| *name != process.name));
        out.extend(new.map(|process| (place, process.name.clone())));
    }
    out
}

/// The lane of faults, above those of the processes; and the drive's, below them.
pub(crate) const FAULT: &str = "/0.fault";
pub(crate) const DRIVE: &str = "/6.drive";
pub(crate) const PHASE: &str = "/phase";

/// The lane of a process: `/1.plant` and so on in the order of the data.
pub(crate) fn life((place, name): &(usize, String)) -> String {
    format!("/{}.{name}", place + 1)
}
