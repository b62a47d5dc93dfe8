//! Resource limits of the shell: limits that are too small for a run are reported before it begins.

use std::io;

use runtime::{Exit, topic_bytes};
use rustix::io::Errno;
use rustix::process::{Resource, Rlimit, getrlimit, getuid, setrlimit};

/// Files that a process of the default graph has open at most: 64, and room for a replacement's connections.
const OPEN_FILES: u64 = 128;

const MIB: u64 = 1 << 20;

/// Address space of a process, this program itself included. The allocator reserves 64 MiB at a time for threads that allocate at once; with the
/// recording library's threads runs failed here and there up to 320 MiB and never from 340 on. For each process of the graph: what the launcher has of
/// it, and the stack of a thread.
const ADDRESS_SPACE: (u64, u64) = (448 * MIB, 8 * MIB);

/// The same for data, which are private memory that can be written: 16 MB were enough.
const DATA: (u64, u64) = (24 * MIB, 4 * MIB);

/// A limit on memory below this one may be the reason why a process was ended.
const LITTLE_MEMORY: u64 = 4 << 30;

/// The size of a file: the largest segment of a topic has 8 MB.
const FILE_SIZE: u64 = 16 * MIB;

/// Tasks (processes and threads) for each process of the graph: its two threads, and the one of the launcher that reads its standard error; and
/// one more of the launcher.
const TASKS: (u64, u64) = (1, 3);

/// Processes of the default graph. Every command demands as much as a run, so that the remedy
/// suffices for a run.
const USUAL_PROCESSES: usize = 5;

/// An amount that each process may have begins with it.
const A_PROCESS: &str = "a process ";

/// Below this limit the tasks of the user are counted; a limit as systems set it is far above.
const MANY_TASKS: u64 = 1024;

/// A limit that is too small, as a sentence.
#[derive(Debug, thiserror::Error)]
#[error("this shell allows {allowed}; a run needs {needed}: raise the limit with `ulimit {remedy}`{}", as_root(.is_hard))]
pub struct Shortage {
    /// The value it allows.
    allowed: String,
    /// The value a run needs.
    needed: String,
    /// Option and value of `ulimit`.
    remedy: String,
    /// The hard limit is too small, too.
    is_hard: bool,
}

fn as_root(is_hard: &bool) -> &'static str {
    if *is_hard {
        " (as root if it refuses)"
    } else {
        ""
    }
}

/// A limit on one resource, and the need.
struct Need {
    resource: Resource,
    least: u64,
    /// An amount in words.
    words: fn(u64) -> String,
    /// The option of `ulimit`, and the value that it takes for an amount.
    option: &'static str,
    value: fn(u64) -> String,
}

impl Need {
    fn check(&self) -> Result<(), Shortage> {
        let Rlimit { current, maximum } = getrlimit(self.resource);
        let is_too_small = |limit: Option<u64>| limit.is_some_and(|limit| limit < self.least);
        if !is_too_small(current) {
            return Ok(());
        }
        let allowed = (self.words)(current.unwrap_or(u64::MAX));
        let needed = (self.words)(self.least)
            .trim_start_matches(A_PROCESS)
            .to_owned();
        Err(Shortage {
            allowed,
            needed,
            remedy: format!("{} {}", self.option, (self.value)(self.least)),
            is_hard: is_too_small(maximum),
        })
    }
}

/// Amounts of memory for a graph of so many processes, whose own messages have these sizes in bytes.
fn memory_needs(processes: usize, own_messages: &[usize]) -> [Need; 2] {
    let segments: u64 = own_messages.iter().map(|bytes| topic_bytes(*bytes)).sum();
    let least = |(first, each): (u64, u64)| first + each * processes as u64;
    let kib = |bytes: u64| bytes.div_ceil(1024).to_string();
    [
        Need {
            resource: Resource::As,
            least: least(ADDRESS_SPACE) + segments,
            words: |bytes| format!("{A_PROCESS}{} kB of address space", bytes / 1024),
            option: "-v",
            value: kib,
        },
        Need {
            resource: Resource::Data,
            least: least(DATA),
            words: |bytes| format!("{A_PROCESS}{} kB of data", bytes / 1024),
            option: "-d",
            value: kib,
        },
    ]
}

/// Checks the limits of this process, which its children inherit, against the need of a run with so many processes, whose own messages have these sizes
/// in bytes; raises the limit on open files as far as a run needs it.
///
/// # Errors
/// [`Shortage`] if one is too small.
pub fn check_limits(processes: usize, own_messages: &[usize]) -> Result<(), Shortage> {
    let largest = own_messages
        .iter()
        .map(|bytes| 2 * topic_bytes(*bytes))
        .max()
        .unwrap_or_default();
    let file_size = Need {
        resource: Resource::Fsize,
        least: FILE_SIZE.max(largest),
        words: |bytes| format!("files of {} kB", bytes / 1024),
        option: "-f",
        // The unit is 512 bytes or 1024, as the shell has it.
        value: |_| "unlimited".to_owned(),
    };
    memory_needs(processes, own_messages)
        .iter()
        .try_for_each(Need::check)?;
    file_size.check()?;
    raise_open_files()?;
    check_tasks(TASKS.0 + TASKS.1 * processes as u64)
}

