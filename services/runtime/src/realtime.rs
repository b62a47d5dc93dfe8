//! Real-time settings of a process, as far as the machine allows.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity};

/// Stack touched before the first tick, so that no page fault comes later; bytes.
const STACK: usize = 256 * 1024;

/// A right or resource that the process should have and has not.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Missing {
    /// Not pinned.
    #[error("core {core} (this process may use {allowed:?})")]
    Core {
        /// The core asked for.
        core: usize,
        /// The cores it may use.
        allowed: Vec<usize>,
    },
    /// No real-time scheduling.
    #[error(
        "SCHED_FIFO priority {priority} ({reason}; needs CAP_SYS_NICE or `ulimit -r {priority}`)"
    )]
    Fifo {
        /// The priority asked for.
        priority: u8,
        /// The kernel's error.
        reason: String,
    },
    /// Memory not locked.
    #[error("locked memory ({reason}; needs CAP_IPC_LOCK or `ulimit -l unlimited`)")]
    LockedMemory {
        /// The kernel's error.
        reason: String,
    },
}

/// The cores this process may use.
pub fn allowed_cores() -> Vec<usize> {
    sched_getaffinity(None).map_or_else(
        |_| Vec::new(),
        |set| {
            (0..CpuSet::MAX_CPU)
                .filter(|&core| set.is_set(core))
                .collect()
        },
    )
}

/// Pins this process to a core.
///
/// # Errors
/// When there is no such core, or this process may not use it.
pub fn pin(core: usize) -> Result<(), Missing> {
    let mut set = CpuSet::new();
    if core < CpuSet::MAX_CPU {
        set.set(core);
    }
    sched_setaffinity(None, &set).map_err(|_| Missing::Core {
        core,
        allowed: allowed_cores(),
    })
}

/// When the memory of a process is locked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lock {
    /// All of it at once: no page fault comes later.
    AtOnce,
    /// As it is touched: to have all of it at once, the program and the buffers of all topics, takes a tenth of a short run's processor time. For a process
    /// that no other waits for.
    AsTouched,
    /// Never: it is limited, and the process would be refused what it asks for later.
    Never,
}

/// Locks memory, touches the stack and takes a `SCHED_FIFO` priority. Returns the steps that are
/// not allowed; none is fatal.
pub fn enter(priority: Option<u8>, lock: Lock) -> Vec<Missing> {
    let all = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE;
    let locked = match lock {
        Lock::AtOnce => mlockall(all).map_err(|errno| errno.to_string()),
        Lock::AsTouched => {
            mlockall(all | MlockAllFlags::ONFAULT).map_err(|errno| errno.to_string())
        }
        Lock::Never => Err("limited".to_owned()),
    };
    touch_stack();
    let unlocked = locked.err().map(|reason| Missing::LockedMemory { reason });
    let fifo = priority.and_then(|priority| schedule(libc::SCHED_FIFO, priority).err());
    unlocked.into_iter().chain(fifo).collect()
}

/// Takes a `SCHED_RR` priority for this thread, and for the processes that it starts from now on: as `SCHED_FIFO`, but equals on a core take turns.
///
/// # Errors
/// [`Missing::Fifo`] if the kernel does not grant it.
pub fn set_round_robin_priority(priority: u8) -> Result<(), Missing> {
    schedule(libc::SCHED_RR, priority)
}

/// Whether this thread has ordinary scheduling, no real-time priority.
pub fn is_ordinary() -> bool {
    // SAFETY: a plain system call on this thread.
    !matches!(
        unsafe { libc::sched_getscheduler(0) },
        libc::SCHED_FIFO | libc::SCHED_RR
    )
}

/// Back to ordinary scheduling, which is always allowed.
pub fn set_ordinary_scheduling() {
    let _ = schedule(libc::SCHED_OTHER, 0);
}

fn schedule(policy: i32, priority: u8) -> Result<(), Missing> {
    let parameters = libc::sched_param {
        sched_priority: i32::from(priority),
    };
    // SAFETY: a plain system call on this thread with a valid structure.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        0 => Ok(()),
        _ => Err(Missing::Fifo {
            priority,
            reason: std::io::Error::last_os_error().to_string(),
        }),
    }
}

