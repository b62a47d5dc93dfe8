//! Checks the program's part of an exchange page. A foreign process may write anything there at any
//! time, so each field is read once, checked, and used as it was read.

use std::sync::atomic::Ordering;

use bytemuck::bytes_of_mut;
use process::first_not_finite;
use shared_types::codes::{
    ANSWER_DONE, ANSWER_FAILED, ANSWER_OVER, PROGRAM_AWAITED, PROGRAM_JOINED, USE_WRITES,
};
use shared_types::exchange::{EXCHANGE_STATE, EXCHANGE_VERSION};
use shared_types::layout::MessageLayout;
use shared_types::topics::Topic;
use shared_types::wire::Header;

use crate::failure::Failure;
use crate::page::Page;

/// The program's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The step is done.
    Done,
    /// The run ends with this tick.
    Over,
    /// None: the run stops.
    Stopped,
}

/// Whether the program has joined: `false` while it is awaited.
///
/// # Errors
/// [`Failure`] if it refuses the page, or its version, its outputs or its layouts are others.
pub fn has_joined(page: &Page, topics: &[(MessageLayout, u32)]) -> Result<bool, Failure> {
    let program = page.program();
    if program == PROGRAM_AWAITED {
        return Ok(false);
    }
    let theirs = page.program_version();
    if theirs != EXCHANGE_VERSION {
        let ours = EXCHANGE_VERSION;
        return Err(Failure::Version { theirs, ours });
    }
    if program != PROGRAM_JOINED {
        return Err(Failure::Refused(page.complaint()));
    }
    for (place, (layout, usage)) in topics.iter().enumerate() {
        let (theirs, theirs_hash) = page.program_type(place);
        let topic = layout.topic.clone();
        if theirs.is_empty() && *usage == USE_WRITES {
            return Err(Failure::Unwritten(topic));
        }
        if !theirs.is_empty() && (theirs_hash != layout.hash || theirs != layout.type_name) {
            let (ours, ours_hash) = (layout.type_name.clone(), layout.hash);
            return Err(Failure::Layout {
                topic,
                theirs,
                theirs_hash,
                ours,
                ours_hash,
            });
        }
    }
    Ok(true)
}

/// The answer to the request of this count and tick: `Err` of the count of answers while there is none.
///
/// # Errors
/// [`Failure`] if the program writes another count, tick or answer than can be, or cannot go on.
pub fn answer(page: &Page, expected: u32, tick: u64) -> Result<Result<Answer, u32>, Failure> {
    let found = page.answers().load(Ordering::Acquire);
    if found == expected.wrapping_sub(1) {
        return Ok(Err(found));
    }
    if found != expected {
        return Err(Failure::Count {
            tick,
            found,
            expected,
        });
    }
    let (code, answered) = (page.answer(), page.answer_tick());
    match code {
        ANSWER_DONE | ANSWER_OVER if answered != tick => Err(Failure::Tick {
            tick,
            found: answered,
        }),
        ANSWER_DONE => Ok(Ok(Answer::Done)),
        ANSWER_OVER => Ok(Ok(Answer::Over)),
        ANSWER_FAILED => Err(Failure::Failed {
            tick,
            complaint: page.complaint(),
        }),
        found => Err(Failure::Code { tick, found }),
    }
}

/// The length of the checkpoint that the program has written; 0 for none.
///
/// # Errors
/// [`Failure::State`] if it is longer than its room.
pub fn state_bytes(page: &Page, tick: u64) -> Result<usize, Failure> {
    let found = page.state_bytes();
    if found > EXCHANGE_STATE {
        return Err(Failure::State { tick, found });
    }
    Ok(found)
}

/// A message of the program: a copy that it cannot change between check and sending.
pub struct Draft<M: Topic> {
    place: usize,
    message: M,
}

impl<M: Topic> Draft<M> {
    /// Of the topic at a place of the page.
    pub fn of(place: usize) -> Self {
        Self {
            place,
            message: M::zeroed(),
        }
    }

    /// Copies the message from the page, its header left out; the name of its topic and of the first field with a number that is not finite.
    pub fn not_finite(&mut self, page: &Page) -> Option<(&'static str, String)> {
        page.get(
            self.place,
            size_of::<Header>(),
            &mut bytes_of_mut(&mut self.message)[size_of::<Header>()..],
        );
        let field = first_not_finite(&self.message)?;
        Some((M::TOPIC, field.to_owned()))
    }

    /// The message that [`Draft::not_finite`] has copied last, as one of a tick.
    pub fn message(&mut self, tick: u64) -> M {
        *self.message.header_mut() = Header {
            tick,
            ..Header::default()
        };
        self.message
    }
}
