//! Faults, as people write them (`[[fault]]` in a scenario, `armplane fault`) and as the processes
//! carry them out.
//!
//! ```toml
//! [[fault]]                 # the controller is killed at tick 1200; its replacement may answer 100 ticks later
//! process = "controller"
//! kind = "kill"
//! at_tick = 1200
//!
//! [[fault]]                 # joint 5's encoder reads 0.02 rad too much for half a second
//! process = "plant"
//! kind = "sensor"
//! as = "bias"
//! joint = 5
//! amount = 0.02
//! at_s = 1.5
//! for_s = 0.5
//! ```
//!
//! A fault is tied to ticks, so a run with planned faults has the same bytes every time. A
//! [`Fault`] becomes a [`ScheduledFault`], the fixed-size form that all processes of a run share. A
//! scheduled fault can be turned back into the fault that repeats it.

mod kind;
mod scheduled;

use bytemuck::Zeroable as _;
use serde::{Deserialize, Serialize};

use crate::file::{Complaint, require};
use crate::process::Role;
use crate::wire::{Field, Message};
use crate::{ControlState, PlantState};

use kind::{DELAY_TICKS, Rule};

pub use kind::{Kind, MOST_DELAY_TICKS, Way};
pub use scheduled::ScheduledFault;

/// The finest steps of an encoder that is at fault; rad. Finer ones are no steps in 64 bits.
const FINEST_STEP: f64 = 1e-12;

/// One fault. Give each time either in ticks or in seconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Name of the process.
    pub process: String,
    /// Kind of fault.
    pub kind: Kind,
    /// Variant, for kinds that have several.
    #[serde(rename = "as", skip_serializing_if = "Option::is_none")]
    pub way: Option<Way>,
    /// First tick of the fault.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_tick: Option<u64>,
    /// The same; s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_s: Option<f64>,
    /// Duration; ticks. For `kill` and `crash`: ticks until the replacement may answer.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub for_ticks: Option<u64>,
    /// The same; s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// Share of messages affected, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// `delay`: ticks by which each message is late.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delay_ticks: Option<u64>,
    /// `delay`: up to this many further ticks, evenly distributed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jitter_ticks: Option<u64>,
    /// `corrupt`: the field of the message, such as `tau[2]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// `cut`: the topic that no longer arrives. Default: the first that the process reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// `sensor`, `drive`: the joint, counted from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<u32>,
    /// Size of the fault, in the unit of its variant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amount: Option<f64>,
    /// Seed of the fault's random numbers. Default: from the scenario's seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

/// The process that a fault applies to, as its graph has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Its place in the manifest.
    pub index: u32,
    /// Its part in the run.
    pub role: Role,
    /// Its step is done by a program of others, or by a robot.
    pub is_foreign: bool,
    /// The fields of the message that a corruption concerns: the first that faults shape.
    pub fields: Vec<Field>,
    /// The topics that it reads, in the order of the graph.
    pub reads: Vec<String>,
}

impl Target {
    /// The process at a place of the manifest that sends messages of type `M`.
    #[must_use]
    pub fn sending<M: Message>(index: u32, role: Role) -> Self {
        Self {
            index,
            role,
            is_foreign: false,
            fields: M::FIELDS.to_vec(),
            reads: Vec::new(),
        }
    }
}

/// The topic of a process whose messages a corruption concerns: the first that faults shape.
#[must_use]
pub fn corrupted_topic(writes: &[String]) -> Option<&str> {
    writes
        .iter()
        .map(String::as_str)
        .find(|topic| shaped_topic(topic))
}

/// Whether faults of a process change the messages of this topic. Messages for judging and showing
/// only are never changed.
#[must_use]
pub fn shaped_topic(topic: &str) -> bool {
    topic != PlantState::TOPIC && topic != ControlState::TOPIC
}

