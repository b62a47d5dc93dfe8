//! Faults: the one vocabulary, as people write it (`[[fault]]` in a scenario, `armplane fault`) and as the processes carry it out.
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
//! A fault is tied to ticks, so a run with planned faults has the same bytes every time. A [`Fault`] becomes a [`ScheduledFault`], the fixed-size form
//! that all processes of a run share; a scheduled fault turns back into the fault that repeats it.

mod kind;
mod scheduled;

use serde::{Deserialize, Serialize};

use crate::file::Complaint;
use crate::process::Role;
use crate::wire::{Field, Message};
use crate::{ControlState, PlantState};

use kind::{DELAY_TICKS, LONGEST_MS, Rule};

pub use kind::{Kind, MOST_DELAY_TICKS, Way};
pub use scheduled::ScheduledFault;

/// The finest steps of an encoder that is at fault; rad. Finer ones are no steps in 64 bits.
const FINEST_STEP: f64 = 1e-12;

/// One fault, as people write it. Of each pair in ticks and in seconds at most one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// To which process.
    pub process: String,
    /// Its kind.
    pub kind: Kind,
    /// In which way, for the kinds that have several.
    #[serde(default, rename = "as", skip_serializing_if = "Option::is_none")]
    pub way: Option<Way>,
    /// The first tick it concerns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_tick: Option<u64>,
    /// The same, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_s: Option<f64>,
    /// How many ticks it lasts; for `kill` and `crash`: until the replacement may answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_ticks: Option<u64>,
    /// The same, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// The share of messages it concerns, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// `delay`: ticks by which a message is late.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub delay_ticks: Option<u64>,
    /// `delay`: up to so many ticks more, evenly distributed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub jitter_ticks: Option<u64>,
    /// `corrupt`: which field of the message, as `tau[2]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub field: Option<String>,
    /// `cut`: which of the topics that the process reads; by default the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// `sensor`, `drive`: which joint, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<u32>,
    /// By how much; the unit is the way's, or ms where the kind has one way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amount: Option<f64>,
    /// `kill`: the process ends after so many of its messages of the first tick have left, not before the first of them; at most all but the last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub after_outputs: Option<u32>,
    /// Seed of its random numbers; from the scenario's where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

/// The process that a fault applies to, as its graph has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// Its place in the manifest.
    pub index: u32,
    /// Its part in the run.
    pub role: Role,
    /// Its step is done by a program of others, by an exchange page, or by a robot.
    pub is_exchanged: bool,
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
            is_exchanged: false,
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

/// Whether faults of a process shape the messages of this topic; what is published for judging and showing only is never touched.
#[must_use]
pub fn shaped_topic(topic: &str) -> bool {
    topic != PlantState::TOPIC && topic != ControlState::TOPIC
}

impl ScheduledFault {
    /// The fault that repeats it, for the process of that name.
    #[must_use]
    pub fn fault(&self, process: &str, on: &Target) -> Option<Fault> {
        let kind = self.kind()?;
        let rule = kind.rule();
        let way = self.way().filter(|_| !rule.ways.is_empty());
        let at = self.target as usize;
        let field = on
            .fields
            .iter()
            .find(|field| (field.offset..field.offset + field.size).contains(&at));
        let field = field
            .map(|field| format!("{}[{}]", field.name, (at - field.offset) / size_of::<f64>()));
        Some(Fault {
            process: process.to_owned(),
            kind,
            way,
            at_tick: Some(self.at),
            at_s: None,
            for_ticks: (self.until != u64::MAX).then(|| self.until.saturating_sub(self.at)),
            for_s: None,
            probability: rule.has_probability.then_some(self.probability),
            delay_ticks: (kind == Kind::Delay).then_some(self.amount as u64),
            jitter_ticks: (kind == Kind::Delay && self.jitter > 0).then_some(self.jitter),
            field: field.filter(|_| kind == Kind::Corrupt),
            topic: on.reads.get(at).filter(|_| kind == Kind::Cut).cloned(),
            joint: kind.concerns_joint().then_some(self.target + 1),
            amount: (!matches!(kind, Kind::Delay) && self.amount != 0.0).then_some(self.amount),
            after_outputs: (self.after_outputs() > 0).then_some(self.after_outputs()),
            seed: (rule.has_probability || matches!(kind, Kind::Delay | Kind::Sensor))
                .then_some(self.seed),
        })
    }

