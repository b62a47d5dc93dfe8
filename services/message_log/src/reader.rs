//! Reads a message log: its blocks in their original order, and every damaged place.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use shared_types::Message;

use crate::block::{Block, Blocks, Chunk, Found};
use crate::contents::Contents;
use crate::error::{Defect, LogError};
use crate::record::{DATA_END, MAGIC};
use crate::writer::{Place, tail};

/// Chunks that stay in memory: readers of several topics go on together.
const CACHED: usize = 8;

/// A place of a log that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flaw {
    /// The kind.
    pub defect: Defect,
    /// Number of the following block; at the end, the number of all blocks.
    pub block: usize,
    /// Messages that are lost there, by channel, as far as the blocks around it tell.
    pub lost: Vec<u64>,
    /// The tick of the first message of the block, where none is lost.
    pub tick: Option<u64>,
}

/// The message log of a run.
///
/// The heads of all blocks are read first. Blocks that are not in their place are read in it, those that are there twice once, those of other runs
/// not at all.
#[derive(Clone)]
pub struct Log(Rc<Inner>);

struct Inner {
    path: PathBuf,
    contents: Contents,
    file: Blocks,
    scan: Scan,
    has_tail: bool,
    cache: RefCell<VecDeque<(usize, Rc<Chunk>)>>,
}

impl Log {
    /// The log of a run.
    ///
    /// # Errors
    /// When there is none, when it is of another run, or its messages are not this program's.
    pub fn open(path: &Path, contents: &Contents) -> Result<Self, LogError> {
        Self::open_behind(path, contents, &Place::default())
    }

    /// The same from a place behind a block on.
    pub(crate) fn open_behind(
        path: &Path,
        contents: &Contents,
        from: &Place,
    ) -> Result<Self, LogError> {
        let cannot = LogError::file("read", path);
        let file = match files::open(path).and_then(Blocks::new) {
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::InvalidInput | ErrorKind::IsADirectory
                ) =>
            {
                return Err(LogError::damaged(path, &error));
            }
            opened => opened.map_err(&cannot)?,
        };
        let expected = contents.head();
        let head = file.read(0, expected.len() as u64).map_err(&cannot)?;
        if head.len() < expected.len() && expected.starts_with(&head) {
            return Err(LogError::Unbegun {
                path: path.to_owned(),
            });
        }
        if from.bytes > file.length {
            return Err(LogError::damaged(path, &"its end is missing"));
        }
        // A head of another length is passed over.
        let head_bytes = if head == expected {
            head.len()
        } else {
            MAGIC.len()
        };
        let begin = Place {
            bytes: from.bytes.max(head_bytes as u64),
            messages: from.messages.clone(),
        };
        let mut scan = Scan::new(&file, contents, &begin).map_err(&cannot)?;
        scan.check_is_own(path, contents, head == expected)?;
        let has_tail = from.bytes == 0 && scan.check_tail(&file, contents).map_err(&cannot)?;
        Ok(Self(Rc::new(Inner {
            path: path.to_owned(),
            contents: contents.clone(),
            file,
            scan,
            has_tail,
            cache: RefCell::default(),
        })))
    }

    /// Its contents.
    pub fn contents(&self) -> &Contents {
        &self.0.contents
    }

    /// How many blocks of messages it has.
    pub fn blocks(&self) -> usize {
        self.0.scan.blocks.len()
    }

    /// Ticks that had begun when the recorder had last taken in everything, before it wrote a block.
    pub fn begun(&self, block: usize) -> u64 {
        self.0.scan.blocks.get(block).map_or(0, |block| block.begun)
    }

    /// The places that are not as they were written, in order.
    pub fn flaws(&self) -> &[Flaw] {
        &self.0.scan.flaws
    }

    /// Whether its writer has ended it: it lacks nothing of what that was given.
    pub fn is_ended(&self) -> bool {
        self.0.scan.is_ended
    }

    /// Whether it has the summary by which other programs find messages in it.
    pub(crate) fn has_tail(&self) -> bool {
        self.0.has_tail
    }

    /// The place behind its last block.
    pub(crate) fn end(&self) -> Place {
        let Scan { end, messages, .. } = &self.0.scan;
        Place {
            bytes: *end,
            messages: messages.clone(),
        }
    }

    /// The messages of a block.
    ///
    /// # Errors
    /// If it cannot be read, or has changed.
    pub fn chunk(&self, number: usize) -> Result<Rc<Chunk>, LogError> {
        let Inner {
            path,
            contents,
            file,
            scan,
            cache,
            ..
        } = &*self.0;
        let mut cache = cache.borrow_mut();
        if let Some((_, chunk)) = cache.iter().find(|(at, _)| *at == number) {
            return Ok(Rc::clone(chunk));
        }
        let block = &scan.blocks[number];
        let bytes = file.bytes(block).map_err(LogError::file("read", path))?;
        let chunk = bytes
            .and_then(|bytes| Chunk::of(block, &bytes, contents))
            .map(Rc::new)
            .ok_or_else(|| {
                let reason = format!("the block at byte {} is not what was written", block.at);
                LogError::damaged(path, &reason)
            })?;
        if cache.len() == CACHED {
            cache.pop_front();
        }
        cache.push_back((number, Rc::clone(&chunk)));
        Ok(chunk)
    }

    /// The messages of a type, in order.
    pub fn messages<M: Message>(&self) -> Messages<M> {
        Messages {
            rows: self.rows(M::TOPIC),
            of: PhantomData,
        }
    }

    /// The messages of a topic as bytes, in order; none of a topic that the run does not have.
    pub fn rows(&self, topic: &str) -> Rows {
        Rows {
            log: self.clone(),
            topic: topic.to_owned(),
            channel: self.0.contents.channel(topic).unwrap_or(usize::MAX),
            block: 0,
            number: 0,
            flaw: 0,
            chunk: None,
        }
    }
}