impl ScheduledFault {
    /// The fault that repeats it, for the process of that name.
    #[must_use]
    pub fn fault(&self, process: &str, on: &Target) -> Option<Fault> {
        let kind = self.kind()?;
        let way = self.way().filter(|_| !kind.known_ways().is_empty());
        let at = self.target as usize;
        let field = on
            .fields
            .iter()
            .find(|field| (field.offset..field.offset + field.size).contains(&at));
        let field = field
            .map(|field| format!("{}[{}]", field.name, (at - field.offset) / size_of::<f64>()));
        Some(Fault {
            way,
            at_tick: Some(self.at),
            for_ticks: (self.until != u64::MAX).then(|| self.until.saturating_sub(self.at)),
            probability: kind.has_probability().then_some(self.probability),
            delay_ticks: (kind == Kind::Delay).then_some(self.amount as u64),
            jitter_ticks: (kind == Kind::Delay && self.jitter > 0).then_some(self.jitter),
            field: field.filter(|_| kind == Kind::Corrupt),
            topic: on.reads.get(at).filter(|_| kind == Kind::Cut).cloned(),
            joint: kind.concerns_joint().then_some(self.target + 1),
            amount: (kind != Kind::Delay && self.amount != 0.0).then_some(self.amount),
            seed: (kind.has_probability() || matches!(kind, Kind::Delay | Kind::Sensor))
                .then_some(self.seed),
            ..Fault::new(process, kind)
        })
    }

    /// Whether it ends its process, by itself or through the launcher.
    #[must_use]
    pub fn ends_process(&self) -> bool {
        self.kind()
            .is_some_and(|kind| kind.ends_process(self.way()))
    }

    /// The end of a process that no plan had: the kill that repeats it.
    #[must_use]
    pub fn death(process: u32, at: u64, rate_hz: u32) -> Self {
        let length = (Kind::Kill.usual_length_s() * f64::from(rate_hz))
            .round()
            .max(1.0) as u64;
        Self {
            process,
            kind: Kind::Kill as u32,
            at,
            until: at.saturating_add(length),
            probability: 1.0,
            ..Self::zeroed()
        }
    }
}

impl Fault {
    /// A fault of a process, everything else by default, from tick 0 on.
    #[must_use]
    pub fn new(process: &str, kind: Kind) -> Self {
        Self {
            process: process.to_owned(),
            kind,
            ..Self::default()
        }
    }

    /// The checks that do not need the graph.
    ///
    /// # Errors
    /// See [`Fault::schedule`].
    pub fn check(&self, rate_hz: u32) -> Result<(), Complaint> {
        self.timed(0, 0, rate_hz, 0).map(drop)
    }

    /// Whether it has a time, as each planned fault needs one.
    ///
    /// # Errors
    /// [`Complaint`] about a fault without one.
    pub(crate) fn check_time(&self) -> Result<(), Complaint> {
        require(
            self.at_tick.is_some() || self.at_s.is_some(),
            "kind",
            format!("the fault `{}` has no time", self.kind),
            "add at_s = 1.0, or at_tick = 0 for the first tick",
        )
    }

    /// Its fixed-size form at a control rate, for a process of the graph; `seed` where it names none.
    ///
    /// # Errors
    /// [`Complaint`], its path relative to the fault: an argument that does not belong to its kind, or is out of range.
    pub fn schedule(
        &self,
        on: &Target,
        rate_hz: u32,
        seed: u64,
    ) -> Result<ScheduledFault, Complaint> {
        let kind = self.kind;
        let process = &self.process;
        let names: Vec<_> = kind.roles().iter().map(|role| role.about()).collect();
        require(
            kind.roles().contains(&on.role),
            "kind",
            format!("`{kind}` cannot happen to the {process}"),
            format!("it can happen to {}", names.join(" and to ")),
        )?;
        require(
            !(kind.concerns_joint() && on.is_foreign),
            "kind",
            format!(
                "the {process}'s sensors and drives are not armplane's own: a `{kind}` fault would not take effect there"
            ),
            "simulate the arm by armplane, or corrupt its messages: kind = \"corrupt\"",
        )?;
        let is_joint = self.joint != Some(0);
        require(
            is_joint,
            "joint",
            "there is no joint 0",
            "joints count from 1",
        )?;
        let target = match kind {
            Kind::Corrupt => self.corrupted_place(&on.fields)?,
            Kind::Cut => self.cut_topic(&on.reads)?,
            _ => self.joint.map_or(0, |joint| joint - 1),
        };
        self.timed(on.index, target, rate_hz, seed)
    }

    /// The amount given, or the usual one of its kind in this way.
    fn checked_amount(&self, way: Option<Way>) -> Result<f64, Complaint> {
        let usual = way.map(|way| self.kind.usual_amount(way));
        let amount = self.amount.or(usual).unwrap_or(0.0);
        require(
            (-1e12..=1e12).contains(&amount),
            "amount",
            format!("an amount of {amount}"),
            "a number in the unit of the fault's way; `armplane fault --list`",
        )?;
        require(
            way != Some(Way::Quantise) || amount >= FINEST_STEP,
            "amount",
            format!("steps of {amount:e} rad"),
            format!("at least {FINEST_STEP:e}"),
        )?;
        Ok(amount)
    }

