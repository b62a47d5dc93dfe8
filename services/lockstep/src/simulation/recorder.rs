//! The recorder of a simulated run, with rounds, message logs, checkpoints, deaths, replacements,
//! and a volume that fills up.
//!
//! Retainers, their files and the recorder's buffers work as in `runtime::bus`, with the real
//! [`Recall`] and small sizes. A message is a tick and a value that stands for its bytes. The
//! recorder keeps a count and a digest per topic; at the end, both must equal those of the messages
//! sent, in order.

use std::collections::VecDeque;

use super::world::{Sent, digest};
use crate::checkpoint_rule::most_ticks_unsaved;
use crate::engine::{Observed, Step};
use crate::recall::{Recall, Ring, oldest_missed};

/// Ticks that the source may be ahead of the recorder.
pub(super) const LAG: u64 = 4;
/// Messages that a retainer holds unread, and a buffer of the recorder: four times as many, as in `runtime`.
const HELD: usize = 4 * LAG as usize;
/// Messages in a block of a log.
const BLOCK: usize = 3;
/// Ticks between checkpoints, if the logs have everything that a replacement needs.
const USUAL: u64 = 24;

/// The file to which the retainer of a topic hands over messages.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct HandedOver(Vec<Sent>);

impl Ring for HandedOver {
    type Message = Sent;

    fn count(&self) -> u64 {
        self.0.len() as u64
    }

    fn length(&self) -> u64 {
        2 * HELD as u64
    }

    fn get(&self, number: u64) -> Option<Sent> {
        let is_there = number + self.length() > self.count();
        self.0.get(number as usize).copied().filter(|_| is_there)
    }
}

/// Messages of a topic that the recorder has taken in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Taken {
    count: u64,
    digest: u64,
    last: Option<Sent>,
    /// Messages in the log, from which a replacement continues.
    logged: usize,
    /// The volume has refused a block: no more messages are kept.
    is_log_over: bool,
}

impl Taken {
    fn add(&mut self, message: Sent) {
        *self = Self {
            count: self.count + 1,
            digest: digest((self.digest, message)),
            last: Some(message),
            ..*self
        };
    }
}

/// A topic as the recorder and its retainer have it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Channel {
    writer: usize,
    /// All that has been sent, for the comparison at the end.
    sent: Taken,
    /// In the retainer, and not handed over.
    held: VecDeque<Sent>,
    handed_over: HandedOver,
    /// On its way to the recorder.
    buffer: VecDeque<Sent>,
    /// The writer knows of this recorder.
    is_connected: bool,
    taken: Taken,
    saved: Taken,
    /// Taken in, and in no block of the log.
    unlogged: Vec<Sent>,
    log: Vec<Sent>,
    recall: Option<Recall>,
}

fn put(ring: &mut VecDeque<Sent>, message: Sent) {
    if ring.len() == HELD {
        ring.pop_front();
    }
    ring.push_back(message);
}

impl Channel {
    fn hand_over(&mut self) {
        self.handed_over.0.extend(self.held.drain(..));
    }

    fn take(&mut self, message: Sent, room: &mut u64) {
        self.taken.add(message);
        if !self.taken.is_log_over {
            self.unlogged.push(message);
            if self.unlogged.len() == BLOCK {
                self.write_block(room);
            }
        }
    }

    fn write_block(&mut self, room: &mut u64) {
        if self.unlogged.is_empty() {
            return;
        }
        match room.checked_sub(1) {
            Some(left) => {
                *room = left;
                self.taken.logged += self.unlogged.len();
                self.log.append(&mut self.unlogged);
            }
            None => {
                self.taken.is_log_over = true;
                self.unlogged.clear();
            }
        }
    }

    /// The next message in order: from the buffer, or what a dead writer had sent to its retainer alone. `before_death`: the first tick of which the writer
    /// has sent nothing more when it died.
    fn receive(&mut self, before_death: u64) -> Option<Sent> {
        let next = self.taken.last.map_or(0, |last| last.tick + 1);
        let came = self.buffer.front().map_or(u64::MAX, |front| front.tick);
        let is_missed = next < before_death && came > next;
        let (sent, before) = (self.handed_over.newest_first(), came.min(before_death));
        let missed = is_missed.then(|| oldest_missed(sent, next, before, |one| one.tick));
        missed.flatten().or_else(|| self.buffer.pop_front())
    }

    /// The second half of catching up in `runtime`: messages that arrived on the topic since the
    /// file was read.
    fn catch_up(&mut self, mut recall: Recall, room: &mut u64) -> Option<Recall> {
        while let Some(message) = self.buffer.pop_front() {
            if recall.knows(&self.handed_over, |one| *one == message) {
                continue;
            }
            self.hand_over();
            let place = recall.place_ahead(&self.handed_over, |one| *one == message);
            while let Some(before) =
                place.and_then(|place| recall.take_before(&self.handed_over, place))
            {
                self.take(before, room);
            }
            self.take(message, room);
            return None;
        }
        (!recall.is_in_step()).then_some(recall)
    }
}

/// State of the recorder between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum At {
    /// Between two rounds.
    Resting,
    /// In a round that began when the run had made so many ticks: before the draining of a topic, or within it.
    Draining {
        ticks: u64,
        channel: usize,
        has_read: bool,
    },
    /// At the end of the round.
    Ending { ticks: u64 },
}

/// The recorder, and the state that outlives it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Recorder {
    channels: Vec<Channel>,
    at: At,
    /// Blocks for which the volume has room.
    room: u64,
    saved_ticks: u64,
    /// The round in hand is the last one.
    is_last: bool,
}

