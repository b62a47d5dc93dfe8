//! Messages around a ring of processes: over topics, and over baseline transports, in turns within one run.

use std::path::Path;
use std::process::Command;

use bytemuck::{bytes_of, pod_read_unaligned};
use launcher::{Child, End, Event, Launcher, Limits, Plan, Restart};
use runtime::{
    ForeignMessage, Process, ProcessError, Reader, Shell, Writer, now_ns, realtime, sleep_until,
};
use serde::{Deserialize, Serialize};
use session::{Failure, Observer, Progress};
use shared_types::Message;
use shared_types::topics::{Each, Topic, named};

use super::distribution::{Distribution, histogram};
use super::transports::{
    BLOCKS, BlockMessage, HEADER_BYTES, HEADER_WORDS, Iceoryx, IceoryxWake, Mailboxes, Wake,
    is_whole, message_words,
};

const TASK: &str = "ring.json";
const MEASURED: &str = "measured.json";
const PRIORITY: u8 = 80;

/// How a message gets to the next process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Mechanism {
    /// A topic with its doorbell, as in a run: stamped and checked.
    Topic,
    Futex,
    Pipe,
    Spin,
    /// iceoryx2's publish-subscribe, its reader woken as said.
    Doorbell,
    Listener,
    WaitSet,
    Poll,
    /// Not at all: only the first process keeps its rhythm.
    Nothing,
}

/// The parts of a mechanism.
enum Means {
    Topic,
    Machine(Wake),
    Iceoryx(IceoryxWake),
    None,
}

impl Mechanism {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Topic => "topic + doorbell",
            Self::Futex => "futex",
            Self::Pipe => "pipe",
            Self::Spin => "spin",
            Self::Doorbell => "iceoryx2 + doorbell",
            Self::Listener => "iceoryx2 Listener",
            Self::WaitSet => "iceoryx2 WaitSet",
            Self::Poll => "iceoryx2, polled",
            Self::Nothing => "clock_nanosleep",
        }
    }

    fn means(self) -> Means {
        match self {
            Self::Topic => Means::Topic,
            Self::Futex => Means::Machine(Wake::Futex),
            Self::Pipe => Means::Machine(Wake::Pipe),
            Self::Spin => Means::Machine(Wake::Spin),
            Self::Doorbell => Means::Iceoryx(IceoryxWake::Doorbell),
            Self::Listener => Means::Iceoryx(IceoryxWake::Listener),
            Self::WaitSet => Means::Iceoryx(IceoryxWake::WaitSet),
            Self::Poll => Means::Iceoryx(IceoryxWake::Poll),
            Self::Nothing => Means::None,
        }
    }
}

/// A ring of processes and what goes around in it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Ring {
    /// The message from process i to process i + 1.
    pub topics: Vec<String>,
    /// Blocks of so many bytes go around instead of the topics' messages.
    pub block_bytes: Option<usize>,
    /// The core of each process; with `None` the kernel chooses it, without FIFO.
    pub cores: Vec<Option<usize>>,
    pub mechanisms: Vec<Mechanism>,
    /// Blocks of each mechanism that are measured; one more comes before, which warms everything up.
    pub rounds: u64,
    /// Trips around the ring in a block.
    pub trips: u64,
    /// Trips begin on a grid; `None` is one after the other.
    pub period_ns: Option<u64>,
}

/// The times of one mechanism.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Measured {
    /// Transport or step measured.
    pub mechanism: Mechanism,
    /// Once around, from the grid point where there is one, so that a late trip delays no clock.
    pub trip: Distribution,
    /// From the grid point to the first instruction after it.
    pub wake: Distribution,
}

