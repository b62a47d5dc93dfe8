//! A run's place in shared memory: one private directory, and iceoryx2's files beside it under the same name.
//!
//! ```text
//! /dev/shm/armplane-<uid>-<pid>-<start>-<n>/     manifest.json, control page, nodes/, services/; mode 0700
//! /dev/shm/armplane-<uid>-<pid>-<start>-<n>.*    iceoryx2's segments
//! ```
//!
//! The name identifies the launcher by its process id and start time (field 22 of
//! `/proc/PID/stat`), so that a reused process id is not mistaken for the old launcher. A living
//! launcher also locks the directory, which works even across containers that share `/dev/shm`.

use std::collections::BTreeMap;
use std::fs;
use std::hash::{BuildHasher, RandomState};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::fs::{FallocateFlags, FileType, Mode, OFlags, fallocate};
use rustix::io::Errno;

/// The memory file system that all runs share.
pub const SHM: &str = "/dev/shm";

/// Free shared memory without which no run begins; bytes. The default graph takes 38 MB.
const LEAST_FREE: u64 = 40 << 20;

/// Most attempts to find a free name.
const ATTEMPTS: u32 = 100;

/// The directory of one run; its creator removes it, and everything of the run, when it drops it.
#[derive(Debug)]
pub struct RunDir {
    path: PathBuf,
    /// Held by the creator only: the lock of a living run.
    owner: Option<fs::File>,
}

/// Why a run directory cannot be made, opened or removed.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// The directory cannot be made.
    #[error(
        "cannot create {path} for the run: {source}; {SHM} must be a writable memory file system (see `armplane doctor`)"
    )]
    Create {
        /// The path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is not a run directory of this user.
    #[error("{path} is not the directory of a run of yours: {reason}")]
    NotARun {
        /// The path.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
    /// Something of it cannot be removed.
    #[error("cannot remove {path}: {source}")]
    Remove {
        /// The path.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The memory file system is full.
    #[error(
        "{SHM} is too full for a run: {missing} bytes are missing (`armplane doctor` shows its size, `armplane clean` removes leftovers)"
    )]
    Full {
        /// The missing.
        missing: u64,
    },
    /// Its own process entry cannot be read.
    #[error(
        "cannot read /proc/self/stat, which tells this process's start time: is /proc mounted?"
    )]
    NoProc,
}

/// A run found in shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundRun {
    /// Name of its directory; also the prefix of its other files.
    pub name: String,
    /// Process id of the launcher that made it.
    pub launcher_pid: u32,
    /// Whether that launcher is still alive.
    pub alive: bool,
    /// Size of all its files as they are allocated; bytes.
    pub bytes: u64,
}