/// Reads the messages of a topic as bytes.
pub struct Rows {
    log: Log,
    topic: String,
    channel: usize,
    block: usize,
    number: usize,
    flaw: usize,
    chunk: Option<Rc<Chunk>>,
}

impl Rows {
    /// The next message; `None` at the end.
    ///
    /// # Errors
    /// If the file cannot be read, or messages are lost. The next call continues after that place.
    pub fn next_row(&mut self) -> Result<Option<&[u8]>, LogError> {
        let Inner { path, scan, .. } = &*self.log.0;
        loop {
            while let Some(flaw) = scan.flaws.get(self.flaw)
                && flaw.block <= self.block
            {
                self.flaw += 1;
                let lost = flaw.lost.get(self.channel).copied().unwrap_or(0);
                if lost > 0 {
                    return Err(LogError::Lost {
                        path: path.clone(),
                        topic: self.topic.clone(),
                        defect: flaw.defect,
                        lost,
                    });
                }
            }
            let Some(block) = scan.blocks.get(self.block) else {
                return Ok(None);
            };
            let messages = block.messages.get(self.channel).copied().unwrap_or(0);
            if (self.number as u64) < messages {
                break;
            }
            (self.block, self.number, self.chunk) = (self.block + 1, 0, None);
        }
        if self.chunk.is_none() {
            // One that cannot be read is passed over by the next call.
            self.block += 1;
            self.chunk = Some(self.log.chunk(self.block - 1)?);
            self.block -= 1;
        }
        self.number += 1;
        let chunk = self.chunk.as_ref();
        Ok(chunk.and_then(|chunk| chunk.message(self.channel, self.number - 1)))
    }
}

/// Reads the messages of a type.
pub struct Messages<M> {
    rows: Rows,
    of: PhantomData<M>,
}

impl<M: Message> Messages<M> {
    /// See [`Rows::next_row`].
    ///
    /// # Errors
    /// See there.
    pub fn next_message(&mut self) -> Result<Option<M>, LogError> {
        let row = self.rows.next_row()?;
        Ok(row.and_then(|row| bytemuck::try_pod_read_unaligned(row).ok()))
    }
}

/// The blocks of a file.
#[derive(Default)]
struct Scan {
    /// In the order in which they were written.
    blocks: Vec<Block>,
    flaws: Vec<Flaw>,
    /// End of the blocks in the file, and the messages up to there, by channel.
    end: u64,
    messages: Vec<u64>,
    is_ended: bool,
    /// Format and run of a block that is not the run's.
    other: Option<[u64; 2]>,
}

/// A block, and what lies before it in the file.
struct Placed(Block, Vec<Defect>);

