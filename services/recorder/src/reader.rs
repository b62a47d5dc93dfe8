//! Reads the record of a run: its messages in the order of the file, and every place that is not as it was written.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom};
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use bytemuck::try_pod_read_unaligned;
use mcap::records::{Channel, MessageHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError, parse_record};
use shared_types::Message;
use shared_types::event::Event;

use crate::contents::{Contents, tick_of};
use crate::cut::Cut;
use crate::error::RecordError;
use crate::event::{CDR, read_event};

/// Bytes of an opcode and a length.
const PREFIX: usize = 9;
/// Bytes of the records that end a file.
const DATA_END: u64 = PREFIX as u64 + 4;
const FOOTER: u64 = PREFIX as u64 + 20;
/// The records of MCAP.
const RECORDS: std::ops::RangeInclusive<u8> = op::HEADER..=op::DATA_END;
/// Bytes of a chunk record up to the name of its compression, and between that name and the messages.
const CHUNK_HEAD: usize = PREFIX + 3 * 8 + 4;
/// More bytes than a chunk has: messages have 4 MiB at most.
const MOST_BYTES: u64 = 64 << 20;
/// The end of a file in which the last messages of its topics are looked for; bytes.
const TAIL: u64 = 8 << 20;

/// The count of a channel that is read from the middle of a file.
const FROM_ANYWHERE: u32 = u32::MAX / 2;

/// A part of a record.
#[derive(Debug)]
pub enum Item<'a> {
    /// A message as it was sent, with the channel of its topic.
    Message {
        /// The channel.
        channel: usize,
        /// The message.
        message: &'a [u8],
    },
    /// Words on the run.
    Event(Event),
    /// The states of all processes.
    Cut(Cut),
}

/// Reads a record. A torn end is the end; a damaged chunk is noted and passed over. After the end, of a run that goes on, more may come.
pub struct RecordReader {
    path: PathBuf,
    contents: Contents,
    file: File,
    at: u64,
    chunk: Chunk,
    /// The messages read of each channel, and the tick of the last one.
    counts: Vec<u32>,
    ticks: Vec<u64>,
    /// Ticks of which it may lack messages, in order.
    damage: Vec<RangeInclusive<u64>>,
    /// Messages that are missing before one that was read.
    pub(crate) missing: u64,
    /// Whether its writer has ended it: it lacks nothing of what that was given.
    pub(crate) is_ended: bool,
    /// Messages of this tick or later are passed over, but for a cut at it.
    limit: u64,
}

/// The messages of a chunk, from the next one on.
#[derive(Default)]
struct Chunk {
    bytes: Vec<u8>,
    messages: VecDeque<Stored>,
}

/// A message of a chunk.
struct Stored {
    channel: usize,
    number: u32,
    time_ns: u64,
    bytes: Range<usize>,
}

impl RecordReader {
    /// The record of a run.
    ///
    /// # Errors
    /// When there is none, when it is of another run, or its messages are not this program's.
    pub fn open(path: &Path, contents: &Contents) -> Result<Self, RecordError> {
        Self::open_before(path, contents, u64::MAX)
    }

    /// The same before a tick: its messages and events, and the cuts up to that at the tick.
    ///
    /// # Errors
    /// See [`open`](Self::open).
    pub fn open_before(path: &Path, contents: &Contents, tick: u64) -> Result<Self, RecordError> {
        let mut reader = Self::on(path, contents)?;
        reader.limit = tick;
        let magic = reader.read(0, MAGIC.len() as u64)?;
        reader.at = MAGIC.len() as u64;
        if !MAGIC.starts_with(&magic) {
            reader.note_here();
            reader.at = reader.find_chunk(0)?.ok_or_else(|| {
                RecordError::damaged(path, &"its first bytes are not those of such a file")
            })?;
        }
        // The first chunk says whose it is.
        if !reader.take_chunk(true)? && !reader.is_ended {
            return Err(RecordError::Unbegun {
                path: path.to_owned(),
            });
        }
        Ok(reader)
    }

    fn on(path: &Path, contents: &Contents) -> Result<Self, RecordError> {
        let file = files::open(path).map_err(|error| match error.kind() {
            ErrorKind::InvalidInput | ErrorKind::IsADirectory => RecordError::damaged(path, &error),
            _ => RecordError::file("read", path)(error),
        })?;
        let topics = contents.layouts().len();
        Ok(Self {
            path: path.to_owned(),
            contents: contents.clone(),
            file,
            at: 0,
            chunk: Chunk::default(),
            counts: vec![0; topics],
            ticks: vec![0; topics],
            damage: Vec::new(),
            missing: 0,
            is_ended: false,
            limit: u64::MAX,
        })
    }