impl Ring {
    /// Runs it in processes of its own.
    pub(super) fn measure(&self, observer: Observer<'_>) -> Result<Vec<Measured>, Failure> {
        let count = self.topics.len();
        let children = (0..count).map(|index| Child {
            process: Process {
                name: peer_name(index),
                hop: Some(index),
                reads: vec![self.topics[(index + count - 1) % count].clone()],
                writes: vec![self.topics[index].clone()],
                core: self.cores[index],
                ..Process::default()
            },
            ends_run: index == 0,
            restart: Restart::Never,
        });
        let plan = Plan {
            mode: runtime::Mode::Lockstep,
            rate_hz: 1000,
            children: children.collect(),
            messages: self.block_bytes.map_or(Vec::new(), block_messages),
            limits: Limits::of(runtime::Mode::Lockstep),
            faults: Vec::new(),
        };
        let launcher = Launcher::prepare(plan).map_err(Failure::work)?;
        let folder = launcher.run_dir().to_owned();
        let task = serde_json::to_vec(self).map_err(Failure::work)?;
        std::fs::write(folder.join(TASK), task)
            .and_then(|()| Mailboxes::create(&folder, count))
            .map_err(Failure::work)?;
        let mut measured = None;
        let command = |process: &str, run: &Path| {
            let mut command = Command::new(std::env::current_exe()?);
            command.args(["bench-peer", process, "--run"]).arg(run);
            Ok(command)
        };
        let outcome = launcher.run(&command, &mut |event| match event {
            Event::Line { process, line } => {
                observer(Progress::Line(&format!("{process}: {line}")))
            }
            Event::Stopped => measured = std::fs::read(folder.join(MEASURED)).ok(),
            _ => {}
        });
        match outcome.map_err(Failure::work)?.end {
            End::Completed => {
                serde_json::from_slice(&measured.unwrap_or_default()).map_err(Failure::work)
            }
            End::Interrupted { signal } => Err(Failure::Work(format!("stopped by {signal}"))),
            End::Failed(failure) => Err(Failure::work(failure)),
        }
    }
}

/// The name of a process of a ring.
fn peer_name(index: usize) -> String {
    format!("peer-{index}")
}

/// One process of a ring, as the launcher starts it.
pub fn peer(name: &str, run: &Path) -> Result<(), ProcessError> {
    let text = std::fs::read(run.join(TASK)).map_err(ProcessError::setup)?;
    let ring: Ring = serde_json::from_slice(&text).map_err(ProcessError::setup)?;
    let index = (0..ring.topics.len()).find(|index| peer_name(*index) == name);
    let index = index.ok_or_else(|| ProcessError::setup(format!("{name:?} is not in the ring")))?;
    let count = ring.topics.len();
    match ring.block_bytes {
        Some(bytes) => go_with_blocks(&ring, index, run, bytes),
        None => go(&ring, index, run, |shell, mailboxes, place| {
            Messages::open(
                shell,
                mailboxes,
                place,
                [
                    &ring.topics[(index + count - 1) % count],
                    &ring.topics[index],
                ],
            )
        }),
    }
}

/// Both ends that a process has of a ring.
trait Ends {
    fn send(&mut self, mechanism: Mechanism) -> Result<(), ProcessError>;
    fn receive(&mut self, mechanism: Mechanism) -> Result<(), ProcessError>;
}

/// A process's place in a ring: whom it reads from, its own, whom it writes to.
#[derive(Clone, Copy)]
struct Place {
    from: usize,
    me: usize,
    to: usize,
}

/// Sends a message of a topic of the list, whichever it is.
trait Sends {
    /// By the topic.
    fn send(&mut self) -> Result<(), ProcessError>;
    /// By a means of the machine.
    fn post(&self, mailboxes: &mut Mailboxes, wake: Wake, index: usize) -> std::io::Result<()>;
}

/// Receives a message of a topic of the list, whichever it is.
trait Receives {
    /// By the topic.
    fn receive(&mut self) -> Result<(), ProcessError>;
    /// By a means of the machine.
    fn fetch(&self, mailboxes: &mut Mailboxes, wake: Wake, index: usize) -> std::io::Result<()>;
}

