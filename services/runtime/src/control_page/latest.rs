//! The latest messages of a run on its control page, as far as `armplane top` and the line below a steered run show them. Each topic's writer stores its
//! own, which costs it no system call, lock or port.

use std::mem::offset_of;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::{bytes_of_mut, pod_read_unaligned};
use shared_types::{
    ControlState, MAX_SINGULARITIES, Message, SensorSample, ServoState, SingularityReport,
    SingularityState, TorqueCommand,
};

const WORD: usize = size_of::<u64>();

/// Words of a report of singularities, of which most is shown: the count; and kind, class, whether inside and s of each.
const MOST_WORDS: usize = 1 + 3 * MAX_SINGULARITIES;

/// Begin and end of a part of a message; bytes, in whole words.
pub(crate) type Part = [usize; 2];

/// The parts of a topic's messages that are shown.
pub(crate) fn shown(topic: &str) -> &'static [Part] {
    const fn listed(place: usize) -> Part {
        let first = offset_of!(SingularityReport, singularities);
        let begin = first + place * size_of::<SingularityState>();
        [begin, begin + offset_of!(SingularityState, s_rate)]
    }
    const COUNT: usize = offset_of!(SingularityReport, count);
    const REPORT: [Part; 1 + MAX_SINGULARITIES] = [
        [COUNT, COUNT + WORD],
        listed(0),
        listed(1),
        listed(2),
        listed(3),
    ];
    const TORQUE: [Part; 1] = [[offset_of!(TorqueCommand, phase), size_of::<TorqueCommand>()]];
    const CONTROL: [Part; 1] = [[offset_of!(ControlState, mode), size_of::<ControlState>()]];
    const SERVO: [Part; 1] = [[offset_of!(ServoState, speed_scale), size_of::<ServoState>()]];
    const SENSOR: [Part; 1] = [[offset_of!(SensorSample, drive), size_of::<SensorSample>()]];
    match topic {
        SingularityReport::TOPIC => &REPORT,
        TorqueCommand::TOPIC => &TORQUE,
        ControlState::TOPIC => &CONTROL,
        ServoState::TOPIC => &SERVO,
        SensorSample::TOPIC => &SENSOR,
        _ => &[],
    }
}

/// The latest message of a topic, as far as it is shown.
#[repr(C)]
#[derive(Debug, Default)]
pub(crate) struct Latest([AtomicU64; MOST_WORDS]);

impl Latest {
    /// Stores the parts of a message that are shown.
    #[inline]
    pub(crate) fn store(&self, shown: &[Part], message: &[u8]) {
        let words = |[begin, end]: &Part| message[*begin..*end].chunks_exact(WORD);
        for (cell, word) in self.0.iter().zip(shown.iter().flat_map(words)) {
            cell.store(pod_read_unaligned(word), Ordering::Relaxed);
        }
    }

    /// The message, zero where it is not shown. Words of neighbouring ticks may stand side by side.
    pub(crate) fn load<M: Message>(&self) -> M {
        let (mut message, mut cells) = (M::zeroed(), self.0.iter());
        for [begin, end] in shown(M::TOPIC) {
            let words = bytes_of_mut(&mut message)[*begin..*end].chunks_exact_mut(WORD);
            for (word, cell) in words.zip(&mut cells) {
                word.copy_from_slice(&cell.load(Ordering::Relaxed).to_ne_bytes());
            }
        }
        message
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn again<M: Message>(message: &M) -> M {
        let latest = Latest::default();
        latest.store(shown(M::TOPIC), bytemuck::bytes_of(message));
        latest.load()
    }

    #[test]
    fn what_is_shown_of_a_message_comes_back() {
        let mut report = SingularityReport {
            count: 4,
            ..Default::default()
        };
        for (place, one) in (1..).zip(&mut report.singularities) {
            (one.kind, one.class, one.inside, one.s) = (place, 2, 1, -0.25);
        }
        let torque = TorqueCommand {
            phase: 1,
            ..Default::default()
        };
        let control = ControlState {
            mode: [0, 5, 0, 3],
            ..Default::default()
        };
        let servo = ServoState {
            speed_scale: 0.5,
            nearest: 0.25,
            reason: 1,
            stops: 3,
            ..Default::default()
        };
        let sample = SensorSample {
            drive: 2,
            stale_ticks: 7,
            ..Default::default()
        };
        assert_eq!((again(&report), again(&torque)), (report, torque));
        assert_eq!((again(&control), again(&servo)), (control, servo));
        assert_eq!(again(&sample), sample);
    }
}
