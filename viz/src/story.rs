//! The course of a run, as it changes: the lanes of the state timeline and the lines of the log. PURE.

use shared_types::Message;
use shared_types::codes::{DRIVES, MODES, PHASES, name_of, singularity_name};
use shared_types::event::{Event, Level};
use shared_types::fault::Kind;
use shared_types::graph::Graph;
use shared_types::job::Job;
use shared_types::summary::FaultSummary;
use shared_types::topics::CHAIN;

use crate::entity;
use crate::narration::{NO_FAULT, capital};
use crate::run::Happened;
use crate::signals::TickRow;

/// A message that is missing for so many ticks is late, not absent.
const PATIENCE: u64 = 3;
/// How long a process counts as restarted; s.
const FRESH_S: f64 = 0.5;

/// The subject of a lane of the state timeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum What {
    /// The writer of a topic of [`CHAIN`], by its place there; the recorder behind them.
    Process(usize),
    Drive,
    Phase,
    /// The action of control at a singularity.
    Mode(usize),
}

/// A lane but that of the faults. The viewer names it by its path and orders lanes by it: it is as short as can be, with a number in front where
/// lanes have an order.
struct Lane {
    what: What,
    name: String,
    path: String,
    state: &'static str,
}

impl Lane {
    fn new(what: What, name: String, path: String) -> Self {
        Self {
            what,
            name,
            path,
            state: "",
        }
    }
}

/// A piece of news.
#[derive(Debug)]
pub(crate) enum News<'a> {
    /// A lane of the state timeline changes.
    State {
        /// `mode/wrist`, `process/plant`, `drive`, `phase`, `fault`.
        name: &'a str,
        /// Its place in a recording.
        path: &'a str,
        /// The singularity of a lane of modes.
        of: Option<usize>,
        state: &'a str,
    },
    Line(&'a Event),
}

/// A fault: in force from `tick` until `until`, in words for its lane and for the headline.
#[derive(Clone, Debug)]
pub(crate) struct Fault {
    process: String,
    tick: u64,
    until: u64,
    pub(crate) lane: String,
    pub(crate) headline: String,
}

impl Fault {
    /// `None` for one that has not come to pass.
    fn of(fault: &FaultSummary, rate_hz: u32) -> Option<Self> {
        let (lane, headline) = words(fault);
        let ticks = |length_s: f64| (length_s * f64::from(rate_hz)).ceil() as u64;
        let plan = fault.plan.as_ref();
        let planned = plan.and_then(|plan| plan.for_ticks.or(plan.for_s.map(ticks)));
        // A process that is gone has recovered when it sends again; a fault of messages, sensors or drives ends with its ticks.
        let is_down = plan.is_none_or(|plan| plan.kind.takes_down());
        let recovered = fault.recovered_ms.map(|ms| ticks(1e-3 * ms));
        let length = match is_down {
            true => recovered.map(|ticks| planned.unwrap_or(ticks)),
            false => planned.or(plan.map(|plan| ticks(plan.kind.usual_length_s()))),
        };
        let until = length.map_or(u64::MAX, |length| fault.tick.saturating_add(length.max(1)));
        fault.occurred.then(|| Self {
            process: fault.process.clone(),
            tick: fault.tick,
            until,
            lane,
            headline,
        })
    }
}

/// A fault for its lane, `controller kill`, and for the headline, `Controller killed`.
fn words(fault: &FaultSummary) -> (String, String) {
    let process = capital(&fault.process);
    let (lane, ended) = (
        format!("{} {}", fault.process, fault.kind),
        format!("{process} ended"),
    );
    let Some(plan) = fault.plan.as_ref().filter(|_| fault.kind != "exit") else {
        return (lane, ended);
    };
    let way = plan.way.map_or(String::new(), |way| format!(" {way}"));
    let joint = plan
        .joint
        .map_or(String::new(), |joint| format!(" of joint {joint}"));
    let headline = match plan.kind {
        Kind::Kill => format!("{process} killed"),
        Kind::Crash => format!("{process} crashed"),
        Kind::Hang => format!("{process} hangs"),
        Kind::Sensor => format!("Sensor{way}{joint}"),
        Kind::Drive => format!("Drive{way}{joint}"),
        kind => format!("{process}: {kind}{way}"),
    };
    (format!("{} {}{way}", fault.process, plan.kind), headline)
}

