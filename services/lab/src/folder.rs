//! Folders for the files of an experiment: the user's, or one that is gone at the end.

use std::path::{Path, PathBuf};

use session::Failure;

/// Where the runs leave their messages: the user's folder, or one that is gone at the end.
pub(crate) enum Folder {
    Kept(PathBuf),
    Passing(tempfile::TempDir),
}

impl Folder {
    pub(crate) fn create(wanted: Option<&Path>) -> Result<Self, Failure> {
        match wanted {
            None => tempfile::Builder::new()
                .prefix("armplane-")
                .tempdir()
                .map(Self::Passing)
                .map_err(|error| Failure::Work(format!("cannot make a temporary folder: {error}; name one with --out"))),
            Some(folder) => std::fs::create_dir_all(folder).and_then(|()| folder.canonicalize()).map(Self::Kept).map_err(|error| {
                Failure::Input(format!("cannot write to {}: {error}; choose another folder with --out", folder.display()))
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
            Self::Passing(folder) => folder.keep(),
        }
    }
}

/// A folder for the files of a run that is only measured; it goes with the value.
///
/// # Errors
/// [`Failure::Work`] where it cannot be made.
pub(crate) fn scratch() -> Result<tempfile::TempDir, Failure> {
    let folder = tempfile::Builder::new().prefix("armplane-bench-").tempdir();
    folder.map_err(|error| Failure::Work(format!("cannot make a temporary folder: {error}")))
}