#[inline(never)]
fn touch_stack() {
    let mut stack = [0_u8; STACK];
    std::hint::black_box(&mut stack);
}

/// Rights that real time needs, as this process has them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rights {
    /// Whether it may use `SCHED_FIFO` at any priority (`CAP_SYS_NICE`).
    pub cap_sys_nice: bool,
    /// Whether it may lock any amount of memory (`CAP_IPC_LOCK`).
    pub cap_ipc_lock: bool,
    /// `RLIMIT_RTPRIO`; `None` is unlimited.
    pub rtprio_limit: Option<u64>,
    /// `RLIMIT_MEMLOCK` in bytes; `None` is unlimited.
    pub memlock_limit: Option<u64>,
}

impl Rights {
    /// Asks the kernel.
    pub fn query() -> Self {
        let effective = capabilities(None).map_or(CapabilitySet::empty(), |sets| sets.effective);
        Self {
            cap_sys_nice: effective.contains(CapabilitySet::SYS_NICE),
            cap_ipc_lock: effective.contains(CapabilitySet::IPC_LOCK),
            rtprio_limit: getrlimit(Resource::Rtprio).current,
            memlock_limit: getrlimit(Resource::Memlock).current,
        }
    }

    /// Whether `SCHED_FIFO` will be granted.
    pub fn fifo(&self) -> bool {
        self.cap_sys_nice || self.rtprio_limit.is_none_or(|limit| limit > 0)
    }

    /// Whether all memory may be locked.
    pub fn lock_memory(&self) -> bool {
        self.cap_ipc_lock || self.memlock_limit.is_none()
    }
}

/// The kernel's counters of this thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Usage {
    pub(crate) major_faults: i64,
    pub(crate) preemptions: i64,
}

impl Usage {
    pub(crate) fn now() -> Self {
        // SAFETY: `rusage` is plain integers; zero is valid.
        let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
        // SAFETY: a plain system call that fills the structure.
        unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) };
        Self {
            major_faults: usage.ru_majflt,
            preemptions: usage.ru_nivcsw,
        }
    }
}

/// Processor time that this process has used so far, all threads, user and system; s.
pub fn cpu_time_s() -> f64 {
    crate::clock::read(libc::CLOCK_PROCESS_CPUTIME_ID) as f64 * 1e-9
}

/// Lets the allocator keep what is freed, up to 64 MiB, and have 6 MiB at once, in large pages where the system gives them: for a process that asks for
/// large blocks again and again, each of which is otherwise new memory of the system's, cleared page by page as it is touched.
pub fn keep_memory() {
    const MOST: libc::c_int = 64 << 20;
    for bound in [libc::M_MMAP_THRESHOLD, libc::M_TRIM_THRESHOLD] {
        // SAFETY: it sets a number of the allocator's. Where it refuses, nothing has changed.
        unsafe { libc::mallopt(bound, MOST) };
    }
    // SAFETY: a block of ours until it is freed below, of which only whole pages are named; the system may refuse either advice, and nothing has changed then.
    unsafe {
        let block = libc::malloc(READY + LARGE);
        if !block.is_null() {
            let begin = block.map_addr(|address| address.next_multiple_of(LARGE));
            for advice in [libc::MADV_HUGEPAGE, libc::MADV_POPULATE_WRITE] {
                libc::madvise(begin, READY, advice);
            }
            libc::free(block);
            // The memory before the first large page is never used and never freed: the allocator would begin with it, and the system clear it page by page.
            // Memory that nobody looks at is not asked for at all, where the compiler sees it.
            std::hint::black_box(libc::malloc(begin.addr() - block.addr()));
        }
    }
}

/// Memory that [`keep_memory`] asks for: three large pages, as much as the recorder of a short run needs; bytes.
const READY: usize = 6 << 20;
/// A large page of memory, where there are such; bytes.
const LARGE: usize = 2 << 20;