/// A run's story so far.
pub(crate) struct Story {
    lanes: Vec<Lane>,
    pub(crate) faults: Vec<Fault>,
    /// Names of the singularities, in the report's order; none before the first report.
    pub(crate) names: Vec<String>,
    fresh: u64,
    /// The words of the lane of faults.
    fault: Option<String>,
    /// For how many ticks each writer's message has been missing, its incarnation, and until when it counts as restarted.
    missing: [u64; CHAIN.len()],
    incarnations: [u32; CHAIN.len()],
    fresh_until: [u64; CHAIN.len()],
}

impl Story {
    pub(crate) fn new(job: &Job, happened: &Happened) -> Self {
        let rate_hz = job.scenario.rate_hz.max(1);
        let faults = happened.faults.iter();
        let faults = faults.filter_map(|fault| Fault::of(fault, rate_hz));
        Self::of(
            &job.graph,
            faults.collect(),
            (FRESH_S * f64::from(rate_hz)) as u64,
        )
    }

    fn of(graph: &Graph, mut faults: Vec<Fault>, fresh: u64) -> Self {
        faults.sort_by_key(|fault| fault.tick);
        let lives = entity::lives(graph).into_iter().map(|life| {
            let path = entity::life(&life);
            Lane::new(What::Process(life.0), format!("process/{}", life.1), path)
        });
        let others = [
            (What::Drive, "drive", entity::DRIVE),
            (What::Phase, "phase", entity::PHASE),
        ];
        let others =
            others.map(|(what, name, path)| Lane::new(what, name.to_owned(), path.to_owned()));
        Self {
            lanes: lives.chain(others).collect(),
            faults,
            names: Vec::new(),
            fresh,
            fault: None,
            missing: [0; _],
            incarnations: [0; _],
            fresh_until: [0; _],
        }
    }

    /// The fault in force at a tick: of several the one that came last.
    pub(crate) fn fault(&self, tick: u64) -> Option<&Fault> {
        let mut all = self.faults.iter().rev();
        all.find(|fault| (fault.tick..fault.until).contains(&tick))
    }

    /// Takes a tick in, and tells what is new in it.
    pub(crate) fn push(&mut self, row: &TickRow, tell: &mut dyn FnMut(u64, News)) {
        if self.names.is_empty() {
            for (i, one) in row.singularities().iter().enumerate() {
                let name = singularity_name(one.kind, i).to_owned();
                let path = format!("/{name}");
                self.lanes
                    .push(Lane::new(What::Mode(i), format!("mode/{name}"), path));
                self.names.push(name);
            }
        }
        for event in row.events {
            tell(event.tick, News::Line(event));
        }
        let fault = self.fault(row.tick);
        let fault = fault.map_or(NO_FAULT.0, |fault| fault.lane.as_str());
        if self.fault.as_deref() != Some(fault) {
            let state = fault;
            let (name, path, of) = ("fault", entity::FAULT, None);
            let news = News::State {
                name,
                path,
                of,
                state,
            };
            tell(row.tick, news);
            self.fault = Some(fault.to_owned());
        }
        for k in 0..self.lanes.len() {
            let state = self.state(k, row, tell);
            if state.is_empty() || state == self.lanes[k].state {
                continue;
            }
            let before = std::mem::replace(&mut self.lanes[k].state, state);
            let Lane {
                what, name, path, ..
            } = &self.lanes[k];
            let of = match what {
                What::Mode(i) => Some(*i),
                _ => None,
            };
            let news = News::State {
                name,
                path,
                of,
                state,
            };
            tell(row.tick, news);
            if let (Some(i), false) = (of, before.is_empty()) {
                let text = format!("{}: {before} → {state}", self.names[i]);
                tell_line(row.tick, Level::Info, text, tell);
            }
        }
    }