impl RunDir {
    /// Makes a fresh directory, readable by this user only, named after this process.
    ///
    /// # Errors
    /// When `/dev/shm` is missing or not writable.
    pub fn create() -> Result<Self, RunDirError> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let pid = std::process::id();
        let start = start_time("self").ok_or(RunDirError::NoProc)?;
        let mut path = PathBuf::new();
        for attempt in 0..ATTEMPTS {
            // A number that another user of the machine cannot know before the directory is there, to take the name away. It is short because the name
            // is in the path of sockets, which has at most 107 bytes.
            let n = RandomState::new().hash_one(COUNT.fetch_add(1, Ordering::Relaxed)) as u16;
            path = Path::new(SHM).join(format!("{}{pid}-{start:x}-{n:x}", own_prefix()));
            match fs::DirBuilder::new().mode(0o700).create(&path) {
                Ok(()) => break,
                Err(error)
                    if error.kind() == std::io::ErrorKind::AlreadyExists
                        && attempt + 1 < ATTEMPTS => {}
                Err(source) => return Err(RunDirError::Create { path, source }),
            }
        }
        let locked = fs::File::open(&path).and_then(|owner| {
            owner.try_lock()?;
            Ok(Some(owner))
        });
        match locked {
            Ok(owner) => Ok(Self { path, owner }),
            Err(source) => Err(RunDirError::Create { path, source }),
        }
    }

    /// Opens the directory that a launcher made.
    ///
    /// # Errors
    /// When it does not exist, or belongs to another user, or others may enter it.
    pub fn open(path: &Path) -> Result<Self, RunDirError> {
        let not_a_run = |reason: String| RunDirError::NotARun {
            path: path.to_owned(),
            reason,
        };
        let metadata = fs::symlink_metadata(path).map_err(|e| not_a_run(e.to_string()))?;
        if !metadata.is_dir()
            || metadata.uid() != rustix::process::geteuid().as_raw()
            || metadata.mode() & 0o077 != 0
        {
            return Err(not_a_run(format!(
                "owner {}, mode {:o}",
                metadata.uid(),
                metadata.mode() & 0o7777
            )));
        }
        Ok(Self {
            path: path.to_owned(),
            owner: None,
        })
    }

    /// The directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its name, which tells the run from every other one on this machine.
    pub fn name(&self) -> &str {
        self.path
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or_default()
    }

    /// Takes the place of a process in the run, as long as the file is open; `None`: another process has it.
    pub(crate) fn occupy(&self, process: &str) -> std::io::Result<Option<fs::File>> {
        let path = self.path.join(format!("occupied-{process}"));
        let file = fs::OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(0o600)
            .open(path)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(fs::TryLockError::WouldBlock) => Ok(None),
            Err(fs::TryLockError::Error(error)) => Err(error),
        }
    }

    /// All runs of this user in shared memory, living and dead, by name.
    pub fn list() -> Vec<FoundRun> {
        let mut runs = BTreeMap::new();
        for (name, path) in entries() {
            let Some((launcher_pid, start)) = owner_of(&name) else {
                continue;
            };
            let found = || FoundRun {
                name: name.clone(),
                launcher_pid,
                alive: start_time(&launcher_pid.to_string()) == Some(start) || is_locked(&name),
                bytes: 0,
            };
            let run = runs.entry(name.clone()).or_insert_with(found);
            run.bytes += disk_usage(&path);
        }
        runs.into_values().collect()
    }

    /// Removes the files of dead launchers, and returns them; living runs are not touched.
    ///
    /// # Errors
    /// When a file of a dead run cannot be removed.
    pub fn remove_stale() -> Result<Vec<FoundRun>, RunDirError> {
        let stale: Vec<_> = Self::list().into_iter().filter(|run| !run.alive).collect();
        for run in &stale {
            remove_files(&run.name)?;
        }
        Ok(stale)
    }

    /// Removes the files of a run whose launcher is dead, as far as there are some.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn remove_left(name: &str) -> Result<(), RunDirError> {
        let is_left = |run: &FoundRun| run.name == name && !run.alive;
        match Self::list().iter().any(is_left) {
            true => remove_files(name),
            false => Ok(()),
        }
    }

    /// Takes the rights of others away from the run's files beside the directory: iceoryx2 makes its node counter writable for everybody.
    pub(crate) fn make_private(&self) -> std::io::Result<()> {
        for path in files_of(self.name()) {
            if let Some(file) = own_file(&path)? {
                rustix::fs::fchmod(&file, Mode::RUSR | Mode::WUSR)?;
            }
        }
        Ok(())
    }

    /// Takes the memory for all files of the run that are there, to their whole length: a memory file system that fills later ends no
    /// process of this run with SIGBUS.
    ///
    /// # Errors
    /// [`RunDirError::Full`] with the number of bytes that are missing.
    pub fn reserve(&self) -> Result<(), RunDirError> {
        let mut files: Vec<PathBuf> = files_of(self.name()).collect();
        let mut missing = 0;
        while let Some(path) = files.pop() {
            if path.is_dir() {
                files.extend(
                    fs::read_dir(&path)
                        .into_iter()
                        .flatten()
                        .flatten()
                        .map(|entry| entry.path()),
                );
                continue;
            }
            // A file of a passing moment may be gone.
            let Ok(Some(file)) = own_file(&path) else {
                continue;
            };
            let Ok(stat) = rustix::fs::fstat(&file) else {
                continue;
            };
            let (size, allocated) = (stat.st_size as u64, stat.st_blocks as u64 * 512);
            if size > allocated && fallocate(&file, FallocateFlags::empty(), 0, size).is_err() {
                missing += size - allocated;
            }
        }
        match missing {
            0 => Ok(()),
            _ => Err(RunDirError::Full {
                missing: missing.saturating_sub(free_bytes()).max(1),
            }),
        }
    }

    /// Whether shared memory has room for a run now.
    ///
    /// # Errors
    /// [`RunDirError::Full`] with the number of bytes that are missing.
    pub fn has_room() -> Result<(), RunDirError> {
        match LEAST_FREE.checked_sub(free_bytes()) {
            None | Some(0) => Ok(()),
            Some(missing) => Err(RunDirError::Full { missing }),
        }
    }

    /// Removes the run and everything in it.
    ///
    /// # Errors
    /// When a file cannot be removed; the rest is removed nevertheless.
    pub fn remove(mut self) -> Result<(), RunDirError> {
        self.owner = None;
        remove_files(self.name())
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        if self.owner.is_some()
            && let Err(error) = remove_files(self.name())
        {
            tracing::warn!("{error}");
        }
    }
}

