//! The heads of a message log and of its blocks: which run, which log of it, and which of its messages.
//!
//! ```text
//! file   "armkept\x06" · layout hash u64 · bytes of a message u32 · place of the log u16 · logs u16 · run u64 · CRC-32 u32 of all these · 0 u32
//! block  messages u32 · bytes behind the head u32 · CRC-32 u32 of these · low half of the layout hash u32 · run u64 · place of the log u16 · logs u16
//!        · messages in the log before it u64 · tick of its first message u64 · CRC-32 u32 of the rest of the head
//!        · messages in each log of the run when it was written u64 …
//! ```
//!
//! All integers little-endian. A block without a message is the end of a log whose writer was not killed.

use crate::block::BLOCK;
use crate::error::LogError;
use crate::logs::Logs;
use crate::shape::Shape;

pub(crate) const MAGIC: [u8; 8] = *b"armkept\x06";
/// Bytes of a file before its first block.
pub(crate) const FILE_HEAD: usize = 40;
/// Those of them that its checksum covers.
const FILE_CHECKED: usize = 32;
/// Bytes of a block's head before the numbers of all logs, which its checksum ends.
const FIXED: usize = 48;
const CHECKED: usize = FIXED - 4;
/// More logs than a run has topics.
const MOST_LOGS: usize = 1024;

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    bytes
        .get(at..at + 2)
        .and_then(|part| part.try_into().ok())
        .map_or(0, u16::from_le_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes
        .get(at..at + 4)
        .and_then(|part| part.try_into().ok())
        .map_or(0, u32::from_le_bytes)
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytes
        .get(at..at + 8)
        .and_then(|part| part.try_into().ok())
        .map_or(0, u64::from_le_bytes)
}

/// A log's own numbers, which the head of the file states and the head of each block repeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) run: u64,
    /// Its place among the logs of the run, and how many they are.
    pub(crate) log: u16,
    pub(crate) logs: u16,
    pub(crate) layout: u64,
}

impl Identity {
    /// Of the log of a topic; `None` where the run has no such log.
    pub(crate) fn of(logs: &Logs, shape: &Shape) -> Option<Self> {
        let (log, all) = (
            u16::try_from(logs.place(&shape.topic)?).ok()?,
            u16::try_from(logs.len()).ok()?,
        );
        (usize::from(all) <= MOST_LOGS).then_some(Self {
            run: logs.run(),
            log,
            logs: all,
            layout: shape.hash,
        })
    }

    /// The head of its file.
    pub(crate) fn file_head(self, message_bytes: usize) -> [u8; FILE_HEAD] {
        let mut head = [0; FILE_HEAD];
        head[..8].copy_from_slice(&MAGIC);
        head[8..16].copy_from_slice(&self.layout.to_le_bytes());
        head[16..20].copy_from_slice(&(message_bytes as u32).to_le_bytes());
        head[20..22].copy_from_slice(&self.log.to_le_bytes());
        head[22..24].copy_from_slice(&self.logs.to_le_bytes());
        head[24..FILE_CHECKED].copy_from_slice(&self.run.to_le_bytes());
        seal_file(&mut head);
        head
    }

    /// Of the head of a file, and the bytes of its messages; `None` where it is not as it was written.
    pub(crate) fn of_file(head: &[u8; FILE_HEAD]) -> Option<(Self, usize)> {
        let is_whole = u32_at(head, FILE_CHECKED) == crc32fast::hash(&head[..FILE_CHECKED])
            && head[FILE_CHECKED + 4..] == [0; 4];
        let identity = Self {
            run: u64_at(head, 24),
            log: u16_at(head, 20),
            logs: u16_at(head, 22),
            layout: u64_at(head, 8),
        };
        is_whole.then_some((identity, u32_at(head, 16) as usize))
    }

    /// Bytes of the head of a block of its logs.
    pub(crate) fn block_head(self) -> usize {
        FIXED + size_of::<u64>() * usize::from(self.logs)
    }
}

/// Gives the head of a file its checksum.
pub(crate) fn seal_file(head: &mut [u8; FILE_HEAD]) {
    let sum = crc32fast::hash(&head[..FILE_CHECKED]);
    head[FILE_CHECKED..FILE_CHECKED + 4].copy_from_slice(&sum.to_le_bytes());
}

/// The numbers at the beginning of a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct BlockHead {
    pub(crate) messages: usize,
    /// Bytes behind the head.
    pub(crate) packed: usize,
    /// CRC-32 of these.
    pub(crate) body: u32,
    pub(crate) run: u64,
    pub(crate) layout: u32,
    pub(crate) log: u16,
    /// Messages in the log before it.
    pub(crate) first: u64,
    /// Tick of its first message.
    pub(crate) tick: u64,
    /// Messages in each log of the run when it was written.
    pub(crate) known: Vec<u64>,
}

