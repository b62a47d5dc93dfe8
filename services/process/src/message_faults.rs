//! Faults of messages: changes a message that is sent while a fault is in force.

use std::collections::VecDeque;

use shared_types::fault::{Kind, MOST_DELAY_TICKS, ScheduledFault, Way, shaped_topic};
use shared_types::random::at as random;
use shared_types::{Header, Message};

use crate::packed::Packed;

/// Room for delayed messages.
const MOST_HELD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

/// The work of the faults of a process on the messages of one of its topics. All that it keeps is in here.
#[derive(Clone, Debug, Default)]
pub struct Shaper {
    /// A corruption of the process's messages concerns this topic.
    is_corruptible: bool,
    /// Messages that faults hold back, with the tick at which they leave.
    held: VecDeque<(u64, Packed)>,
    /// The message that a fault repeats, or that a dead incarnation goes on sending, if there is one.
    stale: Option<Packed>,
    /// The last two messages made.
    made: [Option<Packed>; 2],
}

impl Shaper {
    /// For a topic that a corruption of its process's messages concerns, or does not.
    #[must_use]
    pub fn new(is_corruptible: bool) -> Self {
        Self {
            is_corruptible,
            ..Self::default()
        }
    }

    /// Hands to `deliver` all that leaves at `tick` in place of a message: nothing, the message, another one, or several. `faults` are those that
    /// concern the process at the tick. `injected` is called with the place of each fault that takes effect.
    ///
    /// # Errors
    /// The first of `deliver`.
    pub fn shape<'a, E>(
        &mut self,
        message: &[u8],
        tick: u64,
        faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
        mut injected: impl FnMut(usize),
        mut deliver: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut message = Packed::of(message);
        let label = message.header().tick;
        self.made = [self.made[1].take(), Some(message.clone())];
        let (mut due, mut copies, mut is_stale, mut has_zombie) = (tick, 1, false, false);
        for (place, fault, kind) in faults {
            if !kind.shapes_messages() || !happens(fault, label) {
                continue;
            }
            injected(place);
            match kind {
                Kind::Drop => copies = 0,
                Kind::Duplicate => copies *= 2,
                Kind::Delay => {
                    due += fault.amount as u64 + random(fault.seed, label) % (fault.jitter + 1)
                }
                Kind::Corrupt if self.is_corruptible => corrupt(label, message.bytes_mut(), fault),
                Kind::Corrupt => {}
                Kind::Zombie => has_zombie = true,
                _ => is_stale = true,
            }
        }
        if is_stale {
            // Its own old header with it: whoever reads ticks knows it again.
            let old = self.stale.take().or_else(|| self.before(label));
            message = old.unwrap_or(message);
            self.stale = Some(message.clone());
        } else if !has_zombie {
            self.stale = None;
        }
        // Its numbers are those of when the fault began, its tick is that of the message that will be due next.
        let zombie = has_zombie.then(|| {
            let mut zombie = self.stale.get_or_insert_with(|| message.clone()).clone();
            let header = *message.header();
            *zombie.header_mut() = Header {
                tick: label + 1,
                incarnation: header.incarnation.saturating_sub(1),
                ..header
            };
            zombie
        });
        for _ in 0..copies {
            if due == tick {
                deliver(message.bytes())?;
            } else if self.held.len() < MOST_HELD {
                self.held.push_back((due, message.clone()));
            }
        }
        zombie.iter().try_for_each(|zombie| deliver(zombie.bytes()))
    }

    /// The last message made of a tick before one.
    fn before(&self, tick: u64) -> Option<Packed> {
        let made = self.made.iter().flatten();
        let earlier = made.filter(|one| one.header().tick < tick);
        earlier.max_by_key(|one| one.header().tick).cloned()
    }

    /// Hands over messages held back and due at `tick` or before.
    pub fn flush(&mut self, tick: u64, mut deliver: impl FnMut(&[u8])) {
        let mut place = 0;
        while let Some((due, _)) = self.held.get(place) {
            if *due > tick {
                place += 1;
            } else if let Some((_, message)) = self.held.remove(place) {
                deliver(message.bytes());
            }
        }
    }

    /// Its process has died: what it held back is gone with it, what it has made is remembered.
    pub fn die(&mut self) {
        self.held.clear();
        self.stale = None;
    }
}

/// The place of the fault that keeps a message of a tick from its reader, if there is one: `read` is the topic's place among those that the reader reads,
/// `faults` are those that concern the reader at the tick.
pub fn is_cut<'a>(
    mut faults: impl Iterator<Item = (usize, &'a ScheduledFault, Kind)>,
    read: usize,
    tick: u64,
) -> Option<usize> {
    let cuts = |(_, fault, kind): &(usize, &ScheduledFault, Kind)| {
        *kind == Kind::Cut && fault.target as usize == read && happens(fault, tick)
    };
    faults.find(cuts).map(|(place, ..)| place)
}

/// Whether a fault concerns the message of a tick: the same answer every time.
pub fn happens(scheduled: &ScheduledFault, tick: u64) -> bool {
    // 53 bits make a number in [0, 1) exactly; another draw than the delay's.
    scheduled.probability >= 1.0
        || ((random(!scheduled.seed, tick) >> 11) as f64)
            < scheduled.probability * (1u64 << 53) as f64
}

/// Spoils the number that a corruption aims at.
fn corrupt(tick: u64, message: &mut [u8], scheduled: &ScheduledFault) {
    let start = scheduled.target as usize;
    let Some(bytes) = message.get_mut(start..start + size_of::<f64>()) else {
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
            .for_each(|scheduled| corrupt(tick, bytemuck::bytes_of_mut(message), scheduled));
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use shared_types::SensorSample;
    use shared_types::fault::{Fault, Target};
    use shared_types::process::Role;

    /// The ticks of the messages that leave at once in place of one under faults of these kinds, how many leave later, and the places of the faults that
    /// take effect.
    fn shaped(kinds: &[Kind]) -> (Vec<u64>, usize, Vec<usize>) {
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
        let all = faults
            .iter()
            .enumerate()
            .map(|(place, fault)| (place, fault, fault.kind().unwrap()));
        let (mut shaper, mut sent, mut places) = (Shaper::new(true), Vec::new(), Vec::new());
        let deliver = |message: &[u8]| {
            sent.push(Packed::of(message).header().tick);
            Ok::<(), Infallible>(())
        };
        let injected = |place| places.push(place);
        let Ok(()) = shaper.shape(bytemuck::bytes_of(&message), 7, all, injected, deliver);
        (sent, shaper.held.len(), places)
    }

    #[test]
    fn faults_of_one_message_add_up() {
        let outcome = |kinds: &[Kind]| {
            let (sent, later, places) = shaped(kinds);
            (sent, later, places.len())
        };
        assert_eq!(outcome(&[Kind::Kill, Kind::Sensor]), (vec![5], 0, 0));
        assert_eq!(
            shaped(&[Kind::Duplicate, Kind::Kill, Kind::Duplicate]),
            (vec![5; 4], 0, vec![0, 2])
        );
        assert_eq!(outcome(&[Kind::Duplicate, Kind::Drop]), (vec![], 0, 2));
        assert_eq!(outcome(&[Kind::Zombie]), (vec![5, 6], 0, 1));
        assert_eq!(outcome(&[Kind::Stale]), (vec![5], 0, 1));
        assert_eq!(outcome(&[Kind::Delay]), (vec![], 1, 1));
    }
}
