//! The course of a run, as it changes: the lanes of the state timeline and the lines of the log. PURE.

use shared_types::codes::{DRIVES, MODES, PHASES, name_of, singularity_name};
use shared_types::event::{Event, Level};
use shared_types::fault::Kind;
use shared_types::summary::FaultSummary;
use shared_types::topics::CHAIN;
use shared_types::{Message, PlantState};

use crate::entity;
use crate::facts::Facts;
use crate::narration::{NO_FAULT, capital, named_colour};
use crate::pose::Rgba;
use crate::run::Tick;

/// A message that is missing for so many ticks is late, not absent.
const PATIENCE: u64 = 3;
/// How long a process counts as restarted; s.
const FRESH_S: f64 = 0.5;

/// A singularity of the arm.
#[derive(Clone)]
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) kind: u32,
    pub(crate) colour: Rgba,
    pub(crate) colour_name: &'static str,
}

/// The subject of a lane of the state timeline.
#[derive(Clone, Copy)]
enum What {
    Fault,
    /// The writer of a topic of [`CHAIN`], by its place there; the recorder behind them.
    Process(usize),
    Drive,
    Phase,
    /// The action of control at a singularity.
    Mode(usize),
}

/// A lane. The viewer names it by its path and orders lanes by it: it is as short as can be, with a number in front where lanes have an order.
struct Lane {
    what: What,
    name: String,
    path: String,
    state: String,
}

impl Lane {
    fn new(what: What, name: impl Into<String>, path: impl Into<String>) -> Self {
        Self {
            what,
            name: name.into(),
            path: path.into(),
            state: String::new(),
        }
    }
}

/// A piece of news.
pub(crate) enum News<'a> {
    /// A lane of the state timeline changes.
    State {
        /// `mode/wrist`, `process/plant`, `drive`, `phase`, `fault`.
        name: &'a str,
        /// Its place in a recording.
        path: &'a str,
        state: &'a str,
    },
    Line(&'a Event),
}

