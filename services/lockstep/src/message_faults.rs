//! Faults of messages: changes a message that is sent while a fault is in force.

use std::collections::VecDeque;

use shared_types::fault::{Kind, MOST_DELAY_TICKS, ScheduledFault, Way, shaped_topic};
use shared_types::random::at as random;
use shared_types::{Header, Message};

/// A message as faults see it: its header, and its bytes.
pub trait Shaped: Clone {
    /// Its header.
    fn header(&self) -> &Header;
    /// Its header, to be changed.
    fn header_mut(&mut self) -> &mut Header;
    /// All its bytes.
    fn bytes_mut(&mut self) -> &mut [u8];
}

impl<M: Message> Shaped for M {
    fn header(&self) -> &Header {
        Message::header(self)
    }
    fn header_mut(&mut self) -> &mut Header {
        Message::header_mut(self)
    }
    fn bytes_mut(&mut self) -> &mut [u8] {
        bytemuck::bytes_of_mut(self)
    }
}

/// Room for delayed messages.
const MOST_HELD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

/// The work of the faults of a process on the messages of one of its topics. Takes its memory at the beginning.
#[derive(Debug)]
pub struct Shaper<M> {
    /// Messages that faults hold back, with the tick at which they leave.
    held: VecDeque<(u64, M)>,
    /// The message that a fault repeats, or that a dead incarnation goes on sending, if there is one.
    stale: Vec<M>,
}

impl<M> Default for Shaper<M> {
    fn default() -> Self {
        Self {
            held: VecDeque::with_capacity(MOST_HELD),
            stale: Vec::with_capacity(1),
        }
    }
}

impl<M: Shaped> Shaper<M> {
    /// Hands to `deliver` all that leaves at `tick` in place of a message: nothing, the message, another one, or several. `faults` are those that
    /// concern the process at the tick; a corruption concerns the message where `is_corruptible`. `before` gives the message before it, and
    /// `injected` is called with the place of each fault that takes effect.
    ///
    /// # Errors
    /// The first of `deliver`.
    pub fn shape<'a, E>(
        &mut self,
        message: &M,
        (tick, is_corruptible): (u64, bool),
        faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
        before: impl FnOnce() -> Option<M>,
        injected: impl FnMut(usize),
        mut deliver: impl FnMut(&M) -> Result<(), E>,
    ) -> Result<(), E> {
        let (mut message, label) = (message.clone(), message.header().tick);
        let Shape {
            due,
            copies,
            is_stale,
            has_zombie,
        } = shape(&mut message, tick, is_corruptible, faults, injected);
        if is_stale {
            // Its own old header with it: whoever reads ticks knows it again.
            let old = self.stale.pop().or_else(before).unwrap_or(message);
            self.stale.push(old.clone());
            message = old;
        } else if !has_zombie {
            self.stale.clear();
        }
        // Its numbers are those of when the fault began, its tick is that of the message that will be due next.
        let zombie = has_zombie.then(|| {
            if self.stale.is_empty() {
                self.stale.push(message.clone());
            }
            let (mut zombie, header) = (self.stale[0].clone(), *message.header());
            *zombie.header_mut() = Header {
                tick: label + 1,
                incarnation: header.incarnation.saturating_sub(1),
                ..header
            };
            zombie
        });
        for _ in 0..copies {
            if due == tick {
                deliver(&message)?;
            } else if self.held.len() < MOST_HELD {
                self.held.push_back((due, message.clone()));
            }
        }
        zombie.iter().try_for_each(deliver)
    }

    /// Hands over messages held back and due at `tick` or before.
    pub fn flush(&mut self, tick: u64, mut deliver: impl FnMut(&M)) {
        let mut place = 0;
        while let Some((due, _)) = self.held.get(place) {
            if *due > tick {
                place += 1;
            } else if let Some((_, message)) = self.held.remove(place) {
                deliver(&message);
            }
        }
    }
}

/// The outcome of one message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    /// The tick at which it leaves.
    due: u64,
    /// How many times it leaves.
    copies: u32,
    /// An older message leaves instead.
    is_stale: bool,
    /// A message of a dead incarnation leaves behind it.
    has_zombie: bool,
}

