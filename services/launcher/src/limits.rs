//! Resource limits of the shell that this program was started from.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::outcome::LaunchError;

/// Files that a process of the default graph has open at most: 64, and room for a replacement's connections.
const OPEN_FILES: u64 = 128;

/// Raises the limit on open files, for this process and its children, as far as a run needs it.
pub(crate) fn raise_open_files() -> Result<(), LaunchError> {
    let limit = getrlimit(Resource::Nofile);
    let is_enough = |limit: Option<u64>| limit.is_none_or(|limit| limit >= OPEN_FILES);
    if is_enough(limit.current) {
        return Ok(());
    }
    let refused = LaunchError::OpenFiles { allowed: limit.maximum.unwrap_or(u64::MAX), needed: OPEN_FILES };
    if !is_enough(limit.maximum) {
        return Err(refused);
    }
    setrlimit(Resource::Nofile, Rlimit { current: Some(OPEN_FILES), ..limit }).map_err(|_| refused)
}

/// Calls `main` on a stack that it fits on, where the shell allows the first thread only a small one; and lets a write beyond the limit on the size
/// of files fail with an error instead of a signal.
pub fn with_room<T: Send + 'static>(main: impl FnOnce() -> T + Send + 'static) -> std::io::Result<T> {
    const STACK: usize = 8 << 20;
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default())?;
    if getrlimit(Resource::Stack).current.is_none_or(|limit| limit >= STACK as u64 / 2) {
        return Ok(main());
    }
    let thread = std::thread::Builder::new().name("main".into()).stack_size(STACK).spawn(main)?;
    // The children of a run end with the thread that started them: it is joined.
    thread.join().map_err(|_| std::io::Error::other("the program has panicked"))
}