    fn timed(
        &self,
        index: u32,
        target: u32,
        rate_hz: u32,
        seed: u64,
    ) -> Result<ScheduledFault, Complaint> {
        let (kind, rule) = (self.kind, self.kind.rule());
        self.refuse_what_does_not_belong(rule)?;
        let at = ticks("at", self.at_tick, self.at_s, rate_hz)?.unwrap_or(0);
        let usual = (rule.lasts_s * f64::from(rate_hz)).round().max(1.0) as u64;
        let length = ticks("for", self.for_ticks, self.for_s, rate_hz)?.unwrap_or(usual);
        let remedy = "leave it out for the usual length";
        require(length > 0, "for_ticks", "a fault of no length", remedy)?;
        let probability = self.probability.unwrap_or(1.0);
        require(
            probability > 0.0 && probability <= 1.0,
            "probability",
            format!("a probability of {probability}"),
            "more than 0, at most 1",
        )?;
        let way = self.way.or(kind.ways().next());
        let delay = self.delay_ticks.unwrap_or(DELAY_TICKS);
        let amount = match kind {
            Kind::Delay => delay as f64,
            _ => self.checked_amount(way)?,
        };
        let jitter = self.jitter_ticks.unwrap_or(0);
        require(
            kind != Kind::Delay || delay.saturating_add(jitter) <= MOST_DELAY_TICKS,
            "delay_ticks",
            "a delay too long for the buffers of the chain",
            format!(
                "with its jitter at most {MOST_DELAY_TICKS}; a longer one is a `drop` or a `hang`"
            ),
        )?;
        Ok(ScheduledFault {
            process: index,
            kind: kind as u32,
            way: way.map_or(0, |way| way as u32),
            target,
            at,
            until: at.saturating_add(length),
            probability,
            amount,
            jitter,
            seed: self.seed.unwrap_or(seed),
        })
    }

    fn refuse_what_does_not_belong(&self, rule: Rule) -> Result<(), Complaint> {
        let kind = self.kind;
        if let Some(way) = self.way {
            let ways: Vec<_> = kind.ways().map(Way::name).collect();
            let remedy = if ways.is_empty() {
                "leave it out".to_owned()
            } else {
                format!("it comes as: {}", ways.join(", "))
            };
            let message = format!("`{kind}` does not come as `{way}`");
            require(kind.ways().any(|one| one == way), "as", message, remedy)?;
        }
        let has_amount = kind.known_ways().iter().any(|way| way.1 != 0.0);
        let given = [
            ("probability", self.probability.is_some()),
            ("field", self.field.is_some()),
            ("topic", self.topic.is_some()),
            ("joint", self.joint.is_some()),
            ("delay_ticks", self.delay_ticks.is_some()),
            ("jitter_ticks", self.jitter_ticks.is_some()),
            ("amount", self.amount.is_some() && !has_amount),
        ];
        let stray = given
            .iter()
            .find(|(key, is_given)| *is_given && !rule.keys.contains(key));
        stray.map_or(Ok(()), |(key, _)| {
            let message = format!("`{kind}` has no `{key}`");
            let remedy = "leave it out; see `armplane fault --list`";
            Err(Complaint::new(*key, message, remedy))
        })
    }

    /// The place among the topics that a process reads of the one that is cut.
    fn cut_topic(&self, reads: &[String]) -> Result<u32, Complaint> {
        let place = self
            .topic
            .as_ref()
            .map_or(Some(0), |topic| reads.iter().position(|read| read == topic));
        place.map(|place| place as u32).ok_or_else(|| {
            let message = format!(
                "the {} does not read `{}`",
                self.process,
                self.topic.as_deref().unwrap_or_default()
            );
            Complaint::new("topic", message, format!("it reads {}", reads.join(", ")))
        })
    }

