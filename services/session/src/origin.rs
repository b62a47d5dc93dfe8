//! The beginning of a run that goes on from a tick of another one: the same again from there, or a branch of it with other settings.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use launcher::Begin;
use recorder::{Contents, Cut, Item, MESSAGES, RecordReader, RecordWriter, tick_of};
use runtime::{NamedSaved, Saved};
use serde_json::json;
use shared_types::ControlState;
use shared_types::fault::ScheduledFault;
use shared_types::job::{Branch, Job, Mode};
use shared_types::scenario::Push;
use shared_types::summary::FaultSummary;
use shared_types::topics::CHAIN;

use crate::failure::Failure;
use crate::load::{self, Loaded};
use crate::results::SCENARIO;
use crate::runs::Run;
use crate::seal;

/// A tick of a run, `RUN@TICK`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The run's folder.
    pub run: PathBuf,
    /// The tick.
    pub tick: u64,
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.rsplit_once('@');
        let place = parts.and_then(|(run, tick)| {
            let tick = tick.parse().ok()?;
            (!run.is_empty()).then(|| Self {
                run: run.into(),
                tick,
            })
        });
        place.ok_or_else(|| {
            format!(
                "`{text}` is no tick of a run: give its folder and the tick, such as runs/fig5-wrist-rotation-001@2500"
            )
        })
    }
}

/// A run that others go on from.
#[derive(Debug)]
pub(crate) struct Origin {
    job: Job,
    record: PathBuf,
    begin: Begin,
    /// The account of its faults.
    pub(crate) faults: Vec<FaultSummary>,
    pub(crate) branch: Branch,
}

/// The command that repeats a branch.
pub(crate) fn command(branch: &Branch) -> String {
    let settings = branch.settings.iter();
    let settings: String = settings.map(|one| format!(" --set {one:?}")).collect();
    format!(
        "armplane run --from {:?}{settings}",
        format!("{}@{}", branch.run, branch.tick)
    )
}

/// The branch with other settings of which a scenario file is; `None` of any other.
pub(crate) fn branch_of(scenario: &str) -> Option<Branch> {
    let path = Path::new(scenario);
    let run = Run {
        folder: path.parent()?.to_owned(),
    };
    let job = (path.file_name()? == SCENARIO).then(|| run.read_job().ok())??;
    job.from.filter(|branch| !branch.settings.is_empty())
}

/// Settings that a branch cannot change, because the arm and its start are those of the run.
const KEPT: [&str; 7] = [
    "robot", "frame", "start", "rate_hz", "seed", "graph", "analysis",
];

/// The scenario of a run, with other settings if there are some, and its state at a tick: without settings at the cut before it.
///
/// # Errors
/// [`Failure::Input`] if the run has no such tick, or cannot go on from it so.
pub(crate) fn begin_at(place: &Place, settings: &[String]) -> Result<(Loaded, Origin), Failure> {
    let (run, job) = recorded(place)?;
    let file = run.folder.join(SCENARIO).display().to_string();
    let load = |settings: &[String]| load::scenario_in(None, &file, settings, None);
    let (before, loaded) = (load(&[])?, load(settings)?);
    let faults = |loaded: &Loaded| {
        let faults = loaded.scenario.scheduled_faults(&loaded.graph);
        faults.map_err(|complaint| run.refuse(complaint))
    };
    let planned = faults(&before)?;
    let record = run.folder.join(MESSAGES);
    let mut begin = newest_cut(&record, &job, &planned, place.tick)?;
    let cut = begin.tick;
    if !settings.is_empty() {
        let begun = begun(&record, &job, place.tick)?;
        check(&before, &loaded, begun).map_err(|why| run.refuse(why))?;
        let earlier = |mut all: Vec<ScheduledFault>| {
            all.retain(|fault| fault.at < place.tick);
            all
        };
        if earlier(faults(&loaded)?) != earlier(planned.clone())
            || pushes(&loaded, place.tick) != pushes(&before, place.tick)
        {
            return Err(run.refuse(format_args!(
                "a fault or push before tick {} cannot be changed: it would never happen, or has happened",
                place.tick
            )));
        }
        begin = advance(place.tick, begin, &before, &loaded, &planned)
            .map_err(|why| run.refuse(why))?;
    }
    if let Some(gap) = gap_before(&record, &job, begin.tick, cut)? {
        return Err(run.refuse(format_args!(
            "{MESSAGES} {gap}, before tick {}: go on from an earlier tick, or run it again",
            begin.tick
        )));
    }
    let branch = Branch {
        run: run.folder.display().to_string(),
        tick: place.tick,
        settings: settings.to_vec(),
    };
    let origin = Origin {
        job,
        record,
        begin,
        faults: run.summary()?.faults,
        branch,
    };
    Ok((loaded, origin))
}