    /// The end of a process that no plan had, from a tick on of which so many messages have left: the kill that repeats it.
    #[must_use]
    pub fn death(process: u32, at: u64, after_outputs: u32, rate_hz: u32) -> Self {
        let length = (Kind::Kill.usual_length_s() * f64::from(rate_hz))
            .round()
            .max(1.0) as u64;
        let (kind, until) = (Kind::Kill as u32, at.saturating_add(length));
        Self {
            process,
            kind,
            way: 0,
            target: after_outputs,
            at,
            until,
            probability: 1.0,
            amount: 0.0,
            jitter: 0,
            seed: 0,
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
            way: None,
            at_tick: None,
            at_s: None,
            for_ticks: None,
            for_s: None,
            probability: None,
            delay_ticks: None,
            jitter_ticks: None,
            field: None,
            topic: None,
            joint: None,
            amount: None,
            after_outputs: None,
            seed: None,
        }
    }

    /// The checks that do not need the graph.
    ///
    /// # Errors
    /// As [`Fault::schedule`].
    pub fn check(&self, rate_hz: u32) -> Result<(), Complaint> {
        self.timed(0, 0, rate_hz, 0).map(drop)
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
        let (kind, roles) = (self.kind, self.kind.roles());
        if !roles.contains(&on.role) {
            let names: Vec<_> = roles.iter().map(|role| role.about()).collect();
            let remedy = format!("it can happen to {}", names.join(" and to "));
            return Err(Complaint::new(
                "kind",
                format!("`{kind}` cannot happen to the {}", self.process),
                remedy,
            ));
        }
        if kind.needs_own_files() && on.is_exchanged {
            let message = format!(
                "`{kind}` cannot happen to {}: its program writes its files itself",
                self.process
            );
            return Err(Complaint::new(
                "kind",
                message,
                "plan it for the recorder, or let the program write to a volume of limited size",
            ));
        }
        if on.is_exchanged && kind.concerns_joint() {
            let message = format!(
                "the {}'s sensors and drives are not armplane's own: a `{kind}` fault would not take effect there",
                self.process
            );
            return Err(Complaint::new(
                "kind",
                message,
                "simulate the arm by armplane, or corrupt its messages: kind = \"corrupt\"",
            ));
        }
        let target = match kind {
            Kind::Corrupt => self.corrupted_place(&on.fields)?,
            Kind::Cut => self.cut_topic(&on.reads)?,
            Kind::Kill => self.after_outputs.unwrap_or(0),
            _ => self.joint.map_or(Ok(0), |joint| {
                joint.checked_sub(1).ok_or_else(|| {
                    Complaint::new("joint", "there is no joint 0", "joints count from 1")
                })
            })?,
        };
        self.timed(on.index, target, rate_hz, seed)
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
        let length = match ticks("for", self.for_ticks, self.for_s, rate_hz)? {
            Some(0) => {
                return Err(Complaint::new(
                    "for_ticks",
                    "a fault of no length",
                    "leave it out for the usual length",
                ));
            }
            Some(length) => length,
            None if rule.lasts_s.is_finite() => {
                (rule.lasts_s * f64::from(rate_hz)).round().max(1.0) as u64
            }
            None => u64::MAX,
        };
        let probability = self.probability.unwrap_or(1.0);
        if !(probability > 0.0 && probability <= 1.0) {
            return Err(Complaint::new(
                "probability",
                format!("a probability of {probability}"),
                "more than 0, at most 1",
            ));
        }
        let way = self.way.or(rule.ways.first().map(|(way, _)| *way));
        let usual = rule
            .ways
            .iter()
            .find(|(one, _)| Some(*one) == way)
            .map_or(0.0, |(_, amount)| *amount);
        let amount = match kind {
            Kind::Delay => self.delay_ticks.unwrap_or(DELAY_TICKS) as f64,
            _ if rule.usual_ms > 0.0 => self.amount.unwrap_or(rule.usual_ms),
            _ => self.amount.unwrap_or(usual),
        };
        if !amount.is_finite()
            || amount.abs() > 1e12
            || (rule.usual_ms > 0.0 && !(0.0..=LONGEST_MS).contains(&amount))
        {
            return Err(Complaint::new(
                "amount",
                format!("an amount of {amount}"),
                "a number in the unit of the fault's way; `armplane fault --list`",
            ));
        }
        if way == Some(Way::Quantise) && amount < FINEST_STEP {
            return Err(Complaint::new(
                "amount",
                format!("steps of {amount:e} rad"),
                format!("at least {FINEST_STEP:e}"),
            ));
        }
        let jitter = self.jitter_ticks.unwrap_or(0);
        if kind == Kind::Delay
            && self
                .delay_ticks
                .unwrap_or(DELAY_TICKS)
                .saturating_add(jitter)
                > MOST_DELAY_TICKS
        {
            let remedy = format!(
                "with its jitter at most {MOST_DELAY_TICKS}; a longer one is a `drop` or a `hang`"
            );
            return Err(Complaint::new(
                "delay_ticks",
                "a delay too long for the buffers of the chain",
                remedy,
            ));
        }
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

    fn refuse_what_does_not_belong(&self, rule: &Rule) -> Result<(), Complaint> {
        let kind = self.kind;
        let stray = |key: &str| {
            Err(Complaint::new(
                key,
                format!("`{kind}` has no `{key}`"),
                "leave it out; see `armplane fault --list`",
            ))
        };
        if let Some(way) = self.way
            && !rule.ways.iter().any(|(one, _)| *one == way)
        {
            let ways: Vec<_> = kind.ways().map(Way::name).collect();
            let remedy = if ways.is_empty() {
                "leave it out".to_owned()
            } else {
                format!("it comes as: {}", ways.join(", "))
            };
            return Err(Complaint::new(
                "as",
                format!("`{kind}` does not come as `{way}`"),
                remedy,
            ));
        }
        if self.probability.is_some() && !rule.has_probability {
            return stray("probability");
        }
        if self.field.is_some() && kind != Kind::Corrupt {
            return stray("field");
        }
        if self.topic.is_some() && kind != Kind::Cut {
            return stray("topic");
        }
        if self.joint.is_some() && !kind.concerns_joint() {
            return stray("joint");
        }
        if self.delay_ticks.is_some() && kind != Kind::Delay {
            return stray("delay_ticks");
        }
        if self.jitter_ticks.is_some() && kind != Kind::Delay {
            return stray("jitter_ticks");
        }
        if self.after_outputs.is_some() && kind != Kind::Kill {
            return stray("after_outputs");
        }
        if self.amount.is_some()
            && rule.usual_ms == 0.0
            && rule.ways.iter().all(|(_, amount)| *amount == 0.0)
        {
            return stray("amount");
        }
        Ok(())
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
        let numbers = || fields.iter().filter(|field| field.is_number());
        let known = || {
            numbers()
                .map(|field| &*field.name)
                .collect::<Vec<_>>()
                .join(", ")
        };
        if numbers().next().is_none() {
            let message = format!(
                "the {} sends no plain number that could be corrupted",
                self.process
            );
            return Err(Complaint::new(
                "kind",
                message,
                "take another process, or another kind: `armplane fault --list`",
            ));
        }
        let (name, place) = match self.field.as_deref() {
            None => (numbers().next().map_or("", |field| &*field.name), 0),
            Some(text) => match text.strip_suffix(']').and_then(|text| text.split_once('[')) {
                None => (text, 0),
                Some((name, place)) => {
                    let remedy = "as in `tau[2]`, from 0";
                    (
                        name,
                        place.parse().map_err(|_| {
                            Complaint::new(
                                "field",
                                format!("`{place}` is not a place in a field"),
                                remedy,
                            )
                        })?,
                    )
                }
            },
        };
        let Some(field) = numbers().find(|field| field.name == name) else {
            let message = format!("the {} sends no number `{name}`", self.process);
            return Err(Complaint::new(
                "field",
                message,
                format!("it sends {}", known()),
            ));
        };
        let length = field.size / size_of::<f64>();
        if place >= length {
            let message = format!("`{name}` has {length} places, there is no place {place}");
            return Err(Complaint::new(
                "field",
                message,
                format!("0 to {}", length - 1),
            ));
        }
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
        if let Some(outputs) = self.after_outputs {
            write!(f, " after {outputs} of its messages")?;
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
    fn rules_stand_in_the_order_of_the_kinds() {
        for &kind in Kind::ALL {
            assert_eq!(kind.rule().kind, kind);
            assert_eq!(kind.name().parse::<Kind>(), Ok(kind));
        }
    }

    #[test]
    fn every_fault_repeats_itself() {
        for &kind in Kind::ALL {
            for process in graph()
                .process
                .iter()
                .filter(|process| kind.roles().contains(&process.role()))
            {
                let (target, process) = (
                    graph().target(&process.name).unwrap(),
                    process.name.as_str(),
                );
                let ways: Vec<_> = kind.ways().map(Some).collect();
                for way in if ways.is_empty() { vec![None] } else { ways } {
                    let fault = Fault {
                        way,
                        at_tick: Some(70),
                        ..Fault::new(process, kind)
                    };
                    let scheduled = fault.schedule(&target, 1000, 99).unwrap();
                    let again = scheduled.fault(process, &target).unwrap();
                    assert_eq!(
                        again.schedule(&target, 1000, 0).unwrap(),
                        ScheduledFault {
                            seed: again.seed.unwrap_or(0),
                            ..scheduled
                        },
                        "{fault}"
                    );
                    assert!(scheduled.concerns(70) && !scheduled.concerns(69));
                    let text = toml::to_string(&again).unwrap();
                    assert_eq!(parse(&text), again);
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
        assert_eq!(
            (
                scheduled.at,
                scheduled.until,
                scheduled.seed,
                scheduled.way()
            ),
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
        let fault = |kind: &str| {
            parse(&format!(
                "process = \"plant\"\nkind = \"{kind}\"\njoint = 1\nat_tick = 5"
            ))
        };
        let plant = "[[process]]\nname = \"plant\"\nfeedback = [\"torque\"]\nwrites = [\"sensor\", \"plant_state\"]\n";
        for key in [
            "robot = \"fci://a\"",
            "command = [\"mine\"]\nexchange = true",
            "external = true",
        ] {
            let graph =
                Graph::parse("g.toml", &format!("extends = \"armplane\"\n{plant}{key}\n")).unwrap();
            let target = graph.target("plant").unwrap();
            for kind in ["sensor", "drive"] {
                let refused = fault(kind)
                    .schedule(&target, 1000, 1)
                    .unwrap_err()
                    .to_string();
                assert!(
                    refused.contains("would not take effect") && refused.contains("corrupt"),
                    "{key}: {refused}"
                );
            }
        }
        assert!(
            fault("sensor")
                .schedule(&graph().target("plant").unwrap(), 1000, 1)
                .is_ok()
        );
    }

    #[test]
    fn a_fault_that_makes_no_sense_is_refused_with_its_remedy() {
        let refused = |text: &str| {
            let fault = parse(text);
            let Complaint {
                path,
                message,
                remedy,
            } = fault
                .schedule(&graph().target(&fault.process).unwrap(), 1000, 0)
                .unwrap_err();
            format!("{path}: {message} ({remedy})")
        };
        assert!(
            refused("process='recorder'\nkind='drop'")
                .contains("cannot happen to the recorder (it can happen to the process that makes the ticks and to the")
        );
        assert!(refused("process='plant'\nkind='sensor'\nas='nan'").contains("it comes as: bias"));
        assert!(refused("process='plant'\nkind='sensor'\njoint=0").contains("from 1"));
        assert!(
            refused("process='plant'\nkind='kill'\nprobability=0.5")
                .contains("has no `probability`")
        );
        assert!(refused("process='plant'\nkind='drop'\nprobability=2.0").contains("at most 1"));
        assert!(
            refused("process='plant'\nkind='drop'\nat_s=1.0\nat_tick=3").contains("both given")
        );
        assert!(
            refused("process='analyzer'\nkind='corrupt'\nfield='zeta'").contains("it sends det")
        );
        assert!(refused("process='analyzer'\nkind='corrupt'\nfield='p_BC[3]'").contains("0 to 2"));
        let steered = Graph::parse("servo.toml", crate::graph::STEERED).unwrap();
        let none = parse("process='operator'\nkind='corrupt'")
            .schedule(&steered.target("operator").unwrap(), 1000, 0)
            .unwrap_err();
        assert!(none.message.contains("sends no plain number"), "{none}");
        assert!(
            refused("process='analyzer'\nkind='cut'\ntopic='torque'").contains("it reads estimate")
        );
        assert!(
            refused("process='analyzer'\nkind='slow'\namount=2e3").contains("an amount of 2000")
        );
        assert!(
            refused("process='analyzer'\nkind='delay'\ndelay_ticks=40\njitter_ticks=11")
                .contains("at most 50")
        );
    }

    #[test]
    fn it_says_itself_in_a_line() {
        let fault =
            parse("process='controller'\nkind='drop'\nat_tick=9\nfor_ticks=5\nprobability=0.25");
        assert_eq!(
            fault.to_string(),
            "drop of the controller, 25 % of the messages, at tick 9, for 5 ticks"
        );
        let fault =
            parse("process='controller'\nkind='kill'\nat_tick=9\nafter_outputs=1\nfor_ticks=5");
        assert_eq!(
            fault.to_string(),
            "kill of the controller, at tick 9 after 1 of its messages, for 5 ticks"
        );
        let target = graph().target("controller").unwrap();
        let scheduled = fault.schedule(&target, 1000, 0).unwrap();
        assert_eq!(
            (
                scheduled.after_outputs(),
                scheduled.fault("controller", &target)
            ),
            (1, Some(fault))
        );
        let fault =
            parse("process='controller'\nkind='cut'\ntopic='estimate'\nat_tick=9\nfor_ticks=5");
        assert_eq!(
            fault.to_string(),
            "cut of the controller, estimate, at tick 9, for 5 ticks"
        );
        let again = fault
            .schedule(&target, 1000, 0)
            .unwrap()
            .fault("controller", &target)
            .unwrap();
        assert_eq!(again.topic.as_deref(), Some("estimate"));
        let fault =
            parse("process='plant'\nkind='sensor'\nas='bias'\njoint=5\namount=0.02\nat_tick=9");
        assert_eq!(
            fault.to_string(),
            "sensor (bias) of the plant, joint 5, 0.02 rad, at tick 9"
        );
    }
}