struct Outbox<M: Message> {
    writer: Writer<M>,
    /// Messages sent on the topic: their ticks follow each other.
    sent: u64,
}

impl<M: Message> Sends for Outbox<M> {
    fn send(&mut self) -> Result<(), ProcessError> {
        let loan = self.writer.loan(self.sent)?;
        self.sent += 1;
        Ok(loan.send()?)
    }

    fn post(&self, mailboxes: &mut Mailboxes, wake: Wake, index: usize) -> std::io::Result<()> {
        mailboxes.send(wake, index, &std::hint::black_box(M::zeroed()))
    }
}

struct Inbox<M: Message>(Reader<M>);

impl<M: Message> Receives for Inbox<M> {
    fn receive(&mut self) -> Result<(), ProcessError> {
        std::hint::black_box(self.0.next()?.ok_or_else(stopped)?);
        Ok(())
    }

    fn fetch(&self, mailboxes: &mut Mailboxes, wake: Wake, index: usize) -> std::io::Result<()> {
        std::hint::black_box(mailboxes.receive::<M>(wake, index)?);
        Ok(())
    }
}

/// Opens a topic of the list for reading.
struct Incoming<'a>(&'a Shell);

impl Each for Incoming<'_> {
    type Output = Result<Box<dyn Receives>, ProcessError>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        Ok(Box::new(Inbox::<M>(self.0.reader()?)))
    }
}

/// Opens a topic of the list for writing; with the bytes of its message.
struct Outgoing<'a>(&'a Shell);

impl Each for Outgoing<'_> {
    type Output = Result<(Box<dyn Sends>, usize), ProcessError>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        Ok((
            Box::new(Outbox::<M> {
                writer: self.0.writer()?,
                sent: 0,
            }),
            size_of::<M>(),
        ))
    }
}

fn stopped() -> ProcessError {
    ProcessError::setup("stopped before the end")
}

/// Messages: by topic, bare on iceoryx2, and by the machine's own means.
struct Messages {
    inbox: Box<dyn Receives>,
    outbox: Box<dyn Sends>,
    iceoryx: Iceoryx,
    mailboxes: Mailboxes,
    place: Place,
}

impl Messages {
    fn open(
        shell: &Shell,
        mailboxes: Mailboxes,
        place: Place,
        [reads, writes]: [&str; 2],
    ) -> Result<Self, ProcessError> {
        let unlisted =
            |topic: &str| ProcessError::setup(format!("{topic:?} is no topic of the list"));
        let (outbox, bytes) =
            named(writes, &mut Outgoing(shell)).ok_or_else(|| unlisted(writes))??;
        let iceoryx = Iceoryx::open(shell, [place.from, place.me, place.to], bytes)?;
        let inbox = named(reads, &mut Incoming(shell)).ok_or_else(|| unlisted(reads))??;
        Ok(Self {
            inbox,
            outbox,
            iceoryx,
            mailboxes,
            place,
        })
    }
}

impl Ends for Messages {
    fn send(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        match mechanism.means() {
            Means::Topic => self.outbox.send(),
            // The whole message is written: zeros, as a topic's loan has them.
            Means::Iceoryx(wake) => self.iceoryx.send(wake, |payload| payload.fill(0)),
            Means::Machine(wake) => self
                .outbox
                .post(&mut self.mailboxes, wake, self.place.me)
                .map_err(ProcessError::setup),
            Means::None => Ok(()),
        }
    }

    fn receive(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        match mechanism.means() {
            Means::Topic => self.inbox.receive(),
            Means::Iceoryx(wake) => self.iceoryx.receive(wake, |message| {
                std::hint::black_box(message);
            }),
            Means::Machine(wake) => self
                .inbox
                .fetch(&mut self.mailboxes, wake, self.place.from)
                .map_err(ProcessError::setup),
            Means::None => Ok(()),
        }
    }
}

