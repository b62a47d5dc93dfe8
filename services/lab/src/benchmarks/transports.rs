//! Four ways to hand a message to the next process of a ring: a topic with its doorbell, as in a run; iceoryx2 bare with the same doorbell; and two of
//! the machine itself, a futex and a pipe, without names, checks, clocks or recovery.
//!
//! Each is a pair of functions. A message carries the number of its hand-over, which its reader checks. Beside `runtime` this is the only file that
//! uses iceoryx2's ports: it measures them bare.

use std::cell::UnsafeCell;
use std::fmt::Display;
use std::fs::{File, OpenOptions};
use std::hint::black_box;
use std::io::{Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use runtime::{DoorbellPort, ProcessError, Shell};
use rustix::fs::{CWD, Mode};
use rustix::mm::{MapFlags, ProtFlags, mmap};
use rustix::thread::futex;
use serde::{Deserialize, Serialize};
use shared_types::Message;
use shared_types::topics::{OfTopic, Topic};

/// How a message gets to the next process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Mechanism {
    Futex,
    Topic,
    Bare,
    Pipe,
}

impl Mechanism {
    /// The baseline comes first.
    pub(super) const ALL: [Self; 4] = [Self::Futex, Self::Topic, Self::Bare, Self::Pipe];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Futex => "futex",
            Self::Topic => "topic + doorbell",
            Self::Bare => "iceoryx2 + doorbell",
            Self::Pipe => "pipe",
        }
    }
}

/// Sends the message of a number.
type Send = Box<dyn FnMut(u64) -> Result<(), ProcessError>>;
/// Waits for a message and gives its number.
type Receive = Box<dyn FnMut() -> Result<u64, ProcessError>>;

/// One process's ends of a ring.
pub(super) struct Ends {
    pub(super) send: Send,
    pub(super) receive: Receive,
}

/// A process's place in a ring: the process that it reads from, itself, and the one that reads it.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) from: usize,
    pub(super) me: usize,
    pub(super) to: usize,
}

/// A message as data, with the ends of its topic.
pub(super) struct Kind {
    pub(super) bytes: usize,
    sender: fn(&Shell) -> Result<Send, ProcessError>,
    receiver: fn(&Shell) -> Result<Receive, ProcessError>,
}

impl OfTopic for Kind {
    fn of_topic<M: Topic>() -> Self {
        Self {
            bytes: size_of::<M>(),
            sender: sender::<M>,
            receiver: receiver::<M>,
        }
    }
}

fn stopped() -> ProcessError {
    ProcessError::setup("stopped before the end")
}

/// Makes the files of the futex and the pipe of `count` processes.
pub(super) fn create(run: &Path, count: usize) -> std::io::Result<()> {
    (0..count).try_for_each(|index| {
        std::fs::write(
            run.join(format!("mailbox-{index}")),
            vec![0; size_of::<Mailbox>()],
        )?;
        Ok(rustix::fs::mkfifoat(
            CWD,
            run.join(format!("pipe-{index}")),
            Mode::RWXU,
        )?)
    })
}

/// Opens the ends of a process; `kinds` are the messages that it reads and writes.
pub(super) fn open(
    mechanism: Mechanism,
    shell: &Shell,
    place: Place,
    kinds: &[Kind; 2],
) -> Result<Ends, ProcessError> {
    let [reads, writes] = kinds;
    match mechanism {
        Mechanism::Topic => Ok(Ends {
            send: (writes.sender)(shell)?,
            receive: (reads.receiver)(shell)?,
        }),
        Mechanism::Bare => bare(shell, place, kinds),
        Mechanism::Futex => futex(shell.run_dir(), place, kinds).map_err(ProcessError::setup),
        Mechanism::Pipe => pipe(shell.run_dir(), place, kinds).map_err(ProcessError::setup),
    }
}

fn sender<M: Message>(shell: &Shell) -> Result<Send, ProcessError> {
    let mut writer = shell.writer::<M>()?;
    Ok(Box::new(move |number| {
        writer.loan(number)?;
        Ok(writer.send()?)
    }))
}

fn receiver<M: Message>(shell: &Shell) -> Result<Receive, ProcessError> {
    let mut reader = shell.reader::<M>()?;
    Ok(Box::new(move || {
        let message = black_box(reader.next()?.ok_or_else(stopped)?);
        Ok(message.header().tick)
    }))
}

/// The number in the first bytes of a message.
fn number(message: &[u8]) -> u64 {
    message
        .first_chunk()
        .map_or(u64::MAX, |word| u64::from_ne_bytes(*word))
}

/// Most bytes of a message that goes through a mailbox.
const LARGEST: usize = 4096;

#[repr(C, align(64))]
struct Mailbox {
    sent: AtomicU32,
    bytes: UnsafeCell<[u8; LARGEST]>,
}