/// Applies the faults that concern a process at `tick` to a message, in the order of the fault table: its fields in place, whether and when it leaves
/// as the answer. A corruption concerns the message where `is_corruptible`. `injected` is called with the place of each fault that takes effect.
fn shape<'a, M: Shaped>(
    message: &mut M,
    tick: u64,
    is_corruptible: bool,
    faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
    mut injected: impl FnMut(usize),
) -> Shape {
    let label = message.header().tick;
    let mut shape = Shape {
        due: tick,
        copies: 1,
        is_stale: false,
        has_zombie: false,
    };
    for (place, fault, kind) in faults {
        if !kind.shapes_messages() || !happens(fault, label) {
            continue;
        }
        injected(place);
        match kind {
            Kind::Drop => shape.copies = 0,
            Kind::Duplicate => shape.copies *= 2,
            // It leaves after the next one: that one is delivered before what is due is flushed.
            Kind::Reorder => shape.due += 1,
            Kind::Delay => {
                shape.due += fault.amount as u64 + random(fault.seed, label) % (fault.jitter + 1)
            }
            Kind::Corrupt if is_corruptible => corrupt(message, fault),
            Kind::Corrupt => {}
            Kind::Zombie => shape.has_zombie = true,
            _ => shape.is_stale = true,
        }
    }
    shape
}

/// Whether a fault concerns the message of a tick: the same answer every time.
pub fn happens(scheduled: &ScheduledFault, tick: u64) -> bool {
    // 53 bits make a number in [0, 1) exactly; another draw than the delay's.
    scheduled.probability >= 1.0
        || ((random(!scheduled.seed, tick) >> 11) as f64)
            < scheduled.probability * (1u64 << 53) as f64
}

/// Spoils the number that a corruption aims at.
fn corrupt(message: &mut impl Shaped, scheduled: &ScheduledFault) {
    let (tick, start) = (message.header().tick, scheduled.target as usize);
    let place = start..start + size_of::<f64>();
    let Some(bytes) = message.bytes_mut().get_mut(place) else {
        return;
    };
    let value: f64 = bytemuck::pod_read_unaligned(bytes);
    let corrupted = match scheduled.way() {
        Some(Way::Nan) => f64::NAN,
        Some(Way::Inf) => f64::INFINITY,
        Some(Way::Flip) => {
            f64::from_bits(value.to_bits() ^ 1 << (random(scheduled.seed, tick) % 64))
        }
        _ => (value.abs().max(1.0) * scheduled.amount).copysign(value),
    };
    bytes.copy_from_slice(&corrupted.to_ne_bytes());
}

/// Applies the faults in force to the fields of a message, not to whether and when it leaves.
pub fn apply_to_outgoing<M: Message>(message: &mut M, scheduled_faults: &[ScheduledFault]) {
    let tick = message.header().tick;
    let corrupts = |scheduled: &&ScheduledFault| {
        scheduled.kind() == Some(Kind::Corrupt)
            && scheduled.concerns(tick)
            && happens(scheduled, tick)
    };
    if shaped_topic(M::TOPIC) {
        scheduled_faults
            .iter()
            .filter(corrupts)
            .for_each(|scheduled| corrupt(message, scheduled));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::SensorSample;
    use shared_types::fault::{Fault, Target};
    use shared_types::process::Role;

    fn shaped(kinds: &[Kind]) -> (Shape, SensorSample, Vec<usize>) {
        let fault = |kind: &Kind| {
            Fault {
                at_tick: Some(5),
                ..Fault::new("plant", *kind)
            }
            .schedule(&Target::sending::<SensorSample>(0, Role::World), 1000, 3)
            .unwrap()
        };
        let faults: Vec<_> = kinds.iter().map(fault).collect();
        let mut message = SensorSample::default();
        message.header.tick = 5;
        let mut places = Vec::new();
        let all = faults
            .iter()
            .enumerate()
            .map(|(place, fault)| (place, fault, fault.kind().unwrap()));
        let shape = shape(&mut message, 7, true, all, |place| places.push(place));
        (shape, message, places)
    }

    #[test]
    fn faults_of_one_message_add_up() {
        let outcome = |kinds: &[Kind]| {
            let (shape, _, places) = shaped(kinds);
            (
                shape.due,
                shape.copies,
                shape.is_stale,
                shape.has_zombie,
                places,
            )
        };
        let none = (7, 1, false, false, vec![]);
        assert_eq!(outcome(&[Kind::Kill, Kind::Sensor]), none);
        assert_eq!(
            outcome(&[Kind::Duplicate, Kind::Kill, Kind::Duplicate, Kind::Reorder]),
            (8, 4, false, false, vec![0, 2, 3])
        );
        assert_eq!(outcome(&[Kind::Duplicate, Kind::Drop]).1, 0);
        assert!(outcome(&[Kind::Zombie]).3 && outcome(&[Kind::Stale]).2);
        assert!(outcome(&[Kind::Delay]).0 > 7);
    }
}