    /// A reader of a file from the first chunk among its last bytes on; `None` where there is no chunk.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn at_end(
        path: &Path,
        contents: &Contents,
        bytes: u64,
    ) -> Result<Option<Self>, RecordError> {
        let mut reader = Self::on(path, contents)?;
        let from = reader.length()?.saturating_sub(bytes);
        let Some(at) = reader.find_chunk(from)? else {
            return Ok(None);
        };
        reader.at = at;
        // It may stand in the middle of a topic.
        reader.counts.fill(FROM_ANYWHERE);
        Ok(Some(reader))
    }

    /// The ticks of the last messages of a record, by channel, as far as its end has them.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(crate) fn last_ticks(
        path: &Path,
        contents: &Contents,
    ) -> Result<Vec<Option<u64>>, RecordError> {
        let mut last = vec![None; contents.layouts().len()];
        let mut end = Self::at_end(path, contents, TAIL)?;
        while let Some(item) = end.as_mut().and_then(Self::next_item) {
            if let Item::Message { channel, message } = item {
                last[channel] = Some(tick_of(message));
            }
        }
        Ok(last)
    }

    /// The next part; `None` at the end.
    pub fn next_item(&mut self) -> Option<Item<'_>> {
        let Stored {
            channel,
            time_ns,
            bytes,
            ..
        } = self.next_stored()?;
        let tick = self.contents.tick_at(time_ns);
        let bytes = &self.chunk.bytes[bytes];
        Some(match channel {
            channel if channel < self.counts.len() => Item::Message {
                channel,
                message: bytes,
            },
            channel if channel == self.contents.extra()[2] => {
                Item::Cut(Cut::read(tick, bytes).unwrap_or_default())
            }
            _ => Item::Event(read_event(tick, bytes).unwrap_or_default()),
        })
    }

    /// The next message of a channel; `None` at the end.
    pub fn next_of(&mut self, wanted: usize) -> Option<&[u8]> {
        loop {
            let stored = self.next_stored()?;
            if stored.channel == wanted {
                return self.chunk.bytes.get(stored.bytes);
            }
        }
    }

    /// The next message, or whatever else there is, among the bytes of the chunk.
    fn next_stored(&mut self) -> Option<Stored> {
        loop {
            if let Some(stored) = self.chunk.messages.pop_front() {
                return Some(stored);
            }
            let taken = self.take_chunk(false).unwrap_or_else(|error| {
                runtime::complain(&error);
                self.note_here();
                false
            });
            if !taken {
                return None;
            }
        }
    }

    /// Its messages of a type, in order; none of a topic that the run does not have.
    pub fn messages<M: Message>(mut self) -> impl Iterator<Item = M> {
        let channel = self.contents.channel(M::TOPIC).unwrap_or(usize::MAX);
        std::iter::from_fn(move || try_pod_read_unaligned(self.next_of(channel)?).ok())
    }

    /// The ticks of which messages may be missing, as far as it has been read: chunks are damaged, missing, or there again.
    pub fn damage(&self) -> &[RangeInclusive<u64>] {
        &self.damage
    }

    /// Whether the file has the summary by which other programs find messages in it.
    pub(crate) fn has_summary(&self) -> bool {
        let end = MAGIC.len() as u64;
        let length = self.length().unwrap_or_default();
        let last = self.read(length.saturating_sub(end).max(end), end);
        last.is_ok_and(|bytes| bytes == MAGIC)
    }

    fn length(&self) -> Result<u64, RecordError> {
        let length = self.file.metadata().map(|file| file.len());
        length.map_err(RecordError::file("read", &self.path))
    }

    /// The bytes at a place, as far as the file goes.
    fn read(&self, at: u64, length: u64) -> Result<Vec<u8>, RecordError> {
        let mut file = &self.file;
        let mut bytes = Vec::with_capacity(length as usize);
        let found = file.seek(SeekFrom::Start(at));
        let read = found.and_then(|_| file.take(length).read_to_end(&mut bytes));
        read.map_err(RecordError::file("read", &self.path))?;
        Ok(bytes)
    }

    /// The opcode and the whole length of the record at a place; `None` if there is no such record.
    fn record_at(&self, at: u64) -> Result<Option<(u8, u64)>, RecordError> {
        let head = self.read(at, PREFIX as u64)?;
        let Some((op, length)) = head.split_first() else {
            return Ok(None);
        };
        let length = length.try_into().map_or(u64::MAX, u64::from_le_bytes);
        let left = self.length()?.saturating_sub(at);
        let is_whole = length < MOST_BYTES && PREFIX as u64 + length <= left;
        Ok(is_whole.then_some((*op, PREFIX as u64 + length)))
    }

    /// Takes in the next chunk; `false` at the end. One that is refused is noted and passed over, but for the first of all, which says whose it is.
    fn take_chunk(&mut self, is_first: bool) -> Result<bool, RecordError> {
        // From the end of the last chunk: a wrong length leads away from the next one.
        let behind = self.at;
        loop {
            match self.record_at(self.at)? {
                Some((op::DATA_END, DATA_END) | (op::FOOTER, FOOTER)) => {
                    self.is_ended = true;
                    return Ok(false);
                }
                Some((op::CHUNK, length)) => {
                    let record = self.read(self.at, length)?;
                    match self.decode(&record) {
                        Ok(chunk) => {
                            self.at += length;
                            self.admit(chunk);
                            return Ok(true);
                        }
                        Err(RecordError::Damaged { .. }) => self.note(self.ticks_of(&record)),
                        Err(foreign) if is_first => return Err(foreign),
                        Err(_) => self.note_here(),
                    }
                    // Its length may be wrong, too.
                    self.at = self.find_chunk(self.at + 1)?.unwrap_or(self.at + length);
                }
                Some((op, length)) if RECORDS.contains(&op) => self.at += length,
                _ => match self.find_chunk(behind + 1)? {
                    Some(chunk) => {
                        self.note_here();
                        self.at = chunk;
                    }
                    None => return Ok(false),
                },
            }
        }
    }

    /// The first chunk from a place on that is as it was written.
    fn find_chunk(&self, from: u64) -> Result<Option<u64>, RecordError> {
        const WINDOW: u64 = 1 << 16;
        let mut begin = from;
        let end = self.length()?;
        while begin < end {
            let window = self.read(begin, WINDOW + CHUNK_HEAD as u64 + 4)?;
            for (at, head) in (begin..begin + WINDOW).zip(window.windows(CHUNK_HEAD + 4)) {
                // Its compression is none, or has a short name.
                let is_likely = head[0] == op::CHUNK && head[CHUNK_HEAD + 1..] == [0; 3];
                if is_likely
                    && let Some((_, length)) = self.record_at(at)?
                    && self.decode(&self.read(at, length)?).is_ok()
                {
                    return Ok(Some(at));
                }
            }
            begin += WINDOW;
        }
        Ok(None)
    }

    /// The messages of a chunk's record, if its checksum is right and all of them are the run's.
    fn decode(&self, record: &[u8]) -> Result<Chunk, RecordError> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MOST_BYTES as usize);
        let damaged = |reason: McapError| RecordError::damaged(&self.path, &reason);
        // Without a checksum, which every writer of ours sets, zeros would be an empty chunk.
        let sum = record.get(CHUNK_HEAD - 4..CHUNK_HEAD);
        if sum.is_none_or(|sum| sum == [0; 4]) {
            return Err(RecordError::damaged(&self.path, &"a chunk has no checksum"));
        }
        let mut reader = LinearReader::new_with_options(options);
        let mut chunk = Chunk::default();
        reader.insert(record.len()).copy_from_slice(record);
        reader.notify_read(record.len());
        while let Some(event) = reader.next_event() {
            match event.map_err(damaged)? {
                LinearReadEvent::ReadRequest(_) => reader.notify_read(0),
                LinearReadEvent::Record { opcode, data } => {
                    match parse_record(opcode, data).map_err(damaged)? {
                        Record::Message { header, data } => self.add(&mut chunk, &header, &data)?,
                        Record::Channel(channel) => self.check(&channel)?,
                        _ => {}
                    }
                }
            }
        }
        Ok(chunk)
    }

    fn add(
        &self,
        chunk: &mut Chunk,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<(), RecordError> {
        let layouts = self.contents.layouts();
        let begin = chunk.bytes.len();
        let [events, _, cuts] = self.contents.extra();
        let channel = usize::from(header.channel_id).wrapping_sub(1);
        let message = match layouts.get(channel) {
            Some(layout) => data
                .strip_prefix(&CDR)
                .filter(|message| message.len() == layout.bytes)
                .ok_or_else(|| RecordError::damaged(&self.path, &"a message is too short"))?,
            None if [events, cuts].contains(&channel) => data,
            None => return Ok(()),
        };
        chunk.bytes.extend_from_slice(message);
        chunk.messages.push_back(Stored {
            channel,
            number: header.sequence,
            time_ns: header.log_time,
            bytes: begin..chunk.bytes.len(),
        });
        Ok(())
    }

    /// Whether a channel is one of the run.
    fn check(&self, channel: &Channel) -> Result<(), RecordError> {
        let path = self.path.clone();
        if channel.metadata.get("run") != Some(&self.contents.run()) {
            return Err(RecordError::OtherRun { path });
        }
        let place = usize::from(channel.id).wrapping_sub(1);
        let is_like = self.contents.layouts().get(place).is_none_or(|layout| {
            channel.topic.strip_prefix('/') == Some(&layout.topic)
                && channel.metadata.get("layout") == Some(&format!("{:016x}", layout.hash))
        });
        is_like
            .then_some(())
            .ok_or(RecordError::WireFormat { path })
    }

    /// Takes in the messages of a chunk but for those that have come before, and notes that some are missing before it.
    fn admit(&mut self, mut chunk: Chunk) {
        let mut flaws = Vec::new();
        chunk.messages.retain(|message| {
            let Some(count) = self.counts.get_mut(message.channel) else {
                let is_cut = message.channel == self.contents.extra()[2];
                let tick = self.contents.tick_at(message.time_ns);
                return tick < self.limit || is_cut && tick == self.limit;
            };
            let tick = tick_of(&chunk.bytes[message.bytes.clone()]);
            let ahead = match *count {
                FROM_ANYWHERE => 0,
                count => message.number.wrapping_sub(count) as i32,
            };
            if ahead < 0 {
                flaws.push((true, tick..=tick));
                return false;
            }
            let last = std::mem::replace(&mut self.ticks[message.channel], tick);
            if ahead > 0 {
                self.missing += ahead as u64;
                let from = last + u64::from(*count > 0);
                let is_exact = from + ahead as u64 == tick;
                flaws.push((is_exact, from..=tick.saturating_sub(1)));
            }
            *count = message.number.wrapping_add(1);
            tick < self.limit
        });
        // Of a topic without a message at each tick others say better which ticks it lacks.
        flaws.sort_by_key(|(is_exact, _)| !is_exact);
        for (is_exact, ticks) in flaws {
            if is_exact || self.damage.is_empty() {
                self.note(ticks);
            }
        }
        self.chunk = chunk;
    }

    /// The tick behind those of which all has been read.
    fn next_tick(&self) -> u64 {
        let next = self.ticks.iter().zip(&self.counts);
        let next = next.map(|(tick, count)| tick + u64::from(*count > 0)).max();
        next.unwrap_or_default()
    }

    /// The ticks that the head of a damaged chunk names: the checksum does not cover it.
    fn ticks_of(&self, chunk: &[u8]) -> RangeInclusive<u64> {
        let next = self.next_tick();
        let tick = |at: usize| {
            let time_ns = chunk.get(at..).and_then(|bytes| bytes.first_chunk());
            time_ns.map_or(next, |bytes| {
                self.contents.tick_at(u64::from_le_bytes(*bytes))
            })
        };
        tick(PREFIX).min(next)..=tick(PREFIX + 8)
    }

    fn note_here(&mut self) {
        let next = self.next_tick();
        self.note(next..=next);
    }

    /// Notes that messages of these ticks may be missing; joins ranges that meet, because a chunk has other ticks of each topic.
    fn note(&mut self, ticks: RangeInclusive<u64>) {
        let (mut from, mut to) = (*ticks.start(), *ticks.start().max(ticks.end()));
        if from >= self.limit {
            return;
        }
        self.damage.retain(|one| {
            let is_apart =
                one.end().saturating_add(1) < from || to.saturating_add(1) < *one.start();
            if !is_apart {
                (from, to) = (from.min(*one.start()), to.max(*one.end()));
            }
            is_apart
        });
        let place = self.damage.partition_point(|one| *one.start() < from);
        self.damage.insert(place, from..=to);
    }
}