/// A fault: in force from `tick` until `until`, in words for its lane and for the headline.
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
        let length = if is_down {
            recovered.map(|ticks| planned.unwrap_or(ticks))
        } else {
            planned.or(plan.map(|plan| ticks(plan.kind.usual_length_s())))
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

/// The messages of a process so far.
#[derive(Default)]
struct Life {
    /// For how many ticks its message has been missing.
    missing: u64,
    incarnation: u32,
    /// Until when it counts as restarted.
    fresh_until: u64,
}

/// A run's story so far.
pub(crate) struct Story {
    lanes: Vec<Lane>,
    pub(crate) faults: Vec<Fault>,
    /// The singularities, in the report's order; none before the first report.
    pub(crate) named: Vec<Named>,
    fresh: u64,
    /// By the place in [`CHAIN`] of the topic that it writes.
    lives: [Life; CHAIN.len()],
}

impl Story {
    pub(crate) fn new(facts: &Facts) -> Self {
        let mut faults: Vec<Fault> = facts
            .happened
            .faults
            .iter()
            .filter_map(|fault| Fault::of(fault, facts.rate_hz))
            .collect();
        faults.sort_by_key(|fault| fault.tick);
        let mut lanes = vec![Lane::new(What::Fault, "fault", entity::FAULT)];
        for life in entity::lives(&facts.job.graph) {
            let (path, what) = (entity::life(&life), What::Process(life.0));
            lanes.push(Lane::new(what, format!("process/{}", life.1), path));
        }
        lanes.push(Lane::new(What::Drive, "drive", entity::DRIVE));
        lanes.push(Lane::new(What::Phase, "phase", entity::PHASE));
        Self {
            lanes,
            faults,
            named: Vec::new(),
            fresh: (FRESH_S * f64::from(facts.rate_hz)) as u64,
            lives: Default::default(),
        }
    }

    /// The fault in force at a tick: of several the one that came last.
    pub(crate) fn fault(&self, tick: u64) -> Option<&Fault> {
        let mut all = self.faults.iter().rev();
        all.find(|fault| (fault.tick..fault.until).contains(&tick))
    }

    /// Takes a tick in, and tells what is new in it.
    pub(crate) fn push(&mut self, row: &Tick, tell: &mut dyn FnMut(u64, News)) {
        if self.named.is_empty() {
            for (i, one) in row.singularities().iter().enumerate() {
                let name = singularity_name(one.kind, i).to_owned();
                let (mode, path) = (format!("mode/{name}"), format!("/{name}"));
                self.lanes.push(Lane::new(What::Mode(i), mode, path));
                let (colour_name, colour) = named_colour(one.kind, i);
                self.named.push(Named {
                    name,
                    kind: one.kind,
                    colour,
                    colour_name,
                });
            }
        }
        for event in &row.events {
            tell(event.tick, News::Line(event));
        }
        for k in 0..self.lanes.len() {
            let state = self.state(k, row, tell);
            let lane = &mut self.lanes[k];
            if state.is_empty() || state == lane.state {
                continue;
            }
            let before = std::mem::replace(&mut lane.state, state);
            let news = News::State {
                name: &lane.name,
                path: &lane.path,
                state: &lane.state,
            };
            tell(row.tick, news);
            if let (What::Mode(i), false) = (lane.what, before.is_empty()) {
                let text = format!("{}: {before} → {}", self.named[i].name, lane.state);
                tell_line(row.tick, Level::Info, text, tell);
            }
        }
    }

    /// The text of a lane; none if it is not known.
    fn state(&mut self, k: usize, row: &Tick, tell: &mut dyn FnMut(u64, News)) -> String {
        let state = match self.lanes[k].what {
            What::Fault => self
                .fault(row.tick)
                .map_or(NO_FAULT.0, |fault| fault.lane.as_str()),
            What::Process(place) if place == CHAIN.len() => self.recorder(k, row.tick),
            What::Process(place) => self.life(k, place, row, tell),
            What::Drive => row.sensor.map_or("", |m| name_of(DRIVES, m.drive)),
            What::Phase => row.torque.map_or("", |m| name_of(PHASES, m.phase)),
            What::Mode(i) => row.control_state.map_or("", |m| name_of(MODES, m.mode[i])),
        };
        state.to_owned()
    }

    /// The name of the process of a lane.
    fn process(&self, k: usize) -> &str {
        self.lanes[k].name.trim_start_matches("process/")
    }

    /// The recorder sends nothing: its faults tell.
    fn recorder(&self, k: usize, tick: u64) -> &'static str {
        let mut begun = self.faults.iter().rev().filter(|fault| fault.tick <= tick);
        match begun.find(|fault| fault.process == self.process(k)) {
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
        row: &Tick,
        tell: &mut dyn FnMut(u64, News),
    ) -> &'static str {
        let headers = row.headers();
        let [sensor, estimate, report, _] = headers.map(|header| header.is_some());
        let plant = row.plant_state.as_ref().map(PlantState::header);
        let header = headers[i].or(plant.filter(|_| i == 0));
        let life = &mut self.lives[i];
        let Some(incarnation) = header.map(|header| header.incarnation) else {
            life.missing += 1;
            let has_input = [true, sensor, estimate, estimate && report][i];
            return match has_input {
                _ if life.missing < PATIENCE && !self.lanes[k].state.is_empty() => "",
                true => "silent",
                false => "waiting",
            };
        };
        life.missing = 0;
        let before = life.incarnation;
        life.incarnation = before.max(incarnation);
        if before > 0 && incarnation > before {
            life.fresh_until = row.tick + self.fresh;
            let name = self.process(k);
            let text = format!("{name} is back as incarnation {incarnation}");
            tell_line(row.tick, Level::Warning, text, tell);
        }
        if row.tick < self.lives[i].fresh_until {
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
    use crate::recording::tests::job;
    use crate::run::Happened;
    use shared_types::{SensorSample, SingularityReport, StateEstimate, TorqueCommand};

    /// A writer whose input is missing waits, one that has it is silent; both after a few ticks.
    #[test]
    fn missing_messages_are_told() {
        let (job, robot) = job("fig5-wrist-rotation");
        let facts = Facts::new(&job, &robot, Happened::default(), false).expect("six joints");
        let mut story = Story::new(&facts);
        let (mut states, mut lines) = (Vec::new(), Vec::new());
        for number in 0..100 {
            let is_missing = (20..60).contains(&number);
            let mut tick = Tick {
                tick: number,
                ..Tick::default()
            };
            tick.messages.sensor = Some(SensorSample::default());
            tick.messages.estimate = Some(StateEstimate::default());
            if !is_missing {
                let mut report = SingularityReport::default();
                report.header.incarnation = if number < 60 { 1 } else { 2 };
                tick.messages.singularity = Some(report);
                tick.messages.torque = Some(TorqueCommand::default());
            }
            story.push(&tick, &mut |tick, news| match news {
                News::State { name, state, .. } => states.push((name.to_owned(), state.to_owned())),
                News::Line(event) => lines.push((tick, event.level)),
            });
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