/// A message is copied into shared memory and out of it; the reader sleeps on a futex that the writer always wakes.
fn futex(run: &Path, place: Place, [reads, writes]: &[Kind; 2]) -> std::io::Result<Ends> {
    let map = |index: usize| -> std::io::Result<&'static Mailbox> {
        let file = read_write(&run.join(format!("mailbox-{index}")))?;
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a fresh shared mapping of a file of this size, of plain bytes, for as long as the process lives.
        unsafe {
            let place = mmap(
                std::ptr::null_mut(),
                size_of::<Mailbox>(),
                protection,
                MapFlags::SHARED,
                file,
                0,
            )?;
            Ok(&*place.cast::<Mailbox>())
        }
    };
    let (inbox, outbox) = (map(place.from)?, map(place.me)?);
    let (mut out, mut seen) = (vec![0; writes.bytes.min(LARGEST)], 0);
    let mut message = vec![0; reads.bytes.min(LARGEST)];
    Ok(Ends {
        send: Box::new(move |number| {
            out[..8].copy_from_slice(&number.to_ne_bytes());
            // SAFETY: the reader looks at these bytes only after the count has changed, and answers before we write again.
            unsafe {
                std::ptr::copy_nonoverlapping(out.as_ptr(), outbox.bytes.get().cast(), out.len())
            };
            outbox.sent.fetch_add(1, Ordering::Release);
            let _ = futex::wake(&outbox.sent, futex::Flags::empty(), 1);
            Ok(())
        }),
        receive: Box::new(move || {
            while inbox.sent.load(Ordering::Acquire) == seen {
                let _ = futex::wait(&inbox.sent, futex::Flags::empty(), seen, None);
            }
            seen = seen.wrapping_add(1);
            // SAFETY: as above.
            unsafe {
                std::ptr::copy_nonoverlapping(
                    inbox.bytes.get().cast(),
                    message.as_mut_ptr(),
                    message.len(),
                )
            };
            Ok(number(black_box(&message)))
        }),
    })
}

/// All bytes of a message go through a pipe, which cannot do with less.
fn pipe(run: &Path, place: Place, [reads, writes]: &[Kind; 2]) -> std::io::Result<Ends> {
    let open = |index: usize| read_write(&run.join(format!("pipe-{index}")));
    let (mut from, mut to) = (open(place.from)?, open(place.me)?);
    let (mut out, mut message) = (vec![0; writes.bytes], vec![0; reads.bytes]);
    Ok(Ends {
        send: Box::new(move |number| {
            out[..8].copy_from_slice(&number.to_ne_bytes());
            to.write_all(&out).map_err(ProcessError::setup)
        }),
        receive: Box::new(move || {
            from.read_exact(&mut message).map_err(ProcessError::setup)?;
            Ok(number(black_box(&message)))
        }),
    })
}

fn read_write(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).open(path)
}

/// iceoryx2's publish-subscribe, woken by the doorbell of the runtime: what a topic is made of, without its checks.
fn bare(shell: &Shell, place: Place, [reads, writes]: &[Kind; 2]) -> Result<Ends, ProcessError> {
    let [doorbell, bell] = [(); 2].map(|()| DoorbellPort::of(shell));
    let publisher = service(&doorbell, place.me)?
        .publisher_builder()
        .max_loaned_samples(1)
        .initial_max_slice_len(writes.bytes)
        .create()
        .map_err(refused)?;
    let subscriber = service(&doorbell, place.from)?
        .subscriber_builder()
        .create()
        .map_err(refused)?;
    let (bytes, reads) = (writes.bytes, reads.bytes);
    Ok(Ends {
        send: Box::new(move |number| {
            let sample = publisher.loan_slice_uninit(bytes).map_err(refused)?;
            // SAFETY: the memory is a mapped file, whose bytes are those of an earlier payload or zero.
            let mut sample = unsafe { sample.assume_init() };
            let payload = sample.payload_mut();
            payload.fill(0);
            payload[..8].copy_from_slice(&number.to_ne_bytes());
            sample.send().map_err(refused)?;
            bell.ring(place.to);
            Ok(())
        }),
        receive: Box::new(move || {
            let sample = doorbell
                .wait(|| subscriber.receive())?
                .ok_or_else(stopped)?;
            Ok(number(black_box(&sample[..reads])))
        }),
    })
}

/// The service on which a process writes. One reader holds one sample: large payloads take no more memory than they must.
fn service(
    doorbell: &DoorbellPort,
    writer: usize,
) -> Result<PortFactory<ipc::Service, [u8], ()>, ProcessError> {
    let name = ServiceName::new(&format!("bare-{writer}")).map_err(refused)?;
    let aligned = Alignment::new(align_of::<u64>()).ok_or_else(|| refused("the alignment"))?;
    doorbell
        .node()
        .service_builder(&name)
        .publish_subscribe::<[u8]>()
        .payload_alignment(aligned)
        .max_publishers(1)
        .max_subscribers(1)
        .subscriber_max_borrowed_samples(1)
        .history_size(0)
        .subscriber_max_buffer_size(2)
        .open_or_create()
        .map_err(refused)
}

fn refused(error: impl Display) -> ProcessError {
    ProcessError::setup(format!("iceoryx2 refuses: {error}"))
}
