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

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

use crate::file::Complaint;
use crate::wire::{Field, Layout, Message};
use crate::{ControlState, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

/// Declares an enumeration of words: the variants, their spelling in files and their numbers in shared memory.
macro_rules! words {
    ($(#[$meta:meta])* $name:ident { $( #[doc = $doc:literal] $variant:ident $word:literal ),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
        pub enum $name { $( #[doc = $doc] #[serde(rename = $word)] $variant ),* }

        impl $name {
            /// All of them, in order: the place is the number in shared memory.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// As written in files.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $( Self::$variant => $word ),* }
            }

            /// One sentence.
            #[must_use]
            pub fn about(self) -> &'static str {
                match self { $( Self::$variant => $doc.trim_ascii() ),* }
            }

            fn of(number: u32) -> Option<Self> {
                Self::ALL.get(number as usize).copied()
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;
            fn from_str(word: &str) -> Result<Self, String> {
                let known = || Self::ALL.iter().map(|one| one.name()).collect::<Vec<_>>().join(", ");
                Self::ALL.iter().find(|one| one.name() == word).copied().ok_or_else(|| format!("there is no `{word}`; there are {}", known()))
            }
        }
    };
}

words! {
    /// The kind of fault.
    Kind {
        /// The process ends itself by SIGKILL at the tick; its replacement answers after `for`.
        Kill "kill",
        /// It panics at the tick.
        Crash "crash",
        /// It is stopped (SIGSTOP) at the tick.
        Hang "hang",
        /// Its messages leave so many ticks late.
        Delay "delay",
        /// Its messages are lost.
        Drop "drop",
        /// Its messages are sent twice.
        Duplicate "duplicate",
        /// Its messages change places with the next.
        Reorder "reorder",
        /// Instead of a new message the last one from before the fault is sent again.
        Stale "stale",
        /// A field of its messages is corrupted on the way.
        Corrupt "corrupt",
        /// An encoder lies.
        Sensor "sensor",
        /// A joint's drive does not follow its command.
        Drive "drive",
        /// Its clock jumps or runs at another rate.
        Clock "clock",
        /// Somebody else is busy on its core.
        Starve "starve",
        /// The volume it writes to is full.
        DiskFull "disk-full",
        /// The volume it writes to is slow.
        SlowDisk "slow-disk",
    }
}

words! {
    /// In which way a value is wrong, for the kinds that have several.
    Way {
        /// hang: continued (SIGCONT) after `for`.
        Paused "paused",
        /// hang: until the launcher detects the silence and replaces it; the replacement answers after `for`.
        ForEver "for-ever",
        /// corrupt: not a number.
        Nan "nan",
        /// corrupt: infinite.
        Inf "inf",
        /// corrupt: one bit flipped, another one in each message.
        Flip "flip",
        /// corrupt: far out of range, by the factor `amount` and at least by it.
        Huge "huge",
        /// sensor: off by `amount` rad.
        Bias "bias",
        /// sensor: off by `amount` rad/s times the time since the fault.
        Drift "drift",
        /// sensor: noise of standard deviation `amount` rad.
        Noise "noise",
        /// sensor: steps of `amount` rad.
        Quantise "quantise",
        /// sensor: the first value of the fault again and again; drive: likewise its torque.
        Stuck "stuck",
        /// drive: no torque.
        Lost "lost",
        /// drive: no more than the fraction `amount` of its limit.
        Saturated "saturated",
        /// drive: dry friction of the fraction `amount` of its limit.
        Friction "friction",
        /// clock: by `amount` ms at once.
        Jump "jump",
        /// clock: faster by the fraction `amount`.
        Skew "skew",
    }
}

/// The arguments of a kind of fault, and the processes that it applies to.
struct Rule {
    kind: Kind,
    /// In which ways it comes; the first is the default.
    ways: &'static [(Way, f64)],
    processes: &'static [&'static str],
    /// How long it lasts unless said otherwise; s. Infinite: to the end of the run.
    lasts_s: f64,
    has_probability: bool,
}

const ALL: &[&str] = &["plant", "estimator", "analyzer", "controller", "recorder"];
const SENDERS: &[&str] = &["plant", "estimator", "analyzer", "controller"];
const PLANT: &[&str] = &["plant"];
const RECORDER: &[&str] = &["recorder"];

const fn rule(kind: Kind, processes: &'static [&'static str], lasts_s: f64) -> Rule {
    Rule { kind, ways: &[], processes, lasts_s, has_probability: false }
}

/// The factor of a corruption `as = "huge"` without `amount`.
const HUGE: f64 = 1e3;

const RULES: [Rule; 15] = [
    rule(Kind::Kill, ALL, 0.1),
    rule(Kind::Crash, ALL, 0.1),
    Rule { ways: &[(Way::Paused, 0.0), (Way::ForEver, 0.0)], ..rule(Kind::Hang, ALL, 0.1) },
    rule(Kind::Delay, SENDERS, 0.1),
    Rule { has_probability: true, ..rule(Kind::Drop, SENDERS, 0.1) },
    Rule { has_probability: true, ..rule(Kind::Duplicate, SENDERS, 0.1) },
    Rule { has_probability: true, ..rule(Kind::Reorder, SENDERS, 0.1) },
    Rule { has_probability: true, ..rule(Kind::Stale, SENDERS, 0.1) },
    Rule {
        has_probability: true,
        ways: &[(Way::Nan, 0.0), (Way::Inf, 0.0), (Way::Flip, 0.0), (Way::Huge, HUGE)],
        ..rule(Kind::Corrupt, SENDERS, 0.1)
    },
    Rule {
        ways: &[(Way::Bias, 0.01), (Way::Drift, 0.05), (Way::Noise, 0.001), (Way::Quantise, 0.005), (Way::Stuck, 0.0)],
        ..rule(Kind::Sensor, PLANT, 0.5)
    },
    Rule { ways: &[(Way::Lost, 0.0), (Way::Stuck, 0.0), (Way::Saturated, 0.1), (Way::Friction, 0.05)], ..rule(Kind::Drive, PLANT, 0.5) },
    Rule { ways: &[(Way::Jump, 5.0), (Way::Skew, 0.01)], ..rule(Kind::Clock, SENDERS, 0.5) },
    rule(Kind::Starve, ALL, 0.2),
    rule(Kind::DiskFull, RECORDER, f64::INFINITY),
    rule(Kind::SlowDisk, RECORDER, 0.5),
];

/// Delay of a message unless said otherwise; ticks.
const DELAY_TICKS: u64 = 2;

/// Longest delay with jitter: what the chain's buffers hold; ticks.
pub const MOST_DELAY_TICKS: u64 = 50;

/// Pause of a slow volume in each round unless said otherwise; ms.
const SLOW_MS: f64 = 20.0;

impl Kind {
    fn rule(self) -> &'static Rule {
        let rule = &RULES[self as usize];
        debug_assert_eq!(rule.kind, self);
        rule
    }

    /// The ways it comes in; empty where there is only one.
    pub fn ways(self) -> impl Iterator<Item = Way> {
        self.rule().ways.iter().map(|(way, _)| *way)
    }

    /// By how much it comes in a way, unless said otherwise; 0 where there is no amount.
    #[must_use]
    pub fn usual_amount(self, way: Way) -> f64 {
        self.rule().ways.iter().find(|(one, _)| *one == way).map_or(0.0, |(_, amount)| *amount)
    }

    /// How long it lasts unless said otherwise, s; infinite: to the end of the run.
    #[must_use]
    pub fn usual_length_s(self) -> f64 {
        self.rule().lasts_s
    }

    /// The processes it can happen to.
    #[must_use]
    pub fn processes(self) -> &'static [&'static str] {
        self.rule().processes
    }

    /// Whether the process is dead or stands still meanwhile.
    #[must_use]
    pub fn takes_down(self) -> bool {
        matches!(self, Self::Kill | Self::Crash | Self::Hang)
    }

    /// Whether several messages, or none, may leave in one tick.
    #[must_use]
    pub fn shapes_messages(self) -> bool {
        matches!(self, Self::Delay | Self::Drop | Self::Duplicate | Self::Reorder | Self::Stale | Self::Corrupt)
    }
}