/// The pushes that begin before a tick.
fn pushes(loaded: &Loaded, tick: u64) -> Vec<Push> {
    let from_s = tick as f64 * loaded.scenario.dt_s();
    let pushes = loaded.scenario.plant.push.iter();
    pushes.filter(|push| push.at_s < from_s).copied().collect()
}

/// The run of a place, and its job, if it has such a tick and can go on.
fn recorded(place: &Place) -> Result<(Run, Job), Failure> {
    let run = Run::find(Some(&place.run))?;
    let job = run.job()?;
    if job.mode == Mode::Realtime {
        return Err(run.refuse(
            "it ran in real time, and no run in real time comes again: run it in lockstep",
        ));
    }
    if !job.record || !run.folder.join(MESSAGES).exists() {
        return Err(run.refuse(format_args!(
            "it has no record to go on from ({MESSAGES}): run it again"
        )));
    }
    if !seal::is_sealed(&load::read(&run.folder.join(SCENARIO))?) {
        return Err(run.refuse(format_args!(
            "its {SCENARIO} has been edited, and its record is of another one: run it from the beginning, or change settings by --set"
        )));
    }
    let ticks = run.summary()?.ticks;
    if !(1..ticks).contains(&place.tick) {
        return Err(run.refuse(format_args!(
            "it has the ticks 1 to {}, not {}",
            ticks.saturating_sub(1),
            place.tick
        )));
    }
    if let Some(branch) = branched_after(&job, place.tick) {
        return Err(run.refuse(format_args!(
            "it has its settings only from tick {} on, where it branches off {}: go on from there or later, or from that run",
            branch.tick, branch.run
        )));
    }
    Ok((run, job))
}

/// Most runs that went on from one another and are looked through.
const MOST_ORIGINS: usize = 100;

/// The branch with other settings by which a run, or one that it went on from, begins after a tick.
fn branched_after(job: &Job, tick: u64) -> Option<Branch> {
    let before = |branch: &Branch| {
        Run::find(Some(Path::new(&branch.run)))
            .ok()?
            .job()
            .ok()?
            .from
    };
    std::iter::successors(job.from.clone(), before)
        .take(MOST_ORIGINS)
        .find(|branch| !branch.settings.is_empty() && tick < branch.tick)
}

/// The reason that a record does not hold all messages before a tick, in words: it is damaged, or ends. `cut`: the newest of its cuts before that tick,
/// until which it is whole.
///
/// # Errors
/// [`Failure::Input`] if it cannot be read.
fn gap_before(record: &Path, job: &Job, tick: u64, cut: u64) -> Result<Option<String>, Failure> {
    if tick == 0 {
        return Ok(None);
    }
    let contents = Contents::of(job);
    let record = RecordReader::open_before(record, &contents, tick);
    let mut record = record.map_err(Failure::input)?;
    let mut next = vec![0; contents.layouts().len()];
    while let Some(item) = record.next_item() {
        if let Item::Message { channel, message } = item
            && let Some(next) = next.get_mut(channel)
        {
            *next = tick_of(message) + 1;
        }
    }
    if let Some(ticks) = record.damage().first() {
        return Ok(Some(format!("is damaged at tick {}", ticks.start())));
    }
    // Of the topics that have a message at each tick.
    let ends = CHAIN.iter().filter_map(|topic| contents.channel(topic));
    let end = ends
        .map(|channel| next[channel])
        .min()
        .unwrap_or(tick)
        .max(cut);
    Ok((end < tick).then(|| format!("ends at tick {end}")))
}

/// The newest cut of a job's record, not after a tick, from which a run with these faults goes on; the beginning of the run if there is none, or no record.
///
/// # Errors
/// [`Failure::Input`] if the record cannot be read.
pub(crate) fn newest_cut(
    record: &Path,
    job: &Job,
    faults: &[ScheduledFault],
    last: u64,
) -> Result<Begin, Failure> {
    if !record.exists() {
        return Ok(Begin::default());
    }
    let contents = Contents::of(job);
    let is_usable = |tick| tick <= last && !faults.iter().any(|fault| fault.unsettles(tick));
    let newest = |is_usable: &dyn Fn(u64) -> bool| {
        Cut::newest(record, &contents, is_usable).map_err(Failure::input)
    };
    let mut cut = newest(&is_usable)?;
    let is_undisturbed = |tick| !faults.iter().any(|fault| fault.has_unsettled(tick));
    // A program without a state is given its past again.
    if cut
        .as_ref()
        .is_some_and(|cut| has_past(&cut.processes) && !is_undisturbed(cut.tick))
    {
        cut = newest(&|tick| is_usable(tick) && is_undisturbed(tick))?;
    }
    Ok(cut.map_or_else(Begin::default, |cut| Begin {
        tick: cut.tick,
        saved: cut.processes,
    }))
}

