//! Topics as a step sees them.

use bytemuck::{bytes_of, from_bytes_mut, try_from_bytes};
use shared_types::Message;
use shared_types::fault::ScheduledFault;
use shared_types::topics::{OfTopic, Topic};

use crate::fence::first_not_finite;
use crate::scratch::Scratch;

/// Most topics that a process reads, and most that it writes.
pub const MOST_PORTS: usize = 8;

/// A topic that a process reads or writes, without the type of its message.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// Its name.
    pub topic: &'static str,
    /// The versioned name of its message.
    pub type_name: &'static str,
    /// Bytes of a message.
    pub bytes: usize,
    /// Hash of the message's layout.
    pub layout: fn() -> u64,
    /// The first field of a message that holds a number that is not finite.
    pub not_finite: fn(&[u8]) -> Option<&'static str>,
    /// Of an input: without it there is no step.
    pub is_needed: bool,
}

impl Port {
    /// The topic of `M`: an input that a step cannot do without, or an output.
    #[must_use]
    pub const fn of<M: Message>() -> Self {
        Self {
            topic: M::TOPIC,
            type_name: M::TYPE_NAME,
            bytes: size_of::<M>(),
            layout: M::layout_hash,
            not_finite: not_finite::<M>,
            is_needed: true,
        }
    }

    /// The topic of `M`, which may bring nothing, or not be in the graph.
    #[must_use]
    pub const fn optional<M: Message>() -> Self {
        let mut port = Self::of::<M>();
        port.is_needed = false;
        port
    }
}

impl OfTopic for Port {
    fn of_topic<M: Topic>() -> Self {
        Self::of::<M>()
    }
}

fn not_finite<M: Message>(message: &[u8]) -> Option<&'static str> {
    try_from_bytes::<M>(message).map_or(Some("its size"), first_not_finite)
}

/// The inputs of a step.
#[derive(Debug, Default)]
pub struct Inputs<'a> {
    /// The tick that is computed. Messages are of this tick; the one that closes the loop is of an earlier one.
    pub tick: u64,
    /// The faults of the arm's own sensors and drives in force at the tick: for the process that makes the ticks.
    pub faults: &'a [ScheduledFault],
    messages: [Option<(&'static str, &'a [u8])>; MOST_PORTS],
}

impl<'a> Inputs<'a> {
    /// Those of a tick, without messages yet.
    #[must_use]
    pub fn of(tick: u64, faults: &'a [ScheduledFault]) -> Self {
        Self {
            tick,
            faults,
            messages: [None; MOST_PORTS],
        }
    }

    /// Adds a message; one that has no room is none.
    pub fn add(&mut self, topic: &'static str, message: &'a [u8]) {
        if let Some(free) = self.messages.iter_mut().find(|one| one.is_none()) {
            *free = Some((topic, message));
        }
    }

    /// The message of a topic; `None` where none has come.
    #[must_use]
    #[inline]
    pub fn get<M: Message>(&self) -> Option<&'a M> {
        try_from_bytes(self.bytes(M::TOPIC)?).ok()
    }

    /// The same as bytes.
    #[must_use]
    #[inline]
    pub fn bytes(&self, topic: &str) -> Option<&'a [u8]> {
        let mut messages = self.messages.iter().flatten();
        messages
            .find(|(of, _)| *of == topic)
            .map(|(_, message)| *message)
    }
}

/// The outputs of a step.
#[derive(Debug)]
pub struct Outputs<'a> {
    /// Shared with other steps on the same thread.
    pub scratch: &'a mut Scratch,
    /// The step has noticed that an input, or the arm's own hardware, is at fault.
    pub has_noticed: bool,
    messages: [Option<(&'static str, &'a mut [u8])>; MOST_PORTS],
}

impl<'a> Outputs<'a> {
    /// None yet.
    #[must_use]
    pub fn new(scratch: &'a mut Scratch) -> Self {
        Self {
            scratch,
            has_noticed: false,
            messages: Default::default(),
        }
    }

    /// Adds the place of a message; one that has no room is not written.
    pub fn add(&mut self, topic: &'static str, message: &'a mut [u8]) {
        if let Some(free) = self.messages.iter_mut().find(|one| one.is_none()) {
            *free = Some((topic, message));
        }
    }

    /// Writes a message. The runtime fills its header.
    #[inline]
    pub fn put<M: Message>(&mut self, message: &M) {
        let mut places = self.messages.iter_mut().flatten();
        if let Some((_, place)) = places.find(|one| is_of::<M>(one)) {
            place.copy_from_slice(bytes_of(message));
        }
    }

    /// The place of a message, to be filled in place, once a step: it holds an earlier message, all of which is to be overwritten. `None`: the graph does
    /// not have the topic.
    #[inline]
    pub fn place<M: Message>(&mut self) -> Option<&'a mut M> {
        let slot = self
            .messages
            .iter_mut()
            .find(|one| one.as_ref().is_some_and(is_of::<M>))?;
        slot.take().map(|(_, place)| from_bytes_mut(place))
    }

    /// The place of a topic's message as bytes; `None`: the graph does not have the topic.
    pub fn bytes(&mut self, topic: &str) -> Option<&mut [u8]> {
        let mut places = self.messages.iter_mut().flatten();
        places
            .find(|(of, _)| *of == topic)
            .map(|(_, place)| &mut **place)
    }
}

/// Whether a place is for a message `M`: by its topic and its size.
fn is_of<M: Message>(place: &(&'static str, &mut [u8])) -> bool {
    place.0 == M::TOPIC && place.1.len() == size_of::<M>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{ControlState, SensorSample, TorqueCommand};

    #[test]
    fn messages_are_found_by_their_type() {
        let mut sample = SensorSample::default();
        sample.header.tick = 7;
        let mut inputs = Inputs::of(7, &[]);
        inputs.add(SensorSample::TOPIC, bytes_of(&sample));
        assert_eq!(inputs.get::<SensorSample>(), Some(&sample));
        assert_eq!(inputs.get::<TorqueCommand>(), None);
        let (mut state, mut torque) = (ControlState::default(), TorqueCommand::default());
        let mut scratch = Scratch::default();
        let mut outputs = Outputs::new(&mut scratch);
        outputs.add(ControlState::TOPIC, bytemuck::bytes_of_mut(&mut state));
        outputs.add(TorqueCommand::TOPIC, bytemuck::bytes_of_mut(&mut torque));
        outputs.put(&SensorSample::default());
        outputs.put(&TorqueCommand {
            phase: 2,
            ..TorqueCommand::default()
        });
        outputs.place::<ControlState>().unwrap().refusal = 3;
        assert!(outputs.place::<ControlState>().is_none());
        assert_eq!((state.refusal, torque.phase), (3, 2));
    }
}