/// One fault, as people write it. Of each pair in ticks and in seconds at most one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// To which process.
    pub process: String,
    /// What.
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
    /// `sensor`, `drive`: which joint, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint: Option<u32>,
    /// By how much; the unit is the way's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amount: Option<f64>,
    /// Seed of its random numbers; from the scenario's where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
}

/// A fault as the processes of a run carry it out: fixed size, in shared memory.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ScheduledFault {
    /// Index of the process in the manifest.
    pub process: u32,
    /// Number of its [`Kind`].
    pub kind: u32,
    /// Number of its [`Way`].
    pub way: u32,
    /// The joint from 0, or the field of the message times 65536 plus the place in it.
    pub target: u32,
    /// First tick.
    pub at: u64,
    /// First tick it no longer concerns; `u64::MAX`: never.
    pub until: u64,
    /// Share of messages.
    pub probability: f64,
    /// By how much, in the way's unit; for `delay` the ticks.
    pub amount: f64,
    /// Most additional delay; ticks.
    pub jitter: u64,
    /// Seed of its random numbers.
    pub seed: u64,
}

impl ScheduledFault {
    /// The kind; `None` for a number that no kind has.
    #[must_use]
    pub fn kind(&self) -> Option<Kind> {
        Kind::of(self.kind)
    }

