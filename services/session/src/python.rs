//! The Python that has the package `armplane`.

use std::ffi::OsString;

/// Where a module of the package is run.
#[derive(Debug)]
pub struct Python {
    /// The interpreter: of this program's own folder, where it has been installed together with the package; else that of PATH.
    pub program: String,
    /// PYTHONPATH, where the package lies in the source tree of this program.
    pub path: Option<OsString>,
}

impl Python {
    /// What to install where there is no interpreter; the extra packages follow.
    pub const MISSING: &str = "there is no Python: install Python 3.9 or newer, then pip install";

    /// Looks for it beside this program and in the folders above.
    #[must_use]
    pub fn find() -> Self {
        let program = std::env::current_exe().unwrap_or_default();
        let beside = program.with_file_name("python3");
        let mut packages = program.ancestors().map(|folder| folder.join("python"));
        let package = packages.find(|folder| folder.join("armplane/mujoco.py").is_file());
        let path = package.map(|package| {
            let others = std::env::var_os("PYTHONPATH").unwrap_or_default();
            let others =
                std::env::split_paths(&others).filter(|folder| !folder.as_os_str().is_empty());
            let all = std::iter::once(package).chain(others);
            std::env::join_paths(all).unwrap_or_default()
        });
        let program = match beside.is_file() {
            true => beside.display().to_string(),
            false => "python3".to_owned(),
        };
        Self { program, path }
    }
}
