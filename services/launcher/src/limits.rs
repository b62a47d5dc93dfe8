//! Room for this program and its processes within the limits of the shell.

use std::io;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files that a process of the default graph has open at most: 64, and room for a replacement's connections.
const OPEN_FILES: u64 = 128;

/// Raises the limit on open files, for this process and its children, as far as the hard limit lets it. A process that has too few names the file that it
/// cannot open.
pub(crate) fn raise_open_files() {
    let limit = getrlimit(Resource::Nofile);
    let most = limit.maximum.unwrap_or(OPEN_FILES).min(OPEN_FILES);
    if limit.current.is_some_and(|files| files < most) {
        let current = Some(most);
        let _ = setrlimit(Resource::Nofile, Rlimit { current, ..limit });
    }
}

/// Calls `main` on a stack that it fits on, where the shell allows the first thread only a small one; and lets a write beyond the limit on the size
/// of files fail with an error instead of a signal.
///
/// # Errors
/// If the kernel refuses.
pub fn with_room<T: Send + 'static>(main: impl FnOnce() -> T + Send + 'static) -> io::Result<T> {
    const STACK: usize = 8 << 20;
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