    /// Where the number lies that it corrupts, in bytes; by default the first number of the message.
    fn corrupted_place(&self, fields: &[Field]) -> Result<u32, Complaint> {
        let numbers = fields.iter().filter(|field| field.is_number());
        let process = &self.process;
        let numbers: Vec<&Field> = numbers.collect();
        let known: Vec<&str> = numbers.iter().map(|field| &*field.name).collect();
        let Some(first) = known.first() else {
            return Err(Complaint::new(
                "kind",
                format!("the {process} sends no plain number that could be corrupted"),
                "take another process, or another kind: `armplane fault --list`",
            ));
        };
        let text = self.field.as_deref().unwrap_or(first);
        let indexed = text.strip_suffix(']').and_then(|text| text.split_once('['));
        let (name, place) = indexed.unwrap_or((text, "0"));
        let place: usize = place.parse().map_err(|_| {
            let message = format!("`{place}` is not a place in a field");
            Complaint::new("field", message, "as in `tau[2]`, from 0")
        })?;
        let field = numbers
            .iter()
            .find(|field| field.name == name)
            .ok_or_else(|| {
                let message = format!("the {process} sends no number `{name}`");
                Complaint::new("field", message, format!("it sends {}", known.join(", ")))
            })?;
        let length = field.size / size_of::<f64>();
        require(
            place < length,
            "field",
            format!("`{name}` has {length} places, there is no place {place}"),
            format!("0 to {}", length - 1),
        )?;
        Ok((field.offset + place * size_of::<f64>()) as u32)
    }
}

/// Ticks from either spelling.
fn ticks(
    what: &str,
    ticks: Option<u64>,
    seconds: Option<f64>,
    rate_hz: u32,
) -> Result<Option<u64>, Complaint> {
    match (ticks, seconds) {
        (Some(_), Some(_)) => Err(Complaint::new(
            format!("{what}_s"),
            format!("`{what}_tick…` and `{what}_s` are both given"),
            "give one of them",
        )),
        (_, Some(s)) if !(0.0..=36_000.0).contains(&s) => Err(Complaint::new(
            format!("{what}_s"),
            format!("{s} s"),
            "0 to 36000",
        )),
        (_, Some(s)) => Ok(Some((s * f64::from(rate_hz)).round() as u64)),
        (ticks, None) => Ok(ticks),
    }
}