    /// In which way.
    #[must_use]
    pub fn way(&self) -> Option<Way> {
        Way::of(self.way)
    }

    /// Whether a tick is concerned.
    #[must_use]
    pub fn concerns(&self, tick: u64) -> bool {
        (self.at..self.until).contains(&tick)
    }

    /// The fault that repeats it, for the process of that name.
    #[must_use]
    pub fn fault(&self, process: &str) -> Option<Fault> {
        let kind = self.kind()?;
        let rule = kind.rule();
        let way = self.way().filter(|_| !rule.ways.is_empty());
        let field = self.field(process);
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
            field: (kind == Kind::Corrupt).then(|| field.map(|(field, place)| format!("{}[{place}]", field.name))).flatten(),
            joint: matches!(kind, Kind::Sensor | Kind::Drive).then_some(self.target + 1),
            amount: (!matches!(kind, Kind::Delay) && self.amount != 0.0).then_some(self.amount),
            seed: (rule.has_probability || matches!(kind, Kind::Delay | Kind::Sensor)).then_some(self.seed),
        })
    }

    /// The field of its process's message that it corrupts, and the place in it.
    #[must_use]
    pub fn field(&self, process: &str) -> Option<(&'static Field, usize)> {
        let field = fields_of(process).get((self.target >> 16) as usize)?;
        Some((field, (self.target & 0xffff) as usize))
    }
}

/// The fields of the message a process sends along the chain.
fn fields_of(process: &str) -> &'static [Field] {
    match process {
        "plant" => SensorSample::FIELDS,
        "estimator" => StateEstimate::FIELDS,
        "analyzer" => SingularityReport::FIELDS,
        "controller" => TorqueCommand::FIELDS,
        _ => &[],
    }
}

/// Whether faults of a process shape the messages of this topic; what is published for judging and showing only is never touched.
#[must_use]
pub fn shaped_topic(topic: &str) -> bool {
    topic != PlantState::TOPIC && topic != ControlState::TOPIC
}