/// Raises the limit on open files, for this process and its children, where the hard limit lets it.
fn raise_open_files() -> Result<(), Shortage> {
    let limit = getrlimit(Resource::Nofile);
    let words = |files| format!("{A_PROCESS}{files} open files");
    let need = Need {
        resource: Resource::Nofile,
        least: OPEN_FILES,
        words,
        option: "-n",
        value: |files| files.to_string(),
    };
    need.check().or_else(|shortage| {
        if shortage.is_hard {
            return Err(shortage);
        }
        setrlimit(
            Resource::Nofile,
            Rlimit {
                current: Some(OPEN_FILES),
                ..limit
            },
        )
        .map_err(|_| shortage)
    })
}

/// Whether the user may have so many more tasks. The limit does not bind root.
fn check_tasks(more: u64) -> Result<(), Shortage> {
    let Some(limit) = getrlimit(Resource::Nproc)
        .current
        .filter(|limit| *limit < MANY_TASKS && !getuid().is_root())
    else {
        return Ok(());
    };
    let used = tasks_of_user();
    if used + more <= limit {
        return Ok(());
    }
    let (allowed, needed) = (
        format!("this user {limit} processes and threads, and {used} exist"),
        format!("{more} more"),
    );
    let is_hard = getrlimit(Resource::Nproc)
        .maximum
        .is_some_and(|maximum| maximum < used + more);
    Err(Shortage {
        allowed,
        needed,
        remedy: format!("-u {}", used + more),
        is_hard,
    })
}

fn tasks_of_user() -> u64 {
    let own = getuid().as_raw().to_string();
    let tasks = |entry: std::fs::DirEntry| {
        let status = std::fs::read_to_string(entry.path().join("status")).ok()?;
        let field = |name: &str| {
            status
                .lines()
                .find_map(|line| line.strip_prefix(name)?.split_whitespace().next())
        };
        (field("Uid:")? == own).then(|| field("Threads:")?.parse::<u64>().ok())?
    };
    std::fs::read_dir("/proc")
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(tasks)
        .sum()
}

/// The limit that has probably kept a process or thread from being started, in brackets; nothing if no limit explains the error.
pub(crate) fn explain(error: &io::Error) -> String {
    match Errno::from_io_error(error) {
        Some(Errno::AGAIN) => " (the limits on processes and threads, `ulimit -u`, and on memory, `ulimit -v`, are too small)".to_owned(),
        Some(Errno::NOMEM) => " (the limit on memory, `ulimit -v`, is too small, or the machine has no more)".to_owned(),
        Some(Errno::TOOBIG) => " (the limit on the stack, `ulimit -s`, is too small for this environment)".to_owned(),
        _ => String::new(),
    }
}

/// A line on the limit that has probably ended a process: one on memory, where it was ended as by a failed allocation.
pub(crate) fn suspected(exit: Exit) -> Option<String> {
    const ABORT: i32 = 6;
    const SEGMENTATION: i32 = 11;
    let is_likely = matches!(exit, Exit::Signal(ABORT | SEGMENTATION));
    let limited = |need: &Need| {
        let limit = getrlimit(need.resource)
            .current
            .filter(|limit| *limit < LITTLE_MEMORY)?;
        Some(((need.words)(limit), need.option))
    };
    let (allowed, option) = memory_needs(0, &[])
        .iter()
        .filter(|_| is_likely)
        .find_map(limited)?;
    Some(format!(
        "armplane: this shell's limit may be too small (it allows {allowed}): raise it with `ulimit {option}`"
    ))
}

/// Calls `main` on a stack that it fits on, where the shell allows the first thread only a small one; and lets a write beyond the limit on the size
/// of files fail with an error instead of a signal.
///
/// # Errors
/// If the shell allows less memory than any command needs, or the kernel refuses.
pub fn with_room<T: Send + 'static>(main: impl FnOnce() -> T + Send + 'static) -> io::Result<T> {
    const STACK: usize = 8 << 20;
    memory_needs(USUAL_PROCESSES, &[])
        .iter()
        .try_for_each(Need::check)
        .map_err(io::Error::other)?;
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default())?;
    if getrlimit(Resource::Stack)
        .current
        .is_none_or(|limit| limit >= STACK as u64 / 2)
    {
        return Ok(main());
    }
    let thread = std::thread::Builder::new()
        .name("main".into())
        .stack_size(STACK)
        .spawn(main)?;
    // The children of a run end with the thread that started them: it is joined.
    thread
        .join()
        .map_err(|_| io::Error::other("the program has panicked"))
}
