//! Segments in shared memory that a killed process left unfinished.
//!
//! iceoryx2 creates a segment in steps: an empty write-only file, its length, its content; then the
//! file becomes readable. A process that finds an unfinished segment waits for its creator. If it
//! may open the empty file, as root may, it waits without limit (iceoryx2-cal 0.10.0,
//! `dynamic_storage/posix_shared_memory.rs`, `open_impl`). A creator keeps the file open until it
//! is finished, so a file that no process has open has lost its creator. Once it is removed, the
//! waiting processes create it again.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::run_dir::{RunDir, SHM};

/// The device and the number of a file.
type Identity = (u64, u64);

/// The identity of an unfinished segment of this user; `None` if it is anything else.
fn unfinished(path: &Path) -> Option<Identity> {
    let metadata = fs::symlink_metadata(path).ok()?;
    let is_own = metadata.is_file() && metadata.uid() == rustix::process::geteuid().as_raw();
    (is_own && metadata.mode() & 0o400 == 0).then(|| (metadata.dev(), metadata.ino()))
}

/// The files that the processes of this user have open.
fn open_files() -> BTreeSet<Identity> {
    let entries = |path: PathBuf| {
        fs::read_dir(path)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path())
    };
    let descriptors = entries("/proc".into()).flat_map(|process| entries(process.join("fd")));
    let files = descriptors.filter_map(|descriptor| fs::metadata(descriptor).ok());
    files
        .map(|metadata| (metadata.dev(), metadata.ino()))
        .collect()
}

impl RunDir {
    /// Removes the segments of the run whose makers have been killed before they were finished. Returns how many.
    ///
    /// Costs one look at the names in shared memory where there is none.
    pub fn remove_unfinished(&self) -> usize {
        let prefix = format!("{}.", self.name());
        let listing = fs::read_dir(SHM).into_iter().flatten().flatten();
        let own = listing.filter(|entry| {
            entry
                .file_name()
                .to_str()
                .is_some_and(|name| name.starts_with(&prefix))
        });
        let found: Vec<_> = own
            .filter_map(|entry| Some((entry.path(), unfinished(&entry.path())?)))
            .collect();
        if found.is_empty() {
            return 0;
        }
        let open = open_files();
        // Looked at again: its maker may have finished it before the look at the open files.
        let has_no_maker = |(path, identity): &&(PathBuf, Identity)| {
            !open.contains(identity) && unfinished(path) == Some(*identity)
        };
        found
            .iter()
            .filter(has_no_maker)
            .filter(|(path, _)| fs::remove_file(path).is_ok())
            .count()
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};

    use super::*;

    #[test]
    fn a_segment_that_nobody_makes_any_more_is_removed() {
        let run = RunDir::create().unwrap();
        let path = |name: &str| Path::new(SHM).join(format!("{}.{name}", run.name()));
        let make = |name: &str| {
            fs::OpenOptions::new()
                .write(true)
                .create_new(true)
                .mode(0o200)
                .open(path(name))
                .unwrap()
        };
        let maker = make("made.connection");
        drop(make("closed.connection"));
        let [has_length, finished] = ["length.data", "finished.data"].map(make);
        has_length.set_len(4096).unwrap();
        drop(has_length);
        finished
            .set_permissions(fs::Permissions::from_mode(0o600))
            .unwrap();
        drop(finished);
        assert_eq!(run.remove_unfinished(), 2, "those without a maker");
        assert!(path("made.connection").exists() && path("finished.data").exists());
        assert!(!path("length.data").exists() && !path("closed.connection").exists());
        drop(maker);
        assert_eq!(run.remove_unfinished(), 1);
        assert!(!path("made.connection").exists());
    }
}