    /// The text of a lane; none if it is not known.
    fn state(&mut self, k: usize, row: &TickRow, tell: &mut dyn FnMut(u64, News)) -> &'static str {
        let (torque, sensor) = (row.torque, row.sensor);
        match self.lanes[k].what {
            What::Process(place) if place == CHAIN.len() => self.recorder(k, row.tick),
            What::Process(place) => self.life(k, place, row, tell),
            What::Drive => sensor.map_or("", |sensor| name_of(DRIVES, sensor.drive)),
            What::Phase => torque.map_or("", |torque| name_of(PHASES, torque.phase)),
            What::Mode(i) => row
                .control_state
                .map_or("", |state| name_of(MODES, state.mode[i])),
        }
    }

    /// The name of the process of a lane.
    fn process(&self, k: usize) -> &str {
        self.lanes[k].name.trim_start_matches("process/")
    }

    /// The recorder sends nothing: its faults tell.
    fn recorder(&self, k: usize, tick: u64) -> &'static str {
        let own = self
            .faults
            .iter()
            .filter(|fault| fault.process == self.process(k));
        match own.rev().find(|fault| fault.tick <= tick) {
            Some(fault) if tick < fault.until => "silent",
            Some(fault) if tick < fault.until.saturating_add(self.fresh) => "restarted",
            _ => "up",
        }
    }

    /// The state of a process. A writer whose own input is missing waits; one that has its input and writes nothing is silent.
    fn life(
        &mut self,
        k: usize,
        i: usize,
        row: &TickRow,
        tell: &mut dyn FnMut(u64, News),
    ) -> &'static str {
        let header = match i {
            0 => row
                .sensor
                .map(Message::header)
                .or(row.plant_state.map(Message::header)),
            1 => row.estimate.map(Message::header),
            2 => row.singularity.map(Message::header),
            _ => row.torque.map(Message::header),
        };
        let has_input = match i {
            0 => true,
            1 => row.sensor.is_some(),
            2 => row.estimate.is_some(),
            _ => row.estimate.is_some() && row.singularity.is_some(),
        };
        let Some(incarnation) = header.map(|header| header.incarnation) else {
            self.missing[i] += 1;
            return match has_input {
                _ if self.missing[i] < PATIENCE && !self.lanes[k].state.is_empty() => "",
                true => "silent",
                false => "waiting",
            };
        };
        self.missing[i] = 0;
        let before = self.incarnations[i];
        self.incarnations[i] = before.max(incarnation);
        if before > 0 && incarnation > before {
            let name = self.process(k);
            let text = format!("{name} is back as incarnation {incarnation}");
            tell_line(row.tick, Level::Warning, text, tell);
            self.fresh_until[i] = row.tick + self.fresh;
        }
        if row.tick < self.fresh_until[i] {
            "restarted"
        } else {
            "up"
        }
    }
}

fn tell_line(tick: u64, level: Level, text: String, tell: &mut dyn FnMut(u64, News)) {
    let event = Event {
        tick,
        level,
        text,
        ..Event::default()
    };
    tell(tick, News::Line(&event));
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::topics::ByTopic;
    use shared_types::{SensorSample, SingularityReport, StateEstimate, TorqueCommand};

    /// A writer whose input is missing waits, one that has it is silent; both after a few ticks.
    #[test]
    fn missing_messages_are_told() {
        let graph = Graph::built_in(false).expect("valid");
        let mut story = Story::of(&graph, Vec::new(), 500);
        let sensor = SensorSample::default();
        let estimate = StateEstimate::default();
        let (mut report, torque) = <(SingularityReport, TorqueCommand)>::default();
        let (mut states, mut lines) = (Vec::new(), Vec::new());
        for tick in 0..100 {
            report.header.incarnation = if tick < 60 { 1 } else { 2 };
            let is_missing = (20..60).contains(&tick);
            let messages = ByTopic {
                sensor: Some(&sensor),
                estimate: Some(&estimate),
                singularity: Some(&report).filter(|_| !is_missing),
                torque: Some(&torque).filter(|_| !is_missing),
                ..ByTopic::default()
            };
            story.push(
                &TickRow::new(tick, messages),
                &mut |tick, news| match news {
                    News::State { name, state, .. } => {
                        states.push((name.to_owned(), state.to_owned()))
                    }
                    News::Line(event) => lines.push((tick, event.level)),
                },
            );
        }
        for (process, expected) in [
            ("analyzer", &["up", "silent", "restarted"][..]),
            ("estimator", &["up"]),
            ("controller", &["up", "waiting", "up"]),
        ] {
            let own = states
                .iter()
                .filter(|(name, _)| *name == format!("process/{process}"));
            let own: Vec<&str> = own.map(|(_, state)| state.as_str()).collect();
            assert_eq!(own, expected, "{process}");
        }
        assert_eq!(lines, [(60, Level::Warning)]);
    }
}