fn is_number(field: &Field) -> bool {
    field.type_name == "f64" || field.type_name.starts_with("[f64;")
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
            joint: None,
            amount: None,
            seed: None,
        }
    }

    /// Its fixed-size form at a control rate, for the process at `index` of the manifest; `seed` where it names none.
    ///
    /// # Errors
    /// [`Complaint`], its path relative to the fault: what does not belong to its kind, or is out of range.
    pub fn schedule(&self, index: u32, rate_hz: u32, seed: u64) -> Result<ScheduledFault, Complaint> {
        let rule = self.kind.rule();
        let (kind, process) = (self.kind, self.process.as_str());
        if !ALL.contains(&process) {
            return Err(Complaint::new("process", format!("there is no process `{process}`"), format!("known: {}", ALL.join(", "))));
        }
        if !rule.processes.contains(&process) {
            let remedy = format!("it can happen to: {}", rule.processes.join(", "));
            return Err(Complaint::new("kind", format!("`{kind}` cannot happen to the {process}"), remedy));
        }
        self.refuse_what_does_not_belong(rule)?;
        let at = ticks("at", self.at_tick, self.at_s, rate_hz)?.unwrap_or(0);
        let length = match ticks("for", self.for_ticks, self.for_s, rate_hz)? {
            Some(0) => return Err(Complaint::new("for_ticks", "a fault of no length", "leave it out for the usual length")),
            Some(length) => length,
            None if rule.lasts_s.is_finite() => (rule.lasts_s * f64::from(rate_hz)).round().max(1.0) as u64,
            None => u64::MAX,
        };
        let probability = self.probability.unwrap_or(1.0);
        if !(probability > 0.0 && probability <= 1.0) {
            return Err(Complaint::new("probability", format!("a probability of {probability}"), "more than 0, at most 1"));
        }
        let way = self.way.or(rule.ways.first().map(|(way, _)| *way));
        let usual = rule.ways.iter().find(|(one, _)| Some(*one) == way).map_or(0.0, |(_, amount)| *amount);
        let amount = match kind {
            Kind::Delay => self.delay_ticks.unwrap_or(DELAY_TICKS) as f64,
            Kind::SlowDisk => self.amount.unwrap_or(SLOW_MS),
            _ => self.amount.unwrap_or(usual),
        };
        if !amount.is_finite() || amount.abs() > 1e12 || (kind == Kind::SlowDisk && !(0.0..=1e3).contains(&amount)) {
            return Err(Complaint::new(
                "amount",
                format!("an amount of {amount}"),
                "a number in the unit of the fault's way; `armplane fault --list`",
            ));
        }
        let jitter = self.jitter_ticks.unwrap_or(0);
        if kind == Kind::Delay && self.delay_ticks.unwrap_or(DELAY_TICKS).saturating_add(jitter) > MOST_DELAY_TICKS {
            let remedy = format!("with its jitter at most {MOST_DELAY_TICKS}; a longer one is a `drop` or a `hang`");
            return Err(Complaint::new("delay_ticks", "a delay too long for the buffers of the chain", remedy));
        }
        let target = match kind {
            Kind::Corrupt => self.spoilt_field()?,
            _ => self.joint.map_or(Ok(0), |joint| {
                joint.checked_sub(1).ok_or_else(|| Complaint::new("joint", "there is no joint 0", "joints count from 1"))
            })?,
        };
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
        let stray = |key: &str| Err(Complaint::new(key, format!("`{kind}` has no `{key}`"), "leave it out; see `armplane fault --list`"));
        if let Some(way) = self.way
            && !rule.ways.iter().any(|(one, _)| *one == way)
        {
            let ways: Vec<_> = kind.ways().map(Way::name).collect();
            let remedy = if ways.is_empty() { "leave it out".to_owned() } else { format!("it comes as: {}", ways.join(", ")) };
            return Err(Complaint::new("as", format!("`{kind}` does not come as `{way}`"), remedy));
        }
        if self.probability.is_some() && !rule.has_probability {
            return stray("probability");
        }
        if self.field.is_some() && kind != Kind::Corrupt {
            return stray("field");
        }
        if self.joint.is_some() && !matches!(kind, Kind::Sensor | Kind::Drive) {
            return stray("joint");
        }
        if self.delay_ticks.is_some() && kind != Kind::Delay {
            return stray("delay_ticks");
        }
        if self.jitter_ticks.is_some() && kind != Kind::Delay {
            return stray("jitter_ticks");
        }
        if self.amount.is_some() && kind != Kind::SlowDisk && rule.ways.iter().all(|(_, amount)| *amount == 0.0) {
            return stray("amount");
        }
        Ok(())
    }

    /// The field's number times 65536 plus the place in it; by default the first number of the message.
    fn spoilt_field(&self) -> Result<u32, Complaint> {
        let fields = fields_of(&self.process);
        let known = || fields.iter().filter(|field| is_number(field)).map(|field| field.name).collect::<Vec<_>>().join(", ");
        let (name, place) = match self.field.as_deref() {
            None => (fields.iter().find(|field| is_number(field)).map_or("", |field| field.name), 0),
            Some(text) => match text.strip_suffix(']').and_then(|text| text.split_once('[')) {
                None => (text, 0),
                Some((name, place)) => {
                    let remedy = "as in `tau[2]`, from 0";
                    (name, place.parse().map_err(|_| Complaint::new("field", format!("`{place}` is not a place in a field"), remedy))?)
                }
            },
        };
        let found = fields.iter().position(|field| field.name == name && is_number(field));
        let Some(number) = found else {
            let message = format!("the {} sends no number `{name}`", self.process);
            return Err(Complaint::new("field", message, format!("it sends {}", known())));
        };
        let length = fields[number].size / size_of::<f64>();
        if place >= length {
            let message = format!("`{name}` has {length} places, there is no place {place}");
            return Err(Complaint::new("field", message, format!("0 to {}", length - 1)));
        }
        Ok((number as u32) << 16 | place as u32)
    }
}

