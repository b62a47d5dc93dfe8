//! Kinds of faults, their variants, and the processes that each applies to.

use crate::process::{Process, Role};
use crate::words::words;

words! {
    /// Kinds of fault.
    Kind {
        /// The process dies by SIGKILL at the tick, and answers again after the duration.
        Kill "kill",
        /// The process crashes at the tick, and answers again after the duration.
        Crash "crash",
        /// The process is stopped (SIGSTOP) at the tick.
        Hang "hang",
        /// Its messages leave late by a number of ticks.
        Delay "delay",
        /// Its messages are lost.
        Drop "drop",
        /// Its messages are sent twice.
        Duplicate "duplicate",
        /// It sends its last message from before the fault again instead of each new one.
        Stale "stale",
        /// One field of its messages is corrupted on the way.
        Corrupt "corrupt",
        /// A dead predecessor keeps sending: after each message, an old one follows with the next tick's number.
        Zombie "zombie",
        /// Messages of one topic no longer reach it; all other readers get them.
        Cut "cut",
        /// An encoder reads wrong values.
        Sensor "sensor",
        /// A joint's drive does not follow its command.
        Drive "drive",
        /// The volume it writes to is full.
        DiskFull "disk-full",
    }
}

words! {
    /// Variants of a fault, for kinds that have several.
    Way {
        /// hang: the process continues (SIGCONT) after the duration.
        Paused "paused",
        /// hang: until the launcher notices the silence and kills the process, which answers again after the duration.
        ForEver "for-ever",
        /// corrupt: NaN.
        Nan "nan",
        /// corrupt: infinite.
        Inf "inf",
        /// corrupt: one flipped bit, a different one in each message.
        Flip "flip",
        /// corrupt: multiplied by `amount`, and changed by at least that.
        Huge "huge",
        /// sensor: wrong by `amount` rad.
        Bias "bias",
        /// sensor: wrong by `amount` rad/s times the time since the fault began.
        Drift "drift",
        /// sensor: noise with standard deviation `amount` rad.
        Noise "noise",
        /// sensor: resolution of `amount` rad.
        Quantise "quantise",
        /// sensor: repeats its first value; drive: repeats its first torque.
        Stuck "stuck",
        /// drive: no torque.
        Lost "lost",
        /// drive: at most the fraction `amount` of its limit.
        Saturated "saturated",
        /// drive: dry friction of the fraction `amount` of its limit.
        Friction "friction",
    }
}

/// The arguments of a kind of fault, and the processes that it applies to.
#[derive(Clone, Copy)]
pub(super) struct Rule {
    pub(super) roles: &'static [Role],
    /// How long it lasts unless said otherwise; s. Infinite: to the end of the run.
    pub(super) lasts_s: f64,
    /// The keys that it has and others have not.
    pub(super) keys: &'static [&'static str],
}

/// Delay of a message unless said otherwise; ticks.
pub(super) const DELAY_TICKS: u64 = 2;

/// Longest delay with jitter, limited by the chain's buffers; ticks.
pub const MOST_DELAY_TICKS: u64 = 50;

impl Kind {
    pub(super) fn rule(self) -> Rule {
        const ALL: &[Role] = &Role::ALL;
        const SENDERS: &[Role] = &[Role::World, Role::Stage];
        const WORLD: &[Role] = &[Role::World];
        const OBSERVERS: &[Role] = &[Role::Observer];
        let (roles, lasts_s, keys): (_, _, &[_]) = match self {
            Self::Kill | Self::Crash | Self::Hang => (ALL, 0.1, &[]),
            Self::Delay => (SENDERS, 0.1, &["delay_ticks", "jitter_ticks"]),
            Self::Drop | Self::Duplicate | Self::Stale | Self::Zombie => {
                (SENDERS, 0.1, &["probability"])
            }
            Self::Corrupt => (SENDERS, 0.1, &["probability", "field"]),
            Self::Cut => (SENDERS, 0.1, &["probability", "topic"]),
            Self::Sensor | Self::Drive => (WORLD, 0.5, &["joint"]),
            Self::DiskFull => (OBSERVERS, f64::INFINITY, &[]),
        };
        Rule {
            roles,
            lasts_s,
            keys,
        }
    }

    /// In which ways it comes, by how much unless said otherwise, and the unit; the first is the default.
    pub(super) fn known_ways(self) -> &'static [(Way, f64, &'static str)] {
        match self {
            Self::Hang => &[(Way::Paused, 0.0, ""), (Way::ForEver, 0.0, "")],
            Self::Corrupt => &[
                (Way::Nan, 0.0, ""),
                (Way::Inf, 0.0, ""),
                (Way::Flip, 0.0, ""),
                (Way::Huge, 1e3, "times"),
            ],
            Self::Sensor => &[
                (Way::Bias, 0.01, "rad"),
                (Way::Drift, 0.05, "rad/s"),
                (Way::Noise, 0.001, "rad"),
                (Way::Quantise, 0.005, "rad"),
                (Way::Stuck, 0.0, ""),
            ],
            Self::Drive => &[
                (Way::Lost, 0.0, ""),
                (Way::Stuck, 0.0, ""),
                (Way::Saturated, 0.1, "of the limit"),
                (Way::Friction, 0.05, "of the limit"),
            ],
            _ => &[],
        }
    }

    fn way(self, way: Way) -> Option<&'static (Way, f64, &'static str)> {
        self.known_ways().iter().find(|(one, ..)| *one == way)
    }

    /// Its variants; empty if there is only one.
    pub fn ways(self) -> impl Iterator<Item = Way> {
        self.known_ways().iter().map(|(way, ..)| *way)
    }

    /// By how much it comes in a way, unless said otherwise; 0 if there is no amount.
    #[must_use]
    pub fn usual_amount(self, way: Way) -> f64 {
        self.way(way).map_or(0.0, |(_, amount, _)| *amount)
    }

    /// The unit of the amount in a way; empty if there is none.
    #[must_use]
    pub fn unit(self, way: Way) -> &'static str {
        self.way(way).map_or("", |(.., unit)| unit)
    }

    /// How long it lasts unless said otherwise, s; infinite: to the end of the run.
    #[must_use]
    pub fn usual_length_s(self) -> f64 {
        self.rule().lasts_s
    }

    /// The roles of the processes that it applies to.
    #[must_use]
    pub fn roles(self) -> &'static [Role] {
        self.rule().roles
    }

    /// Whether it can happen to a process of a graph.
    #[must_use]
    pub fn suits(self, process: &Process) -> bool {
        self.roles().contains(&process.role())
    }

    /// Whether it concerns a joint of the arm itself, its encoder or its drive, and no message or process: it takes effect in the simulated arm alone.
    #[must_use]
    pub fn concerns_joint(self) -> bool {
        matches!(self, Self::Sensor | Self::Drive)
    }

    /// Whether the process is dead or stopped meanwhile.
    #[must_use]
    pub fn takes_down(self) -> bool {
        matches!(self, Self::Kill | Self::Crash | Self::Hang)
    }

    /// Whether the process ends of it, in the way it comes: a process that stands still for ever is killed by the launcher.
    #[must_use]
    pub fn ends_process(self, way: Option<Way>) -> bool {
        self.takes_down() && (self != Self::Hang || way == Some(Way::ForEver))
    }

    /// Whether it may concern a share of the messages only.
    #[must_use]
    pub fn has_probability(self) -> bool {
        self.rule().keys.contains(&"probability")
    }

    /// Whether several messages, or none, may leave in one tick.
    #[must_use]
    pub fn shapes_messages(self) -> bool {
        self == Self::Delay || self.has_probability() && self != Self::Cut
    }
}
