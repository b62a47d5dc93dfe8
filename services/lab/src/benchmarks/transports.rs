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
use runtime::{DoorbellPort, ForeignMessage, ProcessError, Shell};
use rustix::fs::{CWD, Mode};
use rustix::mm::{MapFlags, ProtFlags, mmap};
use rustix::thread::futex;
use serde::{Deserialize, Serialize};
use shared_types::Message;
use shared_types::topics::{Each, Topic, named};
use shared_types::wire::{Header, wire};

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
    topic: &'static str,
    type_name: &'static str,
    pub(super) bytes: usize,
    hash: u64,
    is_block: bool,
    sender: fn(&Shell, bool) -> Result<Send, ProcessError>,
    receiver: fn(&Shell) -> Result<Receive, ProcessError>,
}

impl Kind {
    fn of<M: Message>(is_block: bool) -> Self {
        Self {
            topic: M::TOPIC,
            type_name: M::TYPE_NAME,
            bytes: size_of::<M>(),
            hash: M::layout_hash(),
            is_block,
            sender: sender::<M>,
            receiver: receiver::<M>,
        }
    }

    /// The message of a topic: a block, or one of armplane's.
    pub(super) fn named(topic: &str) -> Option<Self> {
        struct Find;
        impl Each for Find {
            type Output = Kind;
            fn each<M: Topic>(&mut self) -> Kind {
                Kind::of::<M>(false)
            }
        }
        let block = blocks()
            .into_iter()
            .flatten()
            .find(|kind| kind.topic == topic);
        block.or_else(|| named(topic, &mut Find))
    }

    /// The entry of a block in a plan, which does not know it otherwise.
    pub(super) fn foreign(&self) -> Option<ForeignMessage> {
        self.is_block.then(|| ForeignMessage {
            topic: self.topic.into(),
            type_name: self.type_name.into(),
            bytes: self.bytes,
            hash: self.hash,
        })
    }

    /// The bytes that are written and read: of a block its header only.
    fn touched(&self) -> usize {
        if self.is_block {
            size_of::<Header>()
        } else {
            self.bytes
        }
    }
}

macro_rules! blocks {
    ($($bytes:literal $words:expr, $there:ident $there_topic:literal, $back:ident $back_topic:literal;)*) => {
        $(
            wire! { $there on $there_topic version 1 { header: Header, rest: [u64; $words] } }
            wire! { $back on $back_topic version 1 { header: Header, rest: [u64; $words] } }
        )*
        /// Bytes of the blocks; the smallest is smaller than a header and comes on top of it.
        pub(super) const BLOCKS: &[(usize, [&str; 2])] = &[$(($bytes, [$there_topic, $back_topic])),*];

        fn blocks() -> Vec<[Kind; 2]> {
            vec![$([Kind::of::<$there>(true), Kind::of::<$back>(true)]),*]
        }
    };
}

const HEADER_WORDS: usize = size_of::<Header>() / 8;
blocks! {
    64 8, Forth64 "block-64-there", Back64 "block-64-back";
    1024 128 - HEADER_WORDS, Forth1024 "block-1024-there", Back1024 "block-1024-back";
    4096 512 - HEADER_WORDS, Forth4096 "block-4096-there", Back4096 "block-4096-back";
    16_384 2048 - HEADER_WORDS, Forth16384 "block-16384-there", Back16384 "block-16384-back";
    262_144 32_768 - HEADER_WORDS, Forth262144 "block-262144-there", Back262144 "block-262144-back";
    4_194_304 524_288 - HEADER_WORDS, Forth4194304 "block-4194304-there", Back4194304 "block-4194304-back";
}

pub(super) fn stopped() -> ProcessError {
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
            send: (writes.sender)(shell, writes.is_block)?,
            receive: (reads.receiver)(shell)?,
        }),
        Mechanism::Bare => bare(shell, place, kinds),
        Mechanism::Futex => futex(shell.run_dir(), place, kinds).map_err(ProcessError::setup),
        Mechanism::Pipe => pipe(shell.run_dir(), place, kinds).map_err(ProcessError::setup),
    }
}

fn sender<M: Message>(shell: &Shell, is_block: bool) -> Result<Send, ProcessError> {
    let mut writer = shell.writer::<M>()?;
    Ok(Box::new(move |number| {
        let loan = if is_block {
            writer.loan_as_is(number)?
        } else {
            writer.loan(number)?
        };
        Ok(loan.send()?)
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
    let (mut out, mut seen) = (vec![0; writes.touched().min(LARGEST)], 0);
    let mut message = vec![0; reads.touched().min(LARGEST)];
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
    let (bytes, touched, reads) = (writes.bytes, writes.touched(), reads.touched());
    Ok(Ends {
        send: Box::new(move |number| {
            let sample = publisher.loan_slice_uninit(bytes).map_err(refused)?;
            // SAFETY: the memory is a mapped file, whose bytes are those of an earlier payload or zero.
            let mut sample = unsafe { sample.assume_init() };
            let payload = &mut sample.payload_mut()[..touched];
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