/// Ticks from either spelling.
fn ticks(what: &str, ticks: Option<u64>, seconds: Option<f64>, rate_hz: u32) -> Result<Option<u64>, Complaint> {
    match (ticks, seconds) {
        (Some(_), Some(_)) => {
            Err(Complaint::new(format!("{what}_s"), format!("`{what}_tick…` and `{what}_s` are both given"), "give one of them"))
        }
        (_, Some(s)) if !(0.0..=36_000.0).contains(&s) => Err(Complaint::new(format!("{what}_s"), format!("{s} s"), "0 to 36000")),
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
        if let Some(field) = &self.field {
            write!(f, ", {field}")?;
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

    fn parse(text: &str) -> Fault {
        toml::from_str(text).unwrap()
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
            for &process in kind.processes() {
                let ways: Vec<_> = kind.ways().map(Some).collect();
                for way in if ways.is_empty() { vec![None] } else { ways } {
                    let fault = Fault { way, at_tick: Some(70), ..Fault::new(process, kind) };
                    let scheduled = fault.schedule(3, 1000, 99).unwrap();
                    let again = scheduled.fault(process).unwrap();
                    assert_eq!(
                        again.schedule(3, 1000, 0).unwrap(),
                        ScheduledFault { seed: again.seed.unwrap_or(0), ..scheduled },
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
        let fault = parse("process='controller'\nkind='corrupt'\nas='inf'\nfield='tau[2]'\nat_s=0.25\nfor_s=0.01\nprobability=0.5");
        let scheduled = fault.schedule(0, 2000, 5).unwrap();
        assert_eq!((scheduled.at, scheduled.until, scheduled.seed, scheduled.way()), (500, 520, 5, Some(Way::Inf)));
        let (field, place) = scheduled.field("controller").unwrap();
        assert_eq!((field.name, place), ("tau", 2));
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_its_remedy() {
        let refused = |text: &str| {
            let Complaint { path, message, remedy } = parse(text).schedule(0, 1000, 0).unwrap_err();
            format!("{path}: {message} ({remedy})")
        };
        assert!(refused("process='nobody'\nkind='kill'").contains("no process `nobody`"));
        assert!(refused("process='recorder'\nkind='drop'").contains("cannot happen to the recorder"));
        assert!(refused("process='plant'\nkind='sensor'\nas='nan'").contains("it comes as: bias"));
        assert!(refused("process='plant'\nkind='sensor'\njoint=0").contains("from 1"));
        assert!(refused("process='plant'\nkind='kill'\nprobability=0.5").contains("has no `probability`"));
        assert!(refused("process='plant'\nkind='drop'\nprobability=2.0").contains("at most 1"));
        assert!(refused("process='plant'\nkind='drop'\nat_s=1.0\nat_tick=3").contains("both given"));
        assert!(refused("process='analyzer'\nkind='corrupt'\nfield='zeta'").contains("it sends sigma"));
        assert!(refused("process='analyzer'\nkind='corrupt'\nfield='sigma[6]'").contains("0 to 5"));
        assert!(refused("process='analyzer'\nkind='delay'\ndelay_ticks=40\njitter_ticks=11").contains("at most 50"));
    }

    #[test]
    fn it_says_itself_in_a_line() {
        let fault = parse("process='controller'\nkind='drop'\nat_tick=9\nfor_ticks=5\nprobability=0.25");
        assert_eq!(fault.to_string(), "drop of the controller, 25 % of the messages, at tick 9, for 5 ticks");
    }
}