/// Blocks of a header and words that are never touched: by topic, bare on iceoryx2, and by the machine's own means.
struct Blocks<In: Message, Out: Message> {
    reader: Reader<In>,
    writer: Writer<Out>,
    iceoryx: Iceoryx,
    mailboxes: Mailboxes,
    place: Place,
    /// Blocks sent by other means than the topic.
    sent: u64,
    /// Messages sent on the topic: their ticks follow each other.
    ticks: u64,
}

impl<In: Message, Out: Message> Blocks<In, Out> {
    fn open(
        shell: &Shell,
        mailboxes: Mailboxes,
        place: Place,
        bytes: usize,
    ) -> Result<Self, ProcessError> {
        let iceoryx = Iceoryx::open(shell, [place.from, place.me, place.to], bytes)?;
        Ok(Self {
            reader: shell.reader()?,
            writer: shell.writer()?,
            iceoryx,
            mailboxes,
            place,
            sent: 0,
            ticks: 0,
        })
    }
}

impl<In: Message, Out: Message> Ends for Blocks<In, Out> {
    fn send(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        if mechanism == Mechanism::Topic {
            let loan = self.writer.loan_as_is(self.ticks)?;
            self.ticks += 1;
            return Ok(loan.send()?);
        }
        self.sent += 1;
        let header = [self.sent; HEADER_WORDS];
        match mechanism.means() {
            Means::Iceoryx(wake) => self.iceoryx.send(wake, |block| {
                block[..HEADER_BYTES].copy_from_slice(bytes_of(&header))
            }),
            Means::Machine(wake) => self
                .mailboxes
                .send_block(wake, self.place.me, &header)
                .map_err(ProcessError::setup),
            Means::Topic | Means::None => Ok(()),
        }
    }

    fn receive(&mut self, mechanism: Mechanism) -> Result<(), ProcessError> {
        let header = match mechanism.means() {
            Means::Topic => {
                std::hint::black_box(self.reader.next()?.ok_or_else(stopped)?);
                return Ok(());
            }
            Means::Iceoryx(wake) => self
                .iceoryx
                .receive(wake, |block| pod_read_unaligned(&block[..HEADER_BYTES]))?,
            Means::Machine(wake) => self
                .mailboxes
                .receive_block(wake, self.place.from)
                .map_err(ProcessError::setup)?,
            Means::None => return Ok(()),
        };
        if is_whole(&header) {
            Ok(())
        } else {
            Err(ProcessError::setup(format!(
                "{} handed over a torn header",
                mechanism.name()
            )))
        }
    }
}

/// One arm for each of [`BLOCKS`]: what is generic over a block, for the block of so many bytes.
macro_rules! for_block {
    ($bytes:expr, $call:ident, $none:expr) => {
        match BLOCKS.iter().position(|one| *one == $bytes) {
            Some(0) => $call!(0),
            Some(1) => $call!(1),
            Some(2) => $call!(2),
            Some(3) => $call!(3),
            Some(4) => $call!(4),
            Some(5) => $call!(5),
            _ => $none,
        }
    };
}

type There<const BLOCK: usize, const N: usize> = BlockMessage<BLOCK, N, 0>;
type Back<const BLOCK: usize, const N: usize> = BlockMessage<BLOCK, N, 1>;

/// The messages of the topics of blocks of so many bytes.
fn block_messages(bytes: usize) -> Vec<ForeignMessage> {
    fn of<M: Message>() -> ForeignMessage {
        ForeignMessage {
            topic: M::TOPIC.into(),
            type_name: M::TYPE_NAME.into(),
            bytes: size_of::<M>(),
            hash: M::layout_hash(),
        }
    }
    macro_rules! both {
        ($block:literal) => {
            vec![
                of::<There<$block, { message_words($block) }>>(),
                of::<Back<$block, { message_words($block) }>>(),
            ]
        };
    }
    for_block!(bytes, both, Vec::new())
}