impl Scan {
    fn new(file: &Blocks, contents: &Contents, from: &Place) -> io::Result<Self> {
        let (mut found, mut before, mut at) = (Vec::new(), Vec::new(), from.bytes);
        let mut scan = Self::default();
        let end_of_file = loop {
            let here = file.at(at)?;
            if let Found::Whole(block) = &here
                && file.bytes(block)?.is_some()
            {
                at += block.bytes;
                if block.identity == contents.identity()
                    && block.before.len() == contents.layouts().len()
                {
                    found.push(Placed(block.clone(), std::mem::take(&mut before)));
                } else {
                    scan.other = Some(block.identity);
                    before.push(Defect::OtherRun);
                }
                continue;
            }
            match file.next(at + 1)? {
                Some(next) => (at, _) = (next.at, before.push(Defect::Damaged)),
                None => break here,
            }
        };
        scan.end = at;
        let is_end = file.read(at, 1)?.first() == Some(&DATA_END);
        let is_complete = file.read(file.length.saturating_sub(8), 8)? == MAGIC;
        let is_torn = matches!(end_of_file, Found::Torn) && !is_complete;
        if !is_torn && !is_end {
            before.push(Defect::Damaged);
        }
        scan.messages = vec![0; contents.layouts().len()];
        scan.messages
            .iter_mut()
            .zip(&from.messages)
            .for_each(|(messages, from)| *messages = *from);
        scan.order(found, before, contents);
        Ok(scan)
    }

    /// Puts the blocks into the order in which they were written, with what is wrong before each, and the messages that are missing there; `tail`: what
    /// lies behind all of them.
    fn order(&mut self, mut found: Vec<Placed>, tail: Vec<Defect>, contents: &Contents) {
        let sum = |messages: &[u64]| messages.iter().fold(0_u64, |sum, n| sum.saturating_add(*n));
        found.sort_by_key(|Placed(block, _)| sum(&block.before));
        let (mut furthest, mut pending) = (0, Vec::new());
        for Placed(block, before) in found {
            pending.extend(before);
            let tick = Some(contents.tick_at(block.times[0]));
            if sum(&block.before) < sum(&self.messages) {
                let number = self.blocks.len();
                self.flaws
                    .push(self.harmless(Defect::Repeated, number, tick));
                continue;
            }
            let is_displaced = block.at < furthest;
            furthest = furthest.max(block.at);
            self.lose(&block.before, &mut pending, is_displaced);
            if is_displaced {
                let number = self.blocks.len();
                self.flaws
                    .push(self.harmless(Defect::Displaced, number, tick));
            }
            self.messages = block.after();
            self.is_ended = block.is_end();
            if !self.is_ended {
                self.blocks.push(block);
            }
        }
        pending.extend(tail);
        self.lose(&self.messages.clone(), &mut pending, false);
    }

    /// Notes the damage before a block, and the messages missing there. A damaged or foreign block
    /// lies where they were, unless the block has come from elsewhere.
    fn lose(&mut self, before: &[u64], pending: &mut Vec<Defect>, is_displaced: bool) {
        let behind = self.messages.iter().zip(before);
        let lost: Vec<u64> = behind.map(|(had, has)| has.saturating_sub(*had)).collect();
        let (number, has_loss) = (self.blocks.len(), lost.iter().any(|lost| *lost > 0));
        let cause = if has_loss && !is_displaced && !pending.is_empty() {
            Some(pending.remove(0))
        } else {
            has_loss.then_some(Defect::Missing)
        };
        if let Some(defect) = cause {
            self.flaws.push(Flaw {
                lost,
                tick: None,
                ..self.harmless(defect, number, None)
            });
        }
        for defect in pending.drain(..) {
            self.flaws.push(self.harmless(defect, number, None));
        }
    }

    fn harmless(&self, defect: Defect, block: usize, tick: Option<u64>) -> Flaw {
        Flaw {
            defect,
            block,
            lost: vec![0; self.messages.len()],
            tick,
        }
    }

    /// Refuses a file in which nothing is of the run.
    fn check_is_own(
        &self,
        path: &Path,
        contents: &Contents,
        has_head: bool,
    ) -> Result<(), LogError> {
        let ([ours, our_run], path) = (contents.identity(), path.to_owned());
        match self.other {
            _ if !self.blocks.is_empty() => Ok(()),
            Some([found, run]) if run == our_run => Err(LogError::WireFormat { path, found, ours }),
            Some(_) => Err(LogError::OtherRun { path }),
            None if has_head || self.is_ended => Ok(()),
            None => Err(LogError::damaged(
                &path,
                &"its first bytes are not those of such a file",
            )),
        }
    }

    /// Checks whether the part after the blocks of an otherwise undamaged file is correct.
    fn check_tail(&mut self, file: &Blocks, contents: &Contents) -> io::Result<bool> {
        if !self.flaws.is_empty() {
            return Ok(false);
        }
        let (expected, found) = (
            tail(contents, self.end, &self.blocks),
            file.read(self.end, file.length)?,
        );
        if found.first() == Some(&DATA_END) && !expected.starts_with(&found) {
            let number = self.blocks.len();
            self.flaws
                .push(self.harmless(Defect::Damaged, number, None));
        }
        Ok(expected == found)
    }
}
