//! The edge of a process: every message it receives or sends passes here, and nowhere else.
//!
//! It holds what must always hold (messages of dead incarnations are refused, numbers that are not finite neither leave nor enter), the pauses
//! with which `verify` disturbs a process, and how a fault spoils a message.

pub use shared_types::random::at as random;
use std::time::Duration;

use shared_types::Message;
use shared_types::fault::{Kind, ScheduledFault, Way, shaped_topic};
use shared_types::wire::{Field, Header};

/// Refuses the messages of a writer's dead incarnations.
///
/// A SIGKILLed writer's undelivered messages come first, before its replacement's. In real time the control page says which incarnation
/// lives. In lockstep the last messages of the dead one belong to the run (whether they are read before or after the launcher notices the
/// death must not matter), so there only an incarnation older than one already heard is refused.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Fence {
    newest_heard: u32,
}

impl Fence {
    /// Whether a message counts. `living` is the writer's incarnation on the control page, `None` in lockstep.
    pub(crate) fn admits(&mut self, header: &Header, living: Option<u32>) -> bool {
        if header.incarnation < self.newest_heard.max(living.unwrap_or(0)) {
            return false;
        }
        self.newest_heard = header.incarnation;
        true
    }
}

/// Seeded short pauses before a process looks for its next message.
#[derive(Debug)]
pub(crate) struct Pauses {
    seed: u64,
    looks: u64,
}

impl Pauses {
    /// One look in so many is late.
    const ONE_IN: u64 = 8;
    /// The longest pause; µs.
    const LONGEST_US: u64 = 200;

    pub(crate) fn new(seed: u64) -> Self {
        Self { seed, looks: 0 }
    }

    /// The pause before the next look, if there is one.
    pub(crate) fn next(&mut self) -> Option<Duration> {
        self.looks += 1;
        let random = random(self.seed, self.looks);
        let length = Duration::from_micros((random >> 32) % (Self::LONGEST_US + 1));
        random.is_multiple_of(Self::ONE_IN).then_some(length)
    }
}

/// Whether a fault concerns the message of a tick: the same answer every time.
pub(crate) fn happens(strike: &ScheduledFault, tick: u64) -> bool {
    // 53 bits make a number in [0, 1) exactly; another draw than the delay's.
    strike.probability >= 1.0 || ((random(!strike.seed, tick) >> 11) as f64) < strike.probability * (1u64 << 53) as f64
}

/// Spoils the number that a corruption aims at.
pub(crate) fn spoil<M: Message>(message: &mut M, strike: &ScheduledFault, process: &str) {
    let Some((field, place)) = strike.field(process) else { return };
    let tick = message.header().tick;
    let start = field.offset + place * size_of::<f64>();
    let Some(bytes) = bytemuck::bytes_of_mut(message).get_mut(start..start + size_of::<f64>()) else { return };
    let value: f64 = bytemuck::pod_read_unaligned(bytes);
    let spoilt = match strike.way() {
        Some(Way::Nan) => f64::NAN,
        Some(Way::Inf) => f64::INFINITY,
        Some(Way::Flip) => f64::from_bits(value.to_bits() ^ 1 << (random(strike.seed, tick) % 64)),
        _ => (value.abs().max(1.0) * strike.amount).copysign(value),
    };
    bytes.copy_from_slice(&spoilt.to_ne_bytes());
}

/// Does to a message what the faults that strike its process make of it when it leaves in its own tick: its fields, not whether and when.
pub fn leaves_as<M: Message>(message: &mut M, strikes: &[ScheduledFault], process: &str) {
    let tick = message.header().tick;
    let spoils = |strike: &&ScheduledFault| strike.kind() == Some(Kind::Corrupt) && strike.concerns(tick) && happens(strike, tick);
    if shaped_topic(M::TOPIC) {
        strikes.iter().filter(spoils).for_each(|strike| spoil(message, strike, process));
    }
}

/// The first field of a message that holds a number that is not finite.
pub(crate) fn first_not_finite<M: Message>(message: &M) -> Option<&'static str> {
    if message.is_finite() {
        return None;
    }
    let bytes = bytemuck::bytes_of(message);
    let holds_f64 = |field: &Field| field.type_name.contains("f64");
    let is_nested = |field: &Field| !["Header", "u32", "u64", "f64"].iter().any(|plain| field.type_name.contains(plain));
    let is_bad = |field: &&Field| {
        let numbers = bytes[field.offset..field.offset + field.size].chunks_exact(size_of::<f64>());
        holds_f64(field) && numbers.map(bytemuck::pod_read_unaligned::<f64>).any(|number| !number.is_finite())
    };
    // What none of the plain fields holds is inside a nested one.
    let guilty = M::FIELDS.iter().find(is_bad).or_else(|| M::FIELDS.iter().find(|field| is_nested(field)));
    Some(guilty.map_or("a field", |field| field.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{SingularityReport, TorqueCommand};

    fn of(incarnation: u32) -> Header {
        Header { incarnation, ..Header::default() }
    }

    #[test]
    fn the_dead_are_refused_as_soon_as_the_board_or_a_successor_says_so() {
        let mut fence = Fence::default();
        assert!(fence.admits(&of(1), Some(1)));
        assert!(!fence.admits(&of(1), Some(2)), "the launcher has begun incarnation 2");
        assert!(fence.admits(&of(2), Some(2)));
        let mut fence = Fence::default();
        assert!(fence.admits(&of(1), None) && fence.admits(&of(2), None));
        assert!(!fence.admits(&of(1), None), "2 has spoken");
    }

    #[test]
    fn random_numbers_are_those_of_the_reference() {
        // The first outputs of the authors' reference program for seed 1234567.
        assert_eq!([1, 2].map(|index| random(1_234_567, index)), [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
    }

    #[test]
    fn pauses_are_seeded_short_and_rare() {
        let of = |seed| {
            let mut pauses = Pauses::new(seed);
            (0..8_000).map(|_| pauses.next()).collect::<Vec<_>>()
        };
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
        let made: Vec<_> = of(3).into_iter().flatten().collect();
        assert!((800..1_200).contains(&made.len()), "{} of 8000", made.len());
        assert!(made.iter().all(|pause| *pause <= Duration::from_micros(Pauses::LONGEST_US)));
    }

    #[test]
    fn the_guilty_field_is_named() {
        let mut command = TorqueCommand::default();
        assert_eq!(first_not_finite(&command), None);
        command.tau_null[7] = f64::NEG_INFINITY;
        assert_eq!(first_not_finite(&command), Some("tau_null"));
        let mut report = SingularityReport::default();
        report.singularities[1].zeta_B[2] = f64::NAN;
        assert_eq!(first_not_finite(&report), Some("singularities"));
    }
}