/// Whether one of these processes has saved nothing: a program without a state.
pub(crate) fn has_past(saved: &[NamedSaved]) -> bool {
    saved.iter().any(|(_, saved)| lacks_state(saved))
}

fn lacks_state(saved: &[u8]) -> bool {
    Saved::of(saved).is_some_and(|saved| saved.state.is_empty())
}

/// The folder with what programs without a state have read and written before a cut; removed when it is dropped.
pub(crate) struct Past(PathBuf);

impl Past {
    /// Leaves to the programs of a run that have saved nothing what they have read and written, by topic, from the record in its folder.
    ///
    /// # Errors
    /// [`Failure::Work`] if the record cannot be read, or there is no room.
    pub(crate) fn leave(job: &Job, begin: &Begin) -> Result<Self, Failure> {
        let past = Self(runtime::past_of(&job.out));
        let folder = &past.0;
        let _ = std::fs::remove_dir_all(folder);
        std::fs::create_dir(folder).map_err(Failure::cannot("make", folder))?;
        let without = begin.saved.iter().filter(|(_, saved)| lacks_state(saved));
        let processes = without.filter_map(|(name, _)| job.graph.process(name));
        let topics: Vec<&String> = processes
            .flat_map(|one| one.reads.iter().chain(&one.feedback).chain(&one.writes))
            .collect();
        let contents = Contents::of(job);
        let mut files = Vec::new();
        for layout in contents.layouts() {
            let path = folder.join(&layout.topic);
            let create = || File::create(&path).map_err(Failure::cannot("make", &path));
            let is_needed = topics.contains(&&layout.topic);
            files.push(is_needed.then(create).transpose()?.map(BufWriter::new));
        }
        let record = job.out.join(MESSAGES);
        let record = RecordReader::open_before(&record, &contents, begin.tick);
        let mut record = record.map_err(Failure::work)?;
        while let Some(item) = record.next_item() {
            if let Item::Message { channel, message } = item
                && let Some(file) = &mut files[channel]
            {
                file.write_all(message)
                    .map_err(Failure::cannot("write", folder))?;
            }
        }
        for file in files.iter_mut().flatten() {
            file.flush().map_err(Failure::cannot("write", folder))?;
        }
        Ok(past)
    }
}