impl BlockHead {
    /// The head of a block, at the beginning of bytes that may be any; `None` where it is not as it was written.
    pub(crate) fn read(bytes: &[u8], message_bytes: usize) -> Option<Self> {
        let fixed = bytes.get(..FIXED)?;
        let logs = usize::from(u16_at(fixed, 26));
        let (messages, packed) = (u32_at(fixed, 0) as usize, u32_at(fixed, 4) as usize);
        if messages > BLOCK || logs > MOST_LOGS {
            return None;
        }
        let known = bytes.get(FIXED..FIXED + size_of::<u64>() * logs)?;
        if checksum(fixed, known) != u32_at(fixed, CHECKED)
            || !crate::block::is_possible(messages, packed, message_bytes)
        {
            return None;
        }
        Some(Self {
            messages,
            packed,
            body: u32_at(fixed, 8),
            layout: u32_at(fixed, 12),
            run: u64_at(fixed, 16),
            log: u16_at(fixed, 24),
            first: u64_at(fixed, 28),
            tick: u64_at(fixed, 36),
            known: known
                .as_chunks::<8>()
                .0
                .iter()
                .map(|number| u64::from_le_bytes(*number))
                .collect(),
        })
    }

    /// Writes it over the beginning of a block of so many messages.
    pub(crate) fn write(
        identity: Identity,
        messages: usize,
        (first, tick): (u64, u64),
        logs: &Logs,
        block: &mut [u8],
    ) {
        let Some((head, body)) = block.split_at_mut_checked(identity.block_head()) else {
            return;
        };
        let Some((fixed, known)) = head.split_first_chunk_mut::<FIXED>() else {
            return;
        };
        let numbers = [
            messages as u32,
            body.len() as u32,
            crc32fast::hash(body),
            identity.layout as u32,
        ];
        fixed
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip(numbers)
            .for_each(|(to, number)| *to = number.to_le_bytes());
        fixed[16..24].copy_from_slice(&identity.run.to_le_bytes());
        fixed[24..26].copy_from_slice(&identity.log.to_le_bytes());
        fixed[26..28].copy_from_slice(&identity.logs.to_le_bytes());
        fixed[28..36].copy_from_slice(&first.to_le_bytes());
        fixed[36..CHECKED].copy_from_slice(&tick.to_le_bytes());
        known
            .as_chunks_mut::<8>()
            .0
            .iter_mut()
            .zip(logs.written())
            .for_each(|(to, number)| *to = number.to_le_bytes());
        let sum = checksum(fixed, known);
        fixed[CHECKED..].copy_from_slice(&sum.to_le_bytes());
    }

    /// Bytes of the head.
    pub(crate) fn bytes(&self) -> usize {
        FIXED + size_of::<u64>() * self.known.len()
    }

    /// Bytes of the whole block.
    pub(crate) fn whole(&self) -> u64 {
        (self.bytes() + self.packed) as u64
    }

    /// Whether the block is of a log.
    pub(crate) fn is_of(&self, identity: Identity) -> bool {
        self.run == identity.run && self.is_like(identity)
    }

    /// Whether the block is of a log, or of the same log of another run.
    pub(crate) fn is_like(&self, identity: Identity) -> bool {
        (self.log, self.known.len(), self.layout)
            == (
                identity.log,
                usize::from(identity.logs),
                identity.layout as u32,
            )
    }
}

/// Bytes of a block's head at most.
pub(crate) const LONGEST: usize = FIXED + size_of::<u64>() * MOST_LOGS;

/// The CRC-32 of a block's head but for the checksum itself.
fn checksum(fixed: &[u8], known: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&fixed[..CHECKED]);
    hasher.update(known);
    hasher.finalize()
}

/// Gives the file and every block of its bytes, as far as they follow each other, the checksums of what they hold, the file's identity, and the numbers of
/// messages that stand before them; for tests, which change blocks.
pub fn seal(file: &mut [u8]) {
    let Some((head, mut rest)) = file.split_first_chunk_mut::<FILE_HEAD>() else {
        return;
    };
    seal_file(head);
    let Some((identity, _)) = Identity::of_file(head) else {
        return;
    };
    let mut first = 0_u64;
    while rest.len() >= identity.block_head() {
        let (messages, packed) = (u32_at(rest, 0) as usize, u32_at(rest, 4) as usize);
        let end = packed.saturating_add(identity.block_head());
        let tick = u64_at(rest, 36);
        let Some((block, behind)) = std::mem::take(&mut rest).split_at_mut_checked(end) else {
            return;
        };
        let logs = Logs::new(identity.run, (0..identity.logs).map(|log| log.to_string()));
        logs.set_written(usize::from(identity.log), first);
        BlockHead::write(identity, messages, (first, tick), &logs, block);
        first += messages as u64;
        rest = behind;
    }
}

/// The identity of the log of a topic, as an error where the run has none.
pub(crate) fn identity(
    logs: &Logs,
    shape: &Shape,
    path: &std::path::Path,
) -> Result<Identity, LogError> {
    Identity::of(logs, shape).ok_or_else(|| LogError::Unlisted {
        path: path.to_owned(),
        topic: shape.topic.clone(),
    })
}
