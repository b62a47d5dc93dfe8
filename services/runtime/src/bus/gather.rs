//! Gathers every message of a topic in order, even after a death, whether or not this program knows
//! the type.

use std::rc::Rc;

use lockstep::Recall;

use crate::bus::format::header;
use crate::bus::inlet::{Admission, Inlet};
use crate::bus::port::Receiver;
use crate::context::Context;
use crate::control_page::Count;
use crate::memory::HandedOver;
use crate::wait::Interrupted;

/// Number of further requests to the retainer if it lacks a message that has arrived on the topic.
const ATTEMPTS: u32 = 5;

/// Gathers everything of a topic; never waits.
pub(crate) struct Gathering {
    inlet: Inlet,
    last: Option<u64>,
    lost: u64,
    /// In a replacement, until it is in step: the messages that were on their way to its predecessor.
    recall: Option<(HandedOver, Recall)>,
}

impl Gathering {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        let inlet = Inlet::new(shared, receiver, Admission::InOrder);
        Self {
            inlet,
            last: None,
            lost: 0,
            recall: None,
        }
    }

    /// Hands over all messages that are there, oldest first.
    pub(crate) fn collect(&mut self, take: &mut dyn FnMut(&[u8])) -> Result<(), Interrupted> {
        if let Some(recall) = self.recall.take() {
            self.recall = self.catch_up(recall, take)?;
        }
        while self.recall.is_none()
            && let Some(message) = self.inlet.receive_in_order()?
        {
            self.hand_over(&message, take);
        }
        Ok(())
    }

    fn hand_over(&mut self, message: &[u8], take: &mut dyn FnMut(&[u8])) {
        if self.inlet.admits(message) {
            self.count(header(message).tick);
            take(message);
        }
    }

    /// First the retainer's messages, then those received since; returns the number left to recall.
    ///
    /// A writer sends to the retainer first. So a message that has come by its topic is in the retainer too, with all that lies before it, and a
    /// message that a writer sent without knowing of this reader is in the retainer alone.
    fn catch_up(
        &mut self,
        (file, mut recall): (HandedOver, Recall),
        take: &mut dyn FnMut(&[u8]),
    ) -> Result<Option<(HandedOver, Recall)>, Interrupted> {
        self.inlet
            .shared
            .await_hand_over(self.inlet.format().topic)?;
        while let Some(message) = recall.take(&file) {
            self.hand_over(&message, take);
        }
        loop {
            let Some(message) = self.inlet.receive_any()? else {
                break;
            };
            let is_it = |one: &Vec<u8>| **one == *message;
            if recall.knows(&file, is_it) {
                continue;
            }
            // It came after the file was read: what lies before it comes first, and nothing after it can be missed.
            let mut place = None;
            for _ in 0..ATTEMPTS {
                self.inlet
                    .shared
                    .await_hand_over(self.inlet.format().topic)?;
                place = recall.place_ahead(&file, is_it);
                if place.is_some() {
                    break;
                }
            }
            // Without a place the retainer has lost it again, by its depth: then what lay before it is lost too, and the gap is counted.
            while let Some(before) = place.and_then(|place| recall.take_before(&file, place)) {
                self.hand_over(&before, take);
            }
            self.hand_over(&message, take);
            return Ok(None);
        }
        Ok((!recall.is_in_step()).then_some((file, recall)))
    }

    /// Counts a message of a tick.
    pub(crate) fn count(&mut self, tick: u64) {
        let expected = self.last.map_or(0, |last| last + 1);
        if tick > expected {
            self.lost += tick - expected;
            self.inlet.shared.entry().add(Count::Lost, tick - expected);
        } else if tick < expected {
            self.inlet.shared.entry().add(Count::Repeated, 1);
        }
        self.last = self.last.max(Some(tick));
        self.inlet.begin_at(tick.saturating_add(1));
    }

    pub(crate) fn resume(&mut self, last: Option<u64>, lost: u64) {
        (self.last, self.lost) = (last, lost);
        self.inlet.begin_at(last.map_or(0, |last| last + 1));
    }

    /// Goes on behind the last message that an earlier reader has left in its files.
    pub(crate) fn recall(&mut self, last: Option<&[u8]>) -> Result<(), Interrupted> {
        let (context, format) = (&self.inlet.shared, self.inlet.format());
        // The predecessor's files are complete before they are read.
        context.await_hand_over(format.topic)?;
        let handed_over = HandedOver::open(&context.run, format.topic, format.bytes);
        let handed_over = handed_over.map_err(|error| context.port_failed(format.topic, error))?;
        let recall = Recall::after(&handed_over, last.map(<[u8]>::to_vec).as_ref());
        self.recall = Some((handed_over, recall));
        Ok(())
    }

    pub(crate) fn last(&self) -> Option<u64> {
        self.last
    }

    pub(crate) fn lost(&self) -> u64 {
        self.lost
    }
}
