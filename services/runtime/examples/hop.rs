//! Half a round trip between two processes: a message over a topic with its doorbell, against a copy behind a bare futex.
//!
//! `cargo run --release -p runtime --example hop` prints one line per placement and mechanism; both alternate within one run, so that they
//! see the same machine. The message is a whole `TorqueCommand`, written and read in full both ways.

use std::alloc::{GlobalAlloc, Layout, System};
use std::fs::OpenOptions;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use runtime::{Board, Hub, Manifest, Mode, Phase, Process, Reader, RunDir, Shell, Writer, now_ns, realtime};
use rustix::mm::{MapFlags, ProtFlags, mmap};
use rustix::thread::futex;
use shared_types::{Message, PlantState, TorqueCommand};

const ROUNDS: usize = 40;
const TRIPS: usize = 1_000;
/// Trips at the beginning of each block that wake caches and are not counted; the same for both mechanisms.
const WARM: usize = 50;
const PRIORITY: u8 = 80;

/// The system's allocator, counting. iceoryx2 0.10 allocates one small record for each loan; nothing else may.
struct Counting;

static ALLOCATIONS: AtomicU32 = AtomicU32::new(0);

// SAFETY: everything is the system allocator's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as required of our caller.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as required of our caller.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, role, run, core] = &arguments[..]
        && role == "pong"
    {
        return pong(run.as_ref(), core.parse()?);
    }
    println!("half round trip, {} bytes there and {} back; µs", size_of::<TorqueCommand>(), size_of::<PlantState>());
    println!("{:12} {:22} {:>8} {:>8} {:>8} {:>8} {:>8}", "placement", "mechanism", "p50", "p99", "p99.9", "max", "ratio");
    let cores = realtime::allowed_cores();
    measure("same core", cores[0], cores[0])?;
    if let Some(&other) = cores.get(1) {
        measure("cross core", cores[0], other)?;
    }
    Ok(())
}

fn measure(placement: &str, ours: usize, theirs: usize) -> Result<(), Failure> {
    let run = RunDir::create()?;
    let process = |name: &str, reads: &str, writes: &str| Process {
        name: name.into(),
        reads: vec![reads.into()],
        writes: vec![writes.into()],
        ..Process::default()
    };
    let processes =
        vec![process("ping", PlantState::TOPIC, TorqueCommand::TOPIC), process("pong", TorqueCommand::TOPIC, PlantState::TOPIC)];
    let manifest = Manifest { mode: Mode::Lockstep, rate_hz: 1000, wait_limit: Duration::from_secs(10), processes };
    manifest.write(&run)?;
    let board = Board::create(&run)?;
    let hub = Hub::create(&run, &manifest)?;
    let floor = Floor::map(run.path(), true)?;
    let mut child = Command::new(std::env::current_exe()?).arg("pong").arg(run.path()).arg(theirs.to_string()).spawn()?;

    let shell = Shell::open(run.path(), "ping")?;
    let (mut there, mut back) = (shell.writer::<TorqueCommand>()?, shell.reader::<PlantState>()?);
    while board.line(1).state() != runtime::State::Ready {
        std::thread::sleep(Duration::from_millis(1));
    }
    board.begin(Phase::Work);
    settle(ours);
    let (mut by_topic, mut by_futex) = (Vec::with_capacity(ROUNDS * TRIPS), Vec::with_capacity(ROUNDS * TRIPS));
    let mut allocations_before = 0;
    for round in 0..ROUNDS {
        if round == 1 {
            allocations_before = ALLOCATIONS.load(Ordering::Relaxed);
        }
        for trip in 0..TRIPS {
            let began = now_ns();
            let mut command = TorqueCommand::default();
            command.header.tick = (round * TRIPS + trip) as u64;
            there.send(command)?;
            let state = back.next()?.ok_or("stopped")?;
            std::hint::black_box(state);
            if trip >= WARM {
                by_topic.push((now_ns() - began) as f64 / 2e3);
            }
        }
        for trip in 0..TRIPS {
            let began = now_ns();
            floor.send(0, &TorqueCommand::default());
            std::hint::black_box(floor.receive::<PlantState>(1));
            if trip >= WARM {
                by_futex.push((now_ns() - began) as f64 / 2e3);
            }
        }
    }
    let allocations = ALLOCATIONS.load(Ordering::Relaxed) - allocations_before;
    assert_eq!(allocations as usize, (ROUNDS - 1) * TRIPS, "one allocation for each message sent, and no other");
    child.wait()?;
    let floor_p50 = row(placement, "futex + copy", &mut by_futex, None);
    row(placement, "topic + doorbell", &mut by_topic, Some(floor_p50));
    drop((there, back, shell, hub, board));
    run.remove()?;
    Ok(())
}