/// Bytes free in shared memory; none if there is no such file system, which the first file says better.
fn free_bytes() -> u64 {
    rustix::fs::statvfs(SHM).map_or(u64::MAX, |space| {
        space.f_bavail.saturating_mul(space.f_frsize)
    })
}

/// A regular file of this user, opened without following a link; `None` if it is anything else.
fn own_file(path: &Path) -> std::io::Result<Option<OwnedFd>> {
    let flags = OFlags::RDWR | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = match rustix::fs::open(path, flags, Mode::empty()) {
        Ok(file) => file,
        Err(Errno::LOOP | Errno::ISDIR | Errno::NOENT | Errno::ACCESS | Errno::NXIO) => {
            return Ok(None);
        }
        Err(errno) => return Err(errno.into()),
    };
    let stat = rustix::fs::fstat(&file)?;
    let is_own = stat.st_uid == rustix::process::geteuid().as_raw();
    Ok((is_own && FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile).then_some(file))
}

fn own_prefix() -> String {
    format!("armplane-{}-", rustix::process::geteuid().as_raw())
}

/// Everything of this user's runs in shared memory: the run's name and the path.
fn entries() -> Vec<(String, PathBuf)> {
    let prefix = own_prefix();
    let Ok(listing) = fs::read_dir(SHM) else {
        return Vec::new();
    };
    listing
        .flatten()
        .filter_map(|entry| {
            let file_name = entry.file_name().into_string().ok()?;
            // A file of another user is no part of a run of this one, whatever its name.
            let is_own = fs::symlink_metadata(entry.path())
                .is_ok_and(|metadata| metadata.uid() == rustix::process::geteuid().as_raw());
            (is_own && file_name.starts_with(&prefix)).then(|| {
                let name = file_name.split('.').next().unwrap_or_default().to_owned();
                (name, entry.path())
            })
        })
        .collect()
}

/// That of one run.
fn files_of(name: &str) -> impl Iterator<Item = PathBuf> {
    let own = entries().into_iter().filter(move |entry| entry.0 == name);
    own.map(|(_, path)| path)
}

/// Process id and start time in a run's name.
fn owner_of(name: &str) -> Option<(u32, u64)> {
    let mut parts = name.strip_prefix(&own_prefix())?.split('-');
    let (pid, start, n) = (parts.next()?, parts.next()?, parts.next()?);
    u32::from_str_radix(n, 16).ok()?;
    parts
        .next()
        .is_none()
        .then_some((pid.parse().ok()?, u64::from_str_radix(start, 16).ok()?))
}

/// When a process started, in clock ticks since boot.
fn start_time(pid: &str) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the command in parentheses and may contain anything: count from its end.
    stat.rsplit_once(')')?
        .1
        .split_whitespace()
        .nth(19)?
        .parse()
        .ok()
}

fn is_locked(name: &str) -> bool {
    let mut options = fs::OpenOptions::new();
    let folder = options
        .read(true)
        .custom_flags(libc::O_DIRECTORY | libc::O_NOFOLLOW)
        .open(Path::new(SHM).join(name));
    folder.is_ok_and(|folder| matches!(folder.try_lock(), Err(fs::TryLockError::WouldBlock)))
}

fn disk_usage(path: &Path) -> u64 {
    let Ok(metadata) = fs::symlink_metadata(path) else {
        return 0;
    };
    let inside = match fs::read_dir(path) {
        Ok(listing) if metadata.is_dir() => listing
            .flatten()
            .map(|entry| disk_usage(&entry.path()))
            .sum(),
        _ => 0,
    };
    metadata.blocks() * 512 + inside
}