fn go_with_blocks(ring: &Ring, index: usize, run: &Path, bytes: usize) -> Result<(), ProcessError> {
    macro_rules! peers {
        ($block:literal) => {{
            type Forth = There<$block, { message_words($block) }>;
            type Return = Back<$block, { message_words($block) }>;
            match index {
                0 => go(ring, index, run, |shell, mailboxes, place| {
                    Blocks::<Return, Forth>::open(shell, mailboxes, place, bytes)
                }),
                _ => go(ring, index, run, |shell, mailboxes, place| {
                    Blocks::<Forth, Return>::open(shell, mailboxes, place, bytes)
                }),
            }
        }};
    }
    for_block!(
        bytes,
        peers,
        Err(ProcessError::setup(format!("no block has {bytes} bytes")))
    )
}

fn go<E: Ends>(
    ring: &Ring,
    me: usize,
    run: &Path,
    open: impl FnOnce(&Shell, Mailboxes, Place) -> Result<E, ProcessError>,
) -> Result<(), ProcessError> {
    let count = ring.topics.len();
    let shell = Shell::open(run, &peer_name(me))?;
    let mailboxes =
        Mailboxes::open(run, count, ring.block_bytes.unwrap_or(0)).map_err(ProcessError::setup)?;
    let mut ends = open(
        &shell,
        mailboxes,
        Place {
            from: (me + count - 1) % count,
            me,
            to: (me + 1) % count,
        },
    )?;
    if ring.cores[me].is_some() {
        realtime::enter(Some(PRIORITY), realtime::Lock::AtOnce)
            .iter()
            .for_each(|right| tracing::warn!("measured without {right}"));
    }
    // No measurement before every process is connected, whichever mechanism comes first.
    shell.tick_source(0).next()?;
    if me == 0 {
        let measured = drive(ring, &mut ends)?;
        let text = serde_json::to_vec(&measured).map_err(ProcessError::setup)?;
        return std::fs::write(run.join(MEASURED), text).map_err(ProcessError::setup);
    }
    for _ in 0..=ring.rounds {
        for mechanism in ring
            .mechanisms
            .iter()
            .copied()
            .filter(|mechanism| *mechanism != Mechanism::Nothing)
        {
            for _ in 0..ring.trips {
                ends.receive(mechanism)?;
                ends.send(mechanism)?;
            }
        }
    }
    // The first process ends the run.
    while !shell.is_stopping() {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    Ok(())
}

/// The first process: sends, and takes the time until the answer has come around.
fn drive(ring: &Ring, ends: &mut impl Ends) -> Result<Vec<Measured>, ProcessError> {
    let mut histograms: Vec<_> = ring
        .mechanisms
        .iter()
        .map(|_| (histogram(), histogram()))
        .collect();
    for round in 0..=ring.rounds {
        for (&mechanism, (trips, wakes)) in ring.mechanisms.iter().zip(&mut histograms) {
            let mut grid_ns = now_ns();
            for _ in 0..ring.trips {
                let began_ns = match ring.period_ns {
                    None => now_ns(),
                    Some(period) => {
                        grid_ns += period;
                        while now_ns() < grid_ns {
                            sleep_until(grid_ns);
                        }
                        grid_ns
                    }
                };
                let awake_ns = if ring.period_ns.is_some() {
                    now_ns()
                } else {
                    began_ns
                };
                ends.send(mechanism)?;
                ends.receive(mechanism)?;
                let ended_ns = now_ns();
                if round > 0 {
                    trips.saturating_record(ended_ns - began_ns);
                    wakes.saturating_record(awake_ns - began_ns);
                }
            }
        }
    }
    let of = |(&mechanism, (trips, wakes)): (&Mechanism, &(_, _))| Measured {
        mechanism,
        trip: Distribution::of(trips),
        wake: Distribution::of(wakes),
    };
    Ok(ring.mechanisms.iter().zip(&histograms).map(of).collect())
}
