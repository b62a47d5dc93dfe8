//! LogReader messages as the inputs of a step, tick by tick.

use std::collections::BTreeMap;

use message_log::{LogError, LogReader};
use shared_types::Message;
use shared_types::fault::MOST_DELAY_TICKS;

/// The inputs of a step, tick by tick.
pub(super) trait Inputs {
    /// All of one tick.
    type Of;
    /// The next tick that there is something of.
    fn next_tick(&mut self) -> Result<Option<u64>, LogError>;
    /// All of a tick; nothing where something is missing.
    fn at(&mut self, tick: u64) -> Result<Option<Self::Of>, LogError>;
}

impl<M: Message> Inputs for Cursor<M> {
    type Of = M;
    fn next_tick(&mut self) -> Result<Option<u64>, LogError> {
        self.ahead = self.next_message()?;
        Ok(self.ahead.as_ref().map(|message| message.header().tick))
    }
    fn at(&mut self, tick: u64) -> Result<Option<M>, LogError> {
        self.at(tick)
    }
}

impl<A: Message, B: Message> Inputs for (Cursor<A>, Cursor<B>) {
    type Of = (A, B);
    fn next_tick(&mut self) -> Result<Option<u64>, LogError> {
        self.0.next_tick()
    }
    fn at(&mut self, tick: u64) -> Result<Option<(A, B)>, LogError> {
        Ok(self.0.at(tick)?.zip(self.1.at(tick)?))
    }
}

impl<A: Message, B: Message, C: Message> Inputs for (Cursor<A>, Cursor<B>, Cursor<C>) {
    /// The third may be missing.
    type Of = (A, B, Option<C>);
    fn next_tick(&mut self) -> Result<Option<u64>, LogError> {
        self.0.next_tick()
    }
    fn at(&mut self, tick: u64) -> Result<Option<Self::Of>, LogError> {
        let both = self.0.at(tick)?.zip(self.1.at(tick)?);
        let third = self.2.at(tick)?;
        Ok(both.map(|(first, second)| (first, second, third)))
    }
}

/// LogReader messages in the order of their ticks, each tick once: faults make them late, old, or two.
pub(super) struct InOrder<M> {
    pub log: LogReader<M>,
    pub ahead: BTreeMap<u64, M>,
    /// The first tick that has not been handed out.
    pub next: u64,
}

impl<M: Message> InOrder<M> {
    /// More than a fault can hold a message back; messages.
    const AHEAD: usize = 2 * MOST_DELAY_TICKS as usize + 4;

    pub(super) fn next_message(&mut self) -> Result<Option<M>, LogError> {
        while self.ahead.len() < Self::AHEAD
            && let Some(message) = self.log.next_message()?
        {
            let tick = message.header().tick;
            if tick >= self.next {
                self.ahead.entry(tick).or_insert(message);
            }
        }
        let first = self.ahead.pop_first();
        self.next = first
            .as_ref()
            .map_or(self.next, |(tick, _)| tick.saturating_add(1));
        Ok(first.map(|(_, message)| message))
    }
}

/// LogReader messages, looked for by tick.
pub(super) struct Cursor<M: Message> {
    pub log: LogReader<M>,
    /// A message that came before it was asked for.
    pub ahead: Option<M>,
}

impl<M: Message> Cursor<M> {
    pub(super) fn next_message(&mut self) -> Result<Option<M>, LogError> {
        match self.ahead.take() {
            Some(message) => Ok(Some(message)),
            None => self.log.next_message(),
        }
    }

    /// The message of a tick; those of earlier ones are passed over.
    pub(super) fn at(&mut self, tick: u64) -> Result<Option<M>, LogError> {
        while let Some(message) = self.next_message()? {
            if message.header().tick == tick {
                return Ok(Some(message));
            }
            if message.header().tick > tick {
                self.ahead = Some(message);
                break;
            }
        }
        Ok(None)
    }
}