fn pong(run: &Path, core: usize) -> Result<(), Failure> {
    let shell = Shell::open(run, "pong")?;
    let floor = Floor::map(run, false)?;
    let (mut there, mut back): (Reader<TorqueCommand>, Writer<PlantState>) = (shell.reader()?, shell.writer()?);
    settle(core);
    for _ in 0..ROUNDS {
        for _ in 0..TRIPS {
            let tick = there.next()?.ok_or("stopped")?.header.tick;
            let mut state = PlantState::default();
            state.header.tick = tick;
            back.send(state)?;
        }
        for _ in 0..TRIPS {
            std::hint::black_box(floor.receive::<TorqueCommand>(0));
            floor.send(1, &PlantState::default());
        }
    }
    Ok(())
}

fn settle(core: usize) {
    let mut missing: Vec<_> = realtime::pin(core).err().into_iter().collect();
    missing.extend(realtime::enter(Some(PRIORITY)));
    missing.iter().for_each(|right| eprintln!("measured without {right}"));
}

fn row(placement: &str, mechanism: &str, samples: &mut [f64], floor_p50: Option<f64>) -> f64 {
    samples.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| samples[((samples.len() - 1) as f64 * share) as usize];
    let ratio = floor_p50.map_or("1.00".into(), |floor| format!("{:.2}", at(0.5) / floor));
    println!("{placement:12} {mechanism:22} {:8.2} {:8.2} {:8.2} {:8.2} {ratio:>8}", at(0.5), at(0.99), at(0.999), at(1.0));
    at(0.5)
}

/// Two one-message mailboxes in shared memory, each with a futex that is always waited for and always woken.
struct Floor {
    boxes: *mut [Mailbox; 2],
}

#[repr(C, align(64))]
struct Mailbox {
    sent: AtomicU32,
    read: AtomicU32,
    bytes: [u8; 4096],
}

impl Floor {
    fn map(run: &Path, create: bool) -> Result<Self, Failure> {
        let size = size_of::<[Mailbox; 2]>();
        let file = OpenOptions::new().read(true).write(true).create(create).truncate(false).open(run.join("floor"))?;
        if create {
            file.set_len(size as u64)?;
        }
        // SAFETY: a fresh shared mapping of a file of this size, kept to the end of the process.
        let boxes = unsafe { mmap(std::ptr::null_mut(), size, ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, file, 0)? };
        Ok(Self { boxes: boxes.cast() })
    }

    fn mailbox(&self, index: usize) -> *mut Mailbox {
        // SAFETY: two boxes are mapped.
        unsafe { &raw mut (*self.boxes)[index] }
    }

    fn send<M: Message>(&self, index: usize, message: &M) {
        let mailbox = self.mailbox(index);
        // SAFETY: the other side reads these bytes only after the count below has changed, and answers before we write again.
        unsafe {
            (&raw mut (*mailbox).bytes).cast::<M>().write_unaligned(*message);
            (*mailbox).sent.fetch_add(1, Ordering::Release);
            let _ = futex::wake(&(*mailbox).sent, futex::Flags::empty(), 1);
        }
    }

    fn receive<M: Message>(&self, index: usize) -> M {
        let mailbox = self.mailbox(index);
        // SAFETY: as in `send`.
        unsafe {
            let read = (*mailbox).read.load(Ordering::Relaxed);
            while (*mailbox).sent.load(Ordering::Acquire) == read {
                let _ = futex::wait(&(*mailbox).sent, futex::Flags::empty(), read, None);
            }
            (*mailbox).read.store(read.wrapping_add(1), Ordering::Relaxed);
            (&raw const (*mailbox).bytes).cast::<M>().read_unaligned()
        }
    }
}
