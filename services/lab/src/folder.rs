//! Folders for the files of an experiment: the user's, or one that is gone at the end.

use std::fs::File;
use std::path::{Path, PathBuf};

use launcher::Interrupts;
use launcher::folders::{self, KEPT, PREFIX};
use session::Failure;

use crate::end::check;

/// Where the runs leave their messages: the user's folder, or one that is gone at the end.
pub(crate) enum Folder {
    Kept(PathBuf),
    Passing(Scratch),
}

/// A folder that goes with the value. A signal that comes meanwhile waits for that.
pub(crate) struct Scratch {
    folder: tempfile::TempDir,
    /// Tells `armplane clean` that it is in use.
    _lock: File,
    // Dropped last.
    signals: Interrupts,
}

impl Scratch {
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// # Errors
    /// [`Failure::Work`] where a signal has come.
    pub(crate) fn check_signals(&mut self) -> Result<(), Failure> {
        check(&mut self.signals)
    }
}

impl Folder {
    pub(crate) fn create(wanted: Option<&Path>) -> Result<Self, Failure> {
        match wanted {
            None => scratch().map(Self::Passing),
            Some(folder) => files::make_folder(folder)
                .and_then(|()| folder.canonicalize())
                .map(Self::Kept)
                .map_err(|error| {
                    Failure::Input(format!(
                        "cannot write to {}: {error}; choose another folder with --out",
                        folder.display()
                    ))
                }),
        }
    }

    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Kept(path) => path,
            Self::Passing(folder) => folder.path(),
        }
    }

    /// It is kept for inspection.
    pub(crate) fn keep(self) -> PathBuf {
        match self {
            Self::Kept(path) => path,
            Self::Passing(Scratch { folder, .. }) => {
                // Not abandoned: whoever is told of it looks at it.
                let _ = std::fs::write(folder.path().join(KEPT), "");
                folder.keep()
            }
        }
    }
}

/// A folder for the files of a run that is only measured.
///
/// # Errors
/// [`Failure::Work`] where it cannot be made.
pub(crate) fn scratch() -> Result<Scratch, Failure> {
    let signals = session::interrupts()?;
    let folder = tempfile::Builder::new()
        .prefix(&format!("{PREFIX}{}-", std::process::id()))
        .tempdir();
    let held = folder.and_then(|folder| Ok((folders::hold(folder.path())?, folder)));
    let (_lock, folder) = held.map_err(|error| {
        Failure::Work(format!("cannot make a temporary folder: {error}; name one with --out, or another place with TMPDIR"))
    })?;
    Ok(Scratch {
        folder,
        _lock,
        signals,
    })
}