impl Recorder {
    /// Of a graph with so many outputs by process, on a volume with room for so many blocks of the logs.
    pub(super) fn new(outputs: &[usize], room: u64) -> Self {
        let writers = outputs.iter().enumerate();
        let writers = writers.flat_map(|(writer, count)| std::iter::repeat_n(writer, *count));
        let channel = |writer| Channel {
            writer,
            is_connected: true,
            ..Channel::default()
        };
        Self {
            channels: writers.map(channel).collect(),
            at: At::Resting,
            room,
            saved_ticks: 0,
            is_last: false,
        }
    }

    /// A message reaches the retainer of its topic; `learns`: before that its writer has looked for new readers, and there is a recorder.
    pub(super) fn retain(&mut self, topic: usize, message: Sent, learns: bool) {
        let channel = &mut self.channels[topic];
        channel.is_connected |= learns;
        channel.sent.add(message);
        put(&mut channel.held, message);
    }

    /// A retained message reaches the recorder, if its writer knows the recorder.
    pub(super) fn deliver(&mut self, topic: usize, message: Sent) {
        let channel = &mut self.channels[topic];
        if channel.is_connected {
            put(&mut channel.buffer, message);
        }
    }

    /// A writer has opened its topics after this recorder has.
    pub(super) fn connect(&mut self, writer: usize) {
        self.channels
            .iter_mut()
            .filter(|channel| channel.writer == writer)
            .for_each(|channel| channel.is_connected = true);
    }

    /// The launcher copies the retained messages.
    pub(super) fn hand_over(&mut self) {
        self.channels.iter_mut().for_each(Channel::hand_over);
    }

    /// The end of the recorder: its memory and its buffers are gone.
    pub(super) fn die(&mut self) {
        (self.at, self.is_last) = (At::Resting, false);
        for channel in &mut self.channels {
            channel.buffer.clear();
            channel.unlogged.clear();
            (channel.is_connected, channel.taken, channel.recall) = (false, Taken::default(), None);
        }
    }

    /// A replacement continues from the last checkpoint and the logs, and fetches the messages that
    /// were under way to its predecessor.
    pub(super) fn resume(&mut self) {
        for channel in &mut self.channels {
            channel.taken = channel.saved;
            if !channel.taken.is_log_over {
                // Blocks after the checkpoint.
                channel.log[channel.saved.logged..]
                    .iter()
                    .for_each(|message| channel.taken.add(*message));
                channel.taken.logged = channel.log.len();
            }
            channel.hand_over();
            channel.recall = Some(Recall::after(
                &channel.handed_over,
                channel.taken.last.as_ref(),
            ));
        }
    }

    /// Reads of one channel; whether that was all of it.
    fn drain(&mut self, number: usize, has_read: bool, run: &Observed) -> bool {
        let (room, channel) = (&mut self.room, &mut self.channels[number]);
        match channel.recall.take() {
            Some(mut recall) if !has_read => {
                channel.hand_over();
                while let Some(message) = recall.take(&channel.handed_over) {
                    channel.take(message, room);
                }
                channel.recall = Some(recall);
                return false;
            }
            Some(recall) => channel.recall = channel.catch_up(recall, room),
            None => {}
        }
        if channel.recall.is_none() {
            let death = run.before_death[channel.writer];
            while let Some(message) = channel.receive(death) {
                channel.take(message, room);
            }
        }
        true
    }

    /// One step of a recorder that works.
    pub(super) fn step(&mut self, run: &Observed) -> Step {
        match self.at {
            At::Resting => {
                let [made, closed] = run.ticks;
                let is_awaited = |channel: &Channel| !channel.buffer.is_empty();
                if made <= closed && !run.wants_round && !self.channels.iter().any(is_awaited) {
                    return Step::Idle;
                }
                self.is_last = run.is_over;
                self.at = At::Draining {
                    ticks: made,
                    channel: 0,
                    has_read: false,
                };
            }
            At::Draining {
                ticks,
                channel: number,
                has_read,
            } => {
                let is_through = self.drain(number, has_read, run);
                let next = number + usize::from(is_through);
                self.at = if next < self.channels.len() {
                    At::Draining {
                        ticks,
                        channel: next,
                        has_read: !is_through,
                    }
                } else {
                    At::Ending { ticks }
                };
            }
            At::Ending { ticks } => {
                let is_over = |channel: &Channel| channel.taken.is_log_over;
                let are_kept = !self.channels.iter().any(is_over);
                let most = most_ticks_unsaved(are_kept, LAG, BLOCK as u64, USUAL);
                if run.is_falling || ticks >= self.saved_ticks + most {
                    self.save(ticks);
                }
                self.at = At::Resting;
                return Step::Closed(ticks, self.is_last);
            }
        }
        Step::Done
    }

    fn save(&mut self, ticks: u64) {
        self.saved_ticks = ticks;
        for channel in &mut self.channels {
            channel.write_block(&mut self.room);
            channel.saved = channel.taken;
        }
    }

    /// The first topic of which the recorder has not taken in all that was sent, in its order, or whose log is not the beginning of that.
    pub(super) fn lack(&mut self) -> Option<String> {
        self.channels
            .iter_mut()
            .for_each(|channel| channel.write_block(&mut self.room));
        let is_whole = |channel: &Channel| {
            let Channel {
                sent, taken, log, ..
            } = channel;
            let mut logged = Taken::default();
            log.iter().for_each(|message| logged.add(*message));
            let is_log_right = if taken.is_log_over {
                logged.count <= sent.count
            } else {
                logged.digest == sent.digest
            };
            (sent.count, sent.digest) == (taken.count, taken.digest) && is_log_right
        };
        let lacking = self.channels.iter().position(|channel| !is_whole(channel));
        lacking
            .map(|topic| format!("the recorder has not all of topic {topic}, or its log has not"))
    }
}