impl Drop for Past {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Segments that have begun by a tick, as the law says in the record; 0 where it says nothing.
///
/// # Errors
/// [`Failure::Input`] if the record cannot be read.
fn begun(record: &Path, job: &Job, tick: u64) -> Result<usize, Failure> {
    let record = RecordReader::open(record, &Contents::of(job)).map_err(Failure::input)?;
    let mut states = record.messages::<ControlState>();
    let state = states.find(|state| state.header.tick == tick);
    Ok(state.map_or(0, |state| state.segment as usize + 1))
}

/// Whether a branch may have these settings, so many segments having begun.
///
/// # Errors
/// Why not, in words.
fn check(before: &Loaded, after: &Loaded, begun: usize) -> Result<(), String> {
    let (was, is) = (json!(before.scenario), json!(after.scenario));
    let changed = |path: &str| was.pointer(path) != is.pointer(path);
    let kept = KEPT.iter().find(|key| changed(&format!("/{key}")));
    if let Some(key) = kept {
        return Err(format!(
            "a branch keeps the `{key}` of its run: it can change control, plant, faults and what comes after the tick"
        ));
    }
    if before.graph != after.graph {
        return Err(
            "these settings change its processes or topics, and a branch keeps them: run it from the beginning"
                .to_owned(),
        );
    }
    let began = (0..begun).find(|segment| changed(&format!("/segment/{segment}")));
    if let Some(segment) = began {
        return Err(format!(
            "segment {segment} has begun by then, and the law goes on along it: change a later one"
        ));
    }
    if changed("/control/strategy") {
        return Err(format!(
            "the strategy {} cannot go on from the state of {}: compare them from the beginning, `armplane compare`",
            is["control"]["strategy"], was["control"]["strategy"]
        ));
    }
    if changed("/plant/model") {
        return Err("another model of the plant cannot go on from this one's state".to_owned());
    }
    Ok(())
}

/// Largest step of the desired position and orientation at a branch; m, rad.
const MOST_STEP: [f64; 2] = [1e-3, 0.01];

/// The states of all processes at a tick, from those at a cut before it, computed on one thread as the run has. Then a branch follows the path of the arm.
fn advance(
    tick: u64,
    from: Begin,
    before: &Loaded,
    after: &Loaded,
    faults: &[ScheduledFault],
) -> Result<Begin, String> {
    let instead = match from.tick {
        0 => "from a later one".to_owned(),
        cut => format!("from {cut}"),
    };
    let is_ours = before
        .graph
        .process
        .iter()
        .all(|one| one.program().is_some());
    if !is_ours {
        return match from.tick == tick {
            true => Ok(from),
            false => Err(format!(
                "programs of others go on from a cut alone: branch {instead}"
            )),
        };
    }
    if (from.tick..=tick).any(|tick| faults.iter().any(|fault| fault.unsettles(tick))) {
        return Err(format!(
            "a fault of processes or messages lies before tick {tick}, within the ticks since the cut: branch {instead}"
        ));
    }
    let reach = |loaded: &Loaded, from: &[NamedSaved]| {
        let reached = chain::advance(&loaded.robot, &loaded.scenario, from, tick);
        reached.map_err(|error| error.to_string())
    };
    let (saved, was) = reach(before, &from.saved)?
        .ok_or_else(|| format!("the run does not come to tick {tick} again: branch {instead}"))?;
    let next = reach(after, &saved)?.ok_or("with these settings no tick follows")?;
    follows(tick, &was.control_state, &next.1.control_state)?;
    Ok(Begin { tick, saved })
}

/// Whether a branch that begins at a tick follows the path of the arm: by the law's account of the tick in the run and in the branch.
fn follows(tick: u64, was: &ControlState, is: &ControlState) -> Result<(), String> {
    // A NaN is no small step.
    let is_near = |a: &[f64], b: &[f64], most: f64| {
        let mut pairs = a.iter().zip(b);
        pairs.all(|(a, b)| (a - b).abs() <= most)
    };
    let [position, orientation] = MOST_STEP;
    if is_near(&was.p_BE_d, &is.p_BE_d, position) && is_near(&was.R_BE_d, &is.R_BE_d, orientation) {
        return Ok(());
    }
    let off = was
        .p_BE_d
        .iter()
        .zip(&is.p_BE_d)
        .map(|(a, b)| (a - b).powi(2));
    Err(format!(
        "with these settings the path is not where the arm is at tick {tick}, but {:.1} mm off: change what comes later",
        off.sum::<f64>().sqrt() * 1e3
    ))
}

impl Origin {
    /// Gives a job's run the record of this one before the tick from which it goes on, and what is saved there. Returns the latter.
    ///
    /// # Errors
    /// [`Failure::Input`] if the record cannot be read, [`Failure::Work`] if it cannot be written.
    pub(crate) fn hand_over(&self, job: &Job) -> Result<Begin, Failure> {
        let Begin { tick, saved } = &self.begin;
        if *tick == 0 {
            return Ok(self.begin.clone());
        }
        let (path, contents) = (job.out.join(MESSAGES), Contents::of(job));
        let earlier = RecordReader::open_before(&self.record, &Contents::of(&self.job), *tick);
        let cut = Cut {
            tick: *tick,
            processes: saved.clone(),
        };
        RecordWriter::continuing(&path, &contents, &mut earlier.map_err(Failure::input)?)
            .and_then(|mut record| {
                record.cut(&cut)?;
                record.finish()
            })
            .map_err(Failure::work)?;
        Ok(self.begin.clone())
    }

    /// Another run does not take the folder of this one.
    ///
    /// # Errors
    /// [`Failure::Input`] if it would.
    pub(crate) fn spare(&self, folder: &Path) -> Result<(), Failure> {
        let own = self.record.parent().and_then(|of| of.canonicalize().ok());
        match own == folder.canonicalize().ok() {
            false => Ok(()),
            true => Err(Failure::Input(format!(
                "{} is the folder of the run to go on from: choose another with --out",
                folder.display()
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_run_and_a_tick() {
        let place: Place = "runs/a@b@250".parse().unwrap();
        assert_eq!((place.run, place.tick), ("runs/a@b".into(), 250));
        for other in ["runs/a", "@3", "runs/a@", "runs/a@-1", "runs/a@1.5"] {
            assert!(other.parse::<Place>().is_err(), "{other}");
        }
    }
}