impl std::fmt::Display for Fault {
    /// One line: `kill of the controller at tick 1200, for 100 ticks`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.kind)?;
        if let Some(way) = self.way {
            write!(f, " ({way})")?;
        }
        write!(f, " of the {}", self.process)?;
        if let Some(joint) = self.joint {
            write!(f, ", joint {joint}")?;
        }
        for part in self.field.iter().chain(&self.topic) {
            write!(f, ", {part}")?;
        }
        if let Some(delay) = self.delay_ticks {
            write!(f, " by {delay}")?;
            if let Some(jitter) = self.jitter_ticks {
                write!(f, " to {}", delay.saturating_add(jitter))?;
            }
            write!(f, " ticks")?;
        }
        if let Some(amount) = self.amount {
            write!(f, ", {amount}")?;
            if let Some(unit) = self
                .way
                .map(|way| self.kind.unit(way))
                .filter(|unit| !unit.is_empty())
            {
                write!(f, " {unit}")?;
            }
        }
        if let Some(probability) = self.probability.filter(|&p| p < 1.0) {
            write!(f, ", {:.0} % of the messages", probability * 100.0)?;
        }
        match (self.at_tick, self.at_s) {
            (Some(tick), _) => write!(f, ", at tick {tick}")?,
            (None, Some(s)) => write!(f, ", at {s} s")?,
            (None, None) => {}
        }
        match (self.for_ticks, self.for_s) {
            (Some(ticks), _) => write!(f, ", for {ticks} ticks"),
            (None, Some(s)) => write!(f, ", for {s} s"),
            (None, None) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{BUILT_IN, Graph};

    fn parse(text: &str) -> Fault {
        toml::from_str(text).unwrap()
    }

    fn graph() -> Graph {
        Graph::parse("graph.toml", BUILT_IN).unwrap()
    }

    #[test]
    fn every_fault_repeats_itself() {
        for kind in Kind::ALL {
            assert_eq!(kind.name().parse::<Kind>(), Ok(kind));
            let suits = |process: &&crate::process::Process| kind.suits(process);
            for process in graph().process.iter().filter(suits) {
                let target = graph().target(&process.name).unwrap();
                let process = &process.name;
                let ways: Vec<_> = kind.ways().map(Some).collect();
                for way in if ways.is_empty() { vec![None] } else { ways } {
                    let fault = Fault {
                        way,
                        at_tick: Some(70),
                        ..Fault::new(process, kind)
                    };
                    let scheduled = fault.schedule(&target, 1000, 99).unwrap();
                    let again = scheduled.fault(process, &target).unwrap();
                    let seed = again.seed.unwrap_or(0);
                    let repeated = ScheduledFault { seed, ..scheduled };
                    assert_eq!(
                        again.schedule(&target, 1000, 0).unwrap(),
                        repeated,
                        "{fault}"
                    );
                    assert!(scheduled.concerns(70) && !scheduled.concerns(69));
                    assert_eq!(parse(&toml::to_string(&again).unwrap()), again);
                }
            }
        }
    }

    #[test]
    fn seconds_become_ticks_and_fields_become_places() {
        let fault = parse(
            "process='controller'\nkind='corrupt'\nas='inf'\nfield='tau[2]'\nat_s=0.25\nfor_s=0.01\nprobability=0.5",
        );
        let target = graph().target("controller").unwrap();
        let scheduled = fault.schedule(&target, 2000, 5).unwrap();
        let ScheduledFault {
            at, until, seed, ..
        } = scheduled;
        assert_eq!(
            (at, until, seed, scheduled.way()),
            (500, 520, 5, Some(Way::Inf))
        );
        let mut message = crate::TorqueCommand::default();
        message.tau[2] = 4.25;
        let place = scheduled.target as usize;
        assert_eq!(
            bytemuck::bytes_of(&message)[place..place + 8],
            4.25_f64.to_ne_bytes()
        );
        assert_eq!(
            scheduled
                .fault("controller", &target)
                .unwrap()
                .field
                .unwrap(),
            "tau[2]"
        );
    }

    #[test]
    fn sensors_and_drives_that_are_not_simulated_here_have_no_faults() {
        let plant = "[[process]]\nname = \"plant\"\nfeedback = [\"torque\"]\nwrites = [\"sensor\", \"plant_state\"]\n";
        for key in [
            "robot = \"fci://a\"",
            "command = [\"mine\"]",
            "external = true",
        ] {
            let graph = Graph::parse("g.toml", &format!("extends = \"armplane\"\n{plant}{key}\n"));
            let target = graph.unwrap().target("plant").unwrap();
            for kind in [Kind::Sensor, Kind::Drive] {
                let refused = Fault::new("plant", kind)
                    .schedule(&target, 1000, 1)
                    .unwrap_err();
                assert_eq!(refused.path, "kind", "{key}");
            }
        }
    }

    #[test]
    fn a_fault_that_makes_no_sense_is_refused_at_its_key() {
        let cases = [
            ("process='recorder'\nkind='drop'", "kind"),
            ("process='operator'\nkind='corrupt'", "kind"),
            ("process='plant'\nkind='sensor'\nas='nan'", "as"),
            ("process='plant'\nkind='sensor'\njoint=0", "joint"),
            (
                "process='plant'\nkind='kill'\nprobability=0.5",
                "probability",
            ),
            (
                "process='plant'\nkind='drop'\nprobability=2.0",
                "probability",
            ),
            ("process='plant'\nkind='drop'\nfor_ticks=0", "for_ticks"),
            ("process='plant'\nkind='drop'\nat_s=1.0\nat_tick=3", "at_s"),
            ("process='plant'\nkind='drop'\nfield='tau'", "field"),
            ("process='plant'\nkind='drop'\namount=1.0", "amount"),
            ("process='analyzer'\nkind='corrupt'\nfield='zeta'", "field"),
            (
                "process='analyzer'\nkind='corrupt'\nfield='p_BC[3]'",
                "field",
            ),
            ("process='analyzer'\nkind='cut'\ntopic='torque'", "topic"),
            (
                "process='analyzer'\nkind='delay'\ndelay_ticks=40\njitter_ticks=11",
                "delay_ticks",
            ),
        ];
        let graph = Graph::parse("servo.toml", crate::graph::STEERED).unwrap();
        for (text, path) in cases {
            let fault = parse(text);
            let on = graph.target(&fault.process).unwrap();
            assert_eq!(
                fault.schedule(&on, 1000, 0).unwrap_err().path,
                path,
                "{text}"
            );
        }
    }

    #[test]
    fn the_place_of_a_cut_survives_the_schedule() {
        let target = graph().target("controller").unwrap();
        let text = "process='controller'\nkind='cut'\ntopic='singularity'\nat_tick=9\nfor_ticks=5\nprobability=1.0\nseed=7";
        let fault = parse(text);
        let scheduled = fault.schedule(&target, 1000, 0).unwrap();
        assert_eq!(scheduled.fault("controller", &target), Some(fault));
    }
}
