//! The exchange page in memory: armplane's side of it.

use std::cell::Cell;
use std::fs::{File, OpenOptions};
use std::mem::offset_of;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use bytemuck::{Zeroable, bytes_of};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use shared_types::exchange::{
    EXCHANGE_MARK, EXCHANGE_NAME, EXCHANGE_STATE, EXCHANGE_TEXT, EXCHANGE_TYPE, EXCHANGE_VERSION,
    ExchangeHead, ExchangeTopic,
};
use shared_types::layout::MessageLayout;

/// Messages begin at multiples of it: a cache line.
const LINE: usize = 64;

/// The page's description of the process and its run.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Lockstep, or real time.
    pub is_lockstep: bool,
    /// Ticks per second; Hz.
    pub rate_hz: u32,
    /// Joints of the arm.
    pub dof: u32,
    /// How often the process has been started in this run, from 1.
    pub incarnation: u32,
}

/// An exchange page, mapped, with its messages in the order of its topics.
pub struct Page {
    start: NonNull<u8>,
    bytes: usize,
    messages: Vec<(usize, usize)>,
    state_at: usize,
    topics_at: usize,
    /// Requests so far: the page's own count is one that a program may write.
    asked: Cell<u32>,
    path: PathBuf,
}

impl Page {
    /// Makes the page of a process in the run's directory; one that a predecessor had is replaced.
    ///
    /// # Errors
    /// When the file cannot be made or mapped.
    pub fn create(
        run: &Path,
        process: &str,
        about: About,
        topics: &[(MessageLayout, u32)],
    ) -> std::io::Result<Self> {
        let topics_at = size_of::<ExchangeHead>().next_multiple_of(LINE);
        let state_at =
            (topics_at + topics.len() * size_of::<ExchangeTopic>()).next_multiple_of(LINE);
        let mut end = state_at + EXCHANGE_STATE;
        let mut entries = Vec::with_capacity(topics.len());
        for (layout, usage) in topics {
            let mut entry = ExchangeTopic {
                layout: layout.hash,
                usage: *usage,
                ..ExchangeTopic::zeroed()
            };
            (entry.at, entry.bytes) = (end as u32, layout.bytes as u32);
            put_text(&mut entry.name, &layout.topic);
            put_text(&mut entry.type_name, &layout.type_name);
            entries.push(entry);
            end = (end + layout.bytes).next_multiple_of(LINE);
        }
        let head = ExchangeHead {
            mark: EXCHANGE_MARK,
            version: EXCHANGE_VERSION,
            bytes: end as u32,
            armplane_pid: std::process::id(),
            lockstep: u32::from(about.is_lockstep),
            rate_hz: about.rate_hz,
            dof: about.dof,
            incarnation: about.incarnation,
            topics: entries.len() as u32,
            topics_at: topics_at as u32,
            state_at: state_at as u32,
            state_room: EXCHANGE_STATE as u32,
            ..ExchangeHead::zeroed()
        };
        let mut image = vec![0_u8; end];
        image[..size_of::<ExchangeHead>()].copy_from_slice(bytes_of(&head));
        for (i, entry) in entries.iter().enumerate() {
            let at = topics_at + i * size_of::<ExchangeTopic>();
            image[at..at + size_of::<ExchangeTopic>()].copy_from_slice(bytes_of(entry));
        }
        let path = run.join(format!("exchange-{process}"));
        let file = publish(&path, &image)?;
        let places = entries.iter();
        let places = places.map(|entry| (entry.at as usize, entry.bytes as usize));
        Ok(Self {
            start: map(&file, end)?,
            bytes: end,
            messages: places.collect(),
            state_at,
            topics_at,
            asked: Cell::new(0),
            path,
        })
    }