/// The files first, the directory last: as long as anything is left, the directory shows it.
fn remove_files(name: &str) -> Result<(), RunDirError> {
    let mut first_error = None;
    let (directories, files): (Vec<_>, Vec<_>) = files_of(name).partition(|path| path.is_dir());
    for path in files.into_iter().chain(directories) {
        let removed = if path.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
        if let Err(source) = removed
            && source.kind() != std::io::ErrorKind::NotFound
        {
            first_error.get_or_insert(RunDirError::Remove { path, source });
        }
    }
    first_error.map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// A file beside the directory of a run.
    fn beside(name: &str, ending: &str) -> PathBuf {
        Path::new(SHM).join(format!("{name}.{ending}"))
    }

    fn set_mode(path: &Path, mode: u32) {
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    }

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().mode() & 0o777
    }

    #[test]
    fn a_run_directory_is_private_short_listed_and_gone_with_its_owner() {
        let run = RunDir::create().unwrap();
        let (name, path) = (run.name().to_owned(), run.path().to_owned());
        assert_eq!(mode(&path), 0o700);
        assert!(
            path.as_os_str().len() < 66,
            "{path:?} is too long for a socket path"
        );
        let segment = beside(&name, "segment");
        fs::write(path.join("inside"), "x").unwrap();
        fs::write(&segment, "x").unwrap();
        let found = RunDir::list()
            .into_iter()
            .find(|run| run.name == name)
            .unwrap();
        assert!(found.alive && found.launcher_pid == std::process::id() && found.bytes > 0);
        RunDir::open(&path).unwrap();
        set_mode(&path, 0o755);
        let others_may_enter = RunDir::open(&path).map(drop);
        assert!(matches!(others_may_enter, Err(RunDirError::NotARun { .. })));
        drop(run);
        assert!(!path.exists() && !segment.exists());
    }

    #[test]
    fn only_what_the_dead_left_is_removed() {
        let living = RunDir::create().unwrap();
        // A process id beyond the kernel's maximum belongs to no process.
        let dead = format!("{}4194999-1f-0", own_prefix());
        let (path, segment) = (Path::new(SHM).join(&dead), beside(&dead, "segment"));
        fs::create_dir(&path).unwrap();
        fs::write(&segment, "x").unwrap();
        let removed = RunDir::remove_stale().unwrap();
        assert!(removed.iter().any(|run| run.name == dead));
        assert!(!path.exists() && !segment.exists() && living.path().exists());
        for other in [
            "armplane",
            "armplane-0",
            "armplane-0-x-1-0",
            "armplane-0-1-1-0-7",
        ] {
            assert_eq!(owner_of(other), None, "{other}");
        }
    }

    #[test]
    fn a_link_beside_the_run_keeps_the_mode_of_its_target() {
        let run = RunDir::create().unwrap();
        let [link, own] = ["link", "own"].map(|ending| beside(run.name(), ending));
        let target = run.path().join("target");
        for (path, mode) in [(&target, 0o644), (&own, 0o666)] {
            fs::write(path, "x").unwrap();
            set_mode(path, mode);
        }
        std::os::unix::fs::symlink(&target, &link).unwrap();
        run.make_private().unwrap();
        assert_eq!((mode(&target), mode(&own)), (0o644, 0o600));
        run.remove().unwrap();
        assert!(fs::symlink_metadata(&link).is_err() && !own.exists());
    }

    #[test]
    fn reserved_memory_is_there() {
        let run = RunDir::create().unwrap();
        let make = |path: &Path, length| fs::File::create(path).unwrap().set_len(length).unwrap();
        let paths = [run.path().join("inside"), beside(run.name(), "beside")];
        paths.iter().for_each(|path| make(path, 1 << 20));
        run.reserve().unwrap();
        let taken = |path: &PathBuf| fs::metadata(path).unwrap().blocks() * 512;
        assert!(paths.iter().all(|path| taken(path) >= 1 << 20));
        make(&run.path().join("huge"), 1 << 50);
        assert!(matches!(run.reserve(), Err(RunDirError::Full { missing }) if missing > 1 << 49));
    }
}
