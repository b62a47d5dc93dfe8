//! Temporary folders of experiments, each named after its process.

use std::fs::{DirEntry, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Beginning of the name of a temporary folder; the process id of the experiment and `-` follow.
pub const PREFIX: &str = "armplane-";

/// File in a folder that is kept for inspection.
pub const KEPT: &str = ".kept";

/// Says that an experiment uses its folder, as long as the file is open: in other containers, too, which do not see its process.
///
/// # Errors
/// The folder cannot be opened.
pub fn hold(folder: &Path) -> io::Result<File> {
    let lock = File::open(folder)?;
    lock.try_lock()?;
    Ok(lock)
}

/// Temporary folders of this user's experiments that were killed: their processes are gone, and they were not kept for inspection.
pub fn abandoned() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(std::env::temp_dir())
        .into_iter()
        .flatten()
        .filter_map(Result::ok);
    let is_abandoned = |folder: &DirEntry| {
        let name = folder.file_name();
        let pid = name.to_str().and_then(|name| {
            name.strip_prefix(PREFIX)?
                .split_once('-')?
                .0
                .parse::<u32>()
                .ok()
        });
        let is_dead = pid.is_some_and(|pid| !Path::new(&format!("/proc/{pid}")).exists());
        // Of the entry itself, not of what a link leads to.
        let is_own = folder
            .metadata()
            .is_ok_and(|entry| entry.is_dir() && entry.uid() == rustix::process::getuid().as_raw());
        is_dead && is_own && !folder.path().join(KEPT).exists() && hold(&folder.path()).is_ok()
    };
    entries
        .filter(is_abandoned)
        .map(|folder| folder.path())
        .collect()
}

/// Removes them; returns those that are gone.
///
/// # Errors
/// The first folder that cannot be removed.
pub fn remove_abandoned() -> io::Result<Vec<PathBuf>> {
    let folders = abandoned();
    folders
        .iter()
        .try_for_each(|folder| match std::fs::remove_dir_all(folder) {
            // Another `clean` was quicker.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            removed => removed,
        })?;
    Ok(folders)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_dead_process_is_abandoned_and_others_are_not() {
        let folder = |pid: u32| {
            tempfile::Builder::new()
                .prefix(&format!("{PREFIX}{pid}-"))
                .tempdir()
                .unwrap()
        };
        // Beyond the largest process id of Linux.
        let [dead, kept, elsewhere] = [1 << 23; 3].map(folder);
        let living = folder(std::process::id());
        let _lock = hold(elsewhere.path()).unwrap();
        std::fs::write(kept.path().join(KEPT), "").unwrap();
        let found = abandoned();
        assert!(found.contains(&dead.path().to_owned()));
        for folder in [kept, living, elsewhere] {
            assert!(!found.contains(&folder.path().to_owned()));
        }
    }
}