    /// Its addresses in this process.
    pub(crate) fn range(&self) -> std::ops::Range<usize> {
        let start = self.start.as_ptr() as usize;
        start..start + self.bytes
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn word(&self, offset: usize) -> &AtomicU32 {
        assert!(offset.is_multiple_of(4) && offset + 4 <= self.bytes);
        // SAFETY: inside the mapping and aligned; the word is only used as an atomic, here and in the program.
        unsafe { AtomicU32::from_ptr(self.start.as_ptr().add(offset).cast()) }
    }

    fn long(&self, offset: usize) -> &AtomicU64 {
        assert!(offset.is_multiple_of(8) && offset + 8 <= self.bytes);
        // SAFETY: as in `word`.
        unsafe { AtomicU64::from_ptr(self.start.as_ptr().add(offset).cast()) }
    }

    /// Bytes that the other side writes too, copied out.
    fn copy_out(&self, at: usize, into: &mut [u8]) {
        assert!(at + into.len() <= self.bytes);
        // SAFETY: inside the mapping, and `into` is memory of this process. A program that writes out of turn changes numbers, which are
        // checked after the copy, and nothing else.
        unsafe {
            std::ptr::copy_nonoverlapping(
                self.start.as_ptr().add(at),
                into.as_mut_ptr(),
                into.len(),
            )
        };
    }

    fn copy_in(&self, at: usize, from: &[u8]) {
        assert!(at + from.len() <= self.bytes);
        // SAFETY: as above.
        unsafe {
            std::ptr::copy_nonoverlapping(from.as_ptr(), self.start.as_ptr().add(at), from.len())
        };
    }

    /// Asks the program for something; the count of the request.
    pub fn ask(&self, request: u32, tick: u64) -> u32 {
        self.word(offset_of!(ExchangeHead, request))
            .store(request, Ordering::Relaxed);
        self.long(offset_of!(ExchangeHead, tick))
            .store(tick, Ordering::Relaxed);
        let requests = self.word(offset_of!(ExchangeHead, requests));
        let count = self.asked.get().wrapping_add(1);
        self.asked.set(count);
        requests.store(count, Ordering::Release);
        let _ = rustix::thread::futex::wake(requests, rustix::thread::futex::Flags::empty(), 1);
        count
    }

    /// The word that counts answers, on which armplane sleeps.
    pub(crate) fn answers(&self) -> &AtomicU32 {
        self.word(offset_of!(ExchangeHead, answers))
    }

    pub(crate) fn answer(&self) -> u32 {
        self.word(offset_of!(ExchangeHead, answer))
            .load(Ordering::Relaxed)
    }

    pub(crate) fn answer_tick(&self) -> u64 {
        self.long(offset_of!(ExchangeHead, answer_tick))
            .load(Ordering::Relaxed)
    }

    /// State of the program; with acquire order, so that everything it wrote before is visible.
    pub(crate) fn program(&self) -> u32 {
        self.word(offset_of!(ExchangeHead, program))
            .load(Ordering::Acquire)
    }

    pub(crate) fn program_version(&self) -> u32 {
        self.word(offset_of!(ExchangeHead, program_version))
            .load(Ordering::Relaxed)
    }

    pub(crate) fn complaint(&self) -> String {
        self.text::<EXCHANGE_TEXT>(offset_of!(ExchangeHead, complaint))
    }

    /// Says why the program is stopped.
    pub fn give_reason(&self, reason: &str) {
        let mut text = [0; EXCHANGE_TEXT];
        put_text(&mut text, reason);
        self.copy_in(offset_of!(ExchangeHead, reason), &text);
    }

    /// Type name and layout that the program uses for a topic.
    pub(crate) fn program_type(&self, topic: usize) -> (String, u64) {
        let entry = self.topics_at + topic * size_of::<ExchangeTopic>();
        let layout = self
            .long(entry + offset_of!(ExchangeTopic, program_layout))
            .load(Ordering::Relaxed);
        (
            self.text::<EXCHANGE_TYPE>(entry + offset_of!(ExchangeTopic, program_type)),
            layout,
        )
    }

    /// Says whether the message of a topic belongs to the next request.
    pub fn mark_fresh(&self, topic: usize, is_fresh: bool) {
        let entry = self.topics_at + topic * size_of::<ExchangeTopic>();
        self.word(entry + offset_of!(ExchangeTopic, fresh))
            .store(u32::from(is_fresh), Ordering::Relaxed);
    }

    /// Puts a message on the page.
    pub fn put(&self, topic: usize, message: &[u8]) {
        let (at, bytes) = self.messages[topic];
        assert_eq!(message.len(), bytes);
        self.copy_in(at, message);
    }

    /// Copies a message from the page, from its byte `from` on.
    pub(crate) fn get(&self, topic: usize, from: usize, message: &mut [u8]) {
        let (at, bytes) = self.messages[topic];
        assert_eq!(from + message.len(), bytes);
        self.copy_out(at + from, message);
    }

    /// A number of a message on the page.
    pub fn number(&self, topic: usize, offset: usize) -> u32 {
        self.word(self.messages[topic].0 + offset)
            .load(Ordering::Relaxed)
    }

    /// Puts a predecessor's checkpoint on the page.
    pub fn put_state(&self, state: &[u8]) {
        self.copy_in(self.state_at, state);
        self.word(offset_of!(ExchangeHead, state_left))
            .store(state.len() as u32, Ordering::Relaxed);
    }

    /// How long the program's checkpoint is; more than there is room for is the program's error.
    pub(crate) fn state_bytes(&self) -> usize {
        self.word(offset_of!(ExchangeHead, state_bytes))
            .load(Ordering::Relaxed) as usize
    }

    /// Copies the program's checkpoint.
    pub fn get_state(&self, state: &mut [u8]) {
        assert!(state.len() <= EXCHANGE_STATE);
        self.copy_out(self.state_at, state);
    }

    fn text<const N: usize>(&self, at: usize) -> String {
        let mut bytes = [0; N];
        self.copy_out(at, &mut bytes);
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(N);
        // Printed in one line, whatever a program writes.
        String::from_utf8_lossy(&bytes[..end])
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .collect()
    }
}

/// A shared mapping of a file of so many bytes.
fn map(file: &std::fs::File, bytes: usize) -> std::io::Result<NonNull<u8>> {
    let (all, shared) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED);
    // SAFETY: a fresh mapping of a file of this length; nothing else in this process lies there.
    let start = unsafe { mmap(std::ptr::null_mut(), bytes, all, shared, file, 0)? };
    NonNull::new(start.cast()).ok_or_else(|| std::io::Error::other("mapped at address 0"))
}

impl Drop for Page {
    fn drop(&mut self) {
        // SAFETY: mapped by `create` with this size, and no reference outlives `self`.
        let _ = unsafe { munmap(self.start.as_ptr().cast(), self.bytes) };
    }
}

/// A text with a zero at its end, cut at a character where it is too long.
fn put_text(field: &mut [u8], text: &str) {
    let mut end = text.len().min(field.len() - 1);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
    field[end..].fill(0);
}

const _: () = assert!(
    EXCHANGE_NAME > 32 && EXCHANGE_TYPE > 128,
    "the longest names that a graph may have"
);

/// Writes the file, under another name until it is whole: a program that waits for it never sees half of it.
fn publish(path: &Path, image: &[u8]) -> std::io::Result<File> {
    let unfinished = path.with_added_extension("new");
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(true);
    let file = options.mode(0o600).open(&unfinished)?;
    std::io::Write::write_all(&mut &file, image)?;
    std::fs::rename(&unfinished, path)?;
    Ok(file)
}
