//! The one door to files that a person names, or that stand in the folder of a run, and to lines that somebody else writes.
//!
//! To open a named pipe is to wait for its writer, and a device may have no end: what is no regular file is refused. A pipe that this process holds already is
//! read (`/dev/stdin`, and `/dev/fd/N` as a shell makes it of `<(command)`): it waits for nobody but the command that the user has put there.

use std::fs::File;
use std::io::{self, BufRead, Read, Write};
use std::path::{Path, PathBuf};

use rustix::fs::{FileType, Mode, OFlags, fcntl_setfl, fstat, open as open_at};
use rustix::io::Errno;
use shared_types::file::nearest;
use shared_types::job::RobotText;

/// Opens a file for reading.
///
/// # Errors
/// The system's, and [`io::ErrorKind::InvalidInput`] for what is neither a regular file nor a pipe that this process holds.
pub fn open(path: &Path) -> io::Result<File> {
    // Without waiting: a pipe without a writer is opened too, and then refused.
    let file = File::from(open_at(
        path,
        OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK | OFlags::NOCTTY,
        Mode::empty(),
    )?);
    match FileType::from_raw_mode(fstat(&file)?.st_mode) {
        FileType::RegularFile => Ok(file),
        FileType::Directory => Err(io::Error::new(
            io::ErrorKind::IsADirectory,
            "it is a folder",
        )),
        FileType::Fifo | FileType::Socket | FileType::CharacterDevice if is_held(path) => {
            fcntl_setfl(&file, OFlags::empty())?;
            Ok(file)
        }
        other => Err(irregular(words(other))),
    }
}

/// The folder of a file; `.` of a name alone.
pub fn folder_of(path: &Path) -> &Path {
    let folder = path.parent();
    let named = folder.filter(|folder| !folder.as_os_str().is_empty());
    named.unwrap_or(Path::new("."))
}

/// Makes a folder, and those above it, where they are not there yet.
///
/// # Errors
/// The system's; [`io::ErrorKind::NotADirectory`] where a file stands there.
pub fn make_folder(path: &Path) -> io::Result<()> {
    std::fs::create_dir_all(path).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => {
            io::Error::new(io::ErrorKind::NotADirectory, "a file stands there")
        }
        _ => error,
    })
}

/// The largest file that is read whole: an hour of targets at 1 kHz has 200 MB.
pub const LARGEST: u64 = 256 << 20;

/// The largest file that a person writes: the URDF of a humanoid has 100 kB.
pub const LARGEST_WRITTEN: u64 = 4 << 20;

/// All bytes of a file.
///
/// # Errors
/// As [`open`], and [`io::ErrorKind::FileTooLarge`] beyond 256 MiB: a pipe may have no end.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    read_at_most(path, LARGEST)
}

/// The text of a file of at most so many bytes.
///
/// # Errors
/// As [`read`], and [`io::ErrorKind::InvalidData`] where it is no UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let bytes = read_at_most(path, most)?;
    String::from_utf8(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}

/// The same, with an error that states the remedy.
///
/// # Errors
/// The sentence.
pub fn text(path: &Path, most: u64) -> Result<String, String> {
    read_text(path, most).map_err(|error| {
        let name = path.display();
        match error.kind() {
            io::ErrorKind::InvalidInput => format!("cannot read {name}: {error}; give the path of a file, or a pipe as /dev/stdin or <(…)"),
            io::ErrorKind::NotFound => format!("there is no file {name}: {}", instead_of(path)),
            io::ErrorKind::InvalidData => format!("{name} is not text: save it as UTF-8"),
            io::ErrorKind::IsADirectory => format!("{name} is a folder: give the path of a file"),
            _ => format!("cannot read {name}: {error}"),
        }
    })
}

/// Files of a folder that a sentence lists at most, and those that are looked at.
const LISTED: usize = 6;
const SEEN: usize = 1000;

/// The remedy for a file that is not there: one of its kind in its folder with a similar name, or those that there are.
fn instead_of(path: &Path) -> String {
    let folder = folder_of(path);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is_alike = |one: &Path| one.extension() == path.extension() && one.is_file();
    let Ok(entries) = folder.read_dir() else {
        return format!("there is no folder {}", folder.display());
    };
    let paths = entries.flatten().take(SEEN).map(|entry| entry.path());
    let names = paths.filter(|one| is_alike(one)).filter_map(|one| {
        let name = one.file_name()?.to_str()?;
        Some(name.to_owned())
    });
    let mut names: Vec<String> = names.collect();
    names.sort();
    match nearest(&name, names.iter().map(String::as_str)) {
        Some(near) => format!("did you mean `{}`?", path.with_file_name(near).display()),
        None if names.is_empty() || names.len() > LISTED => {
            "give the path of one that exists".to_owned()
        }
        None => format!("in its folder there are {}", names.join(", ")),
    }
}

/// The texts of an arm, named as its file: a URDF or MJCF with its description, or where none is given the TOML file of the same name beside it, if there is one.
///
/// # Errors
/// As [`text`].
pub fn robot(path: &Path, description: Option<&Path>) -> Result<RobotText, String> {
    let beside = path.with_extension("toml");
    let beside = Some(beside.as_path()).filter(|beside| beside.exists());
    let description = description.or(beside);
    let description = description.map(|file| text(file, LARGEST_WRITTEN));
    let folder = path.canonicalize().ok();
    let folder = folder.as_deref().and_then(Path::parent);
    Ok(RobotText {
        folder: folder.map(Path::to_owned).unwrap_or_default(),
        name: path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into(),
        urdf: text(path, LARGEST_WRITTEN)?,
        description: description.transpose()?.unwrap_or_default(),
    })
}

fn read_at_most(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let sentence = format!("it has more than {} MiB", most >> 20);
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, sentence));
    }
    Ok(bytes)
}

/// Makes a file, or empties the one that is there.
///
/// # Errors
/// The system's, and [`io::ErrorKind::InvalidInput`] for a symbolic link, a named pipe or a device: what is written there would go elsewhere, or wait
/// for a reader. A descriptor of this process (`/dev/stdout`, `/dev/fd/N`) is written to.
pub fn create(path: &Path) -> io::Result<File> {
    writable(path, OFlags::CREATE | OFlags::TRUNC)
}

fn writable(path: &Path, how: OFlags) -> io::Result<File> {
    let held = path == Path::new("/dev/stdout") || is_held(path);
    let flags = OFlags::WRONLY | OFlags::CLOEXEC | OFlags::NOCTTY | how;
    // Without waiting: a pipe that somebody reads is opened, and then refused.
    let more = if held {
        OFlags::empty()
    } else {
        OFlags::NOFOLLOW | OFlags::NONBLOCK
    };
    let file = match open_at(path, flags | more, Mode::from_raw_mode(0o666)) {
        Err(Errno::LOOP) => return Err(irregular("a symbolic link")),
        Err(Errno::NXIO) => return Err(irregular("a named pipe")),
        opened => File::from(opened?),
    };
    match FileType::from_raw_mode(fstat(&file)?.st_mode) {
        FileType::RegularFile => Ok(file),
        _ if held => Ok(file),
        other => Err(irregular(words(other))),
    }
}

/// Makes a file that is not there yet, and writes it whole.
///
/// # Errors
/// As [`create`], and [`io::ErrorKind::AlreadyExists`].
pub fn write_new(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    writable(path, OFlags::CREATE | OFlags::EXCL)?.write_all(bytes.as_ref())
}

/// Writes a file whole.
///
/// # Errors
/// As [`create`].
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    create(path)?.write_all(bytes.as_ref())
}

/// A file in the making: it stands beside its place, and takes it when it is whole. Dropped before, it is removed.
#[derive(Debug)]
pub struct Draft {
    path: PathBuf,
    /// `None` for a descriptor of this process, and once it has its place.
    beside: Option<PathBuf>,
}

impl Draft {
    /// Begins a file that shall replace the one at `path`.
    ///
    /// # Errors
    /// As [`create`], also where something stands at `path` that may not be replaced.
    pub fn create(path: &Path) -> io::Result<(Self, File)> {
        let is_there = path.symlink_metadata().is_ok();
        let beside = if path == Path::new("/dev/stdout") || is_held(path) {
            None
        } else {
            is_there
                .then(|| writable(path, OFlags::empty()))
                .transpose()?;
            Some(path.with_added_extension("tmp"))
        };
        let file = create(beside.as_deref().unwrap_or(path))?;
        let path = path.to_owned();
        Ok((Self { path, beside }, file))
    }

    /// Writes a file that is there whole or not at all, whenever this process is killed.
    ///
    /// # Errors
    /// As [`create`](Self::create); nothing of it is left then.
    pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
        let (draft, mut file) = Self::create(path)?;
        file.write_all(bytes.as_ref())?;
        draft.place()
    }

    /// Puts it into its place.
    ///
    /// # Errors
    /// The system's; the draft is removed then.
    pub fn place(mut self) -> io::Result<()> {
        if let Some(beside) = &self.beside {
            std::fs::rename(beside, &self.path)?;
            self.beside = None;
        }
        Ok(())
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if let Some(beside) = &self.beside {
            let _ = std::fs::remove_file(beside);
        }
    }
}

/// Longest line that is taken from a program or a person; bytes.
pub const LONGEST_LINE: usize = 64 << 10;

/// The lines of a text that somebody else writes, until it ends; an error where it cannot be read. Of a line longer than [`LONGEST_LINE`] the beginning
/// comes as soon as it is there, and the rest is skipped: a line without an end costs no memory.
pub fn lines(mut text: impl BufRead) -> impl Iterator<Item = io::Result<String>> {
    let mut was_cut = false;
    let mut next = move || -> io::Result<Option<String>> {
        if was_cut {
            text.skip_until(b'\n')?;
        }
        let mut line = Vec::new();
        let mut beginning = text.by_ref().take(LONGEST_LINE as u64 + 1);
        if beginning.read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        was_cut = line.len() > LONGEST_LINE && !line.ends_with(b"\n");
        line.truncate(LONGEST_LINE);
        let words = String::from_utf8_lossy(&line).trim_end().to_owned();
        let mark = if was_cut { " … (cut at 64 KiB)" } else { "" };
        Ok(Some(words + mark))
    };
    std::iter::from_fn(move || next().transpose())
}

/// Whether a path names a descriptor of this process.
fn is_held(path: &Path) -> bool {
    ["/dev/fd", "/proc/self/fd"]
        .iter()
        .any(|folder| path.parent() == Some(Path::new(folder)))
        || path == Path::new("/dev/stdin")
}

fn irregular(kind: &str) -> io::Error {
    let sentence = format!("it is {kind}, not a regular file");
    io::Error::new(io::ErrorKind::InvalidInput, sentence)
}

fn words(kind: FileType) -> &'static str {
    match kind {
        FileType::Fifo => "a named pipe",
        FileType::Socket => "a socket",
        FileType::CharacterDevice | FileType::BlockDevice => "a device",
        _ => "something else",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, mknodat};

    #[test]
    fn a_line_without_an_end_is_cut_and_the_next_one_is_whole() {
        let long = "x".repeat(LONGEST_LINE);
        let text = format!("first\r\n{long}\n{long}yy{long}\n\nlast");
        let found: Vec<_> = lines(io::Cursor::new(text)).map(Result::unwrap).collect();
        let cut = format!("{long} … (cut at 64 KiB)");
        assert_eq!(found, ["first", &long, &cut, "", "last"]);
        let mut endless = lines(io::BufReader::new(io::repeat(b'x')));
        assert_eq!(endless.next().unwrap().unwrap(), cut);
        let folder = File::open("/").unwrap();
        let unread = lines(io::BufReader::new(folder)).next().unwrap();
        assert_eq!(unread.unwrap_err().kind(), io::ErrorKind::IsADirectory);
    }

    /// A file, a named pipe, and a link to one of them.
    fn folder_with_link_to(target: &str) -> (tempfile::TempDir, [PathBuf; 3]) {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["file", "pipe", "link"].map(|name| folder.path().join(name));
        let [file, pipe, link] = &paths;
        std::fs::write(file, "text").unwrap();
        mknodat(CWD, pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        std::os::unix::fs::symlink(folder.path().join(target), link).unwrap();
        (folder, paths)
    }

    #[test]
    fn a_file_that_is_not_regular_is_refused_at_once_and_a_pipe_in_hand_is_read() {
        let (folder, [file, pipe, link]) = folder_with_link_to("pipe");
        assert_eq!(read_text(&file, LARGEST).unwrap(), "text");
        for path in [&pipe, &link] {
            let error = open(path).unwrap_err();
            assert!(
                error.kind() == io::ErrorKind::InvalidInput
                    && error.to_string().contains("a named pipe"),
                "{error}"
            );
        }
        assert!(
            open(Path::new("/dev/zero"))
                .unwrap_err()
                .to_string()
                .contains("a device")
        );
        assert_eq!(
            read(folder.path()).unwrap_err().kind(),
            io::ErrorKind::IsADirectory
        );
        assert_eq!(
            read(&folder.path().join("none")).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
        let (end, mut begin) = std::io::pipe().unwrap();
        let held = format!("/dev/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&end));
        let reader = std::thread::spawn(move || read_text(Path::new(&held), LARGEST));
        // It waits for what comes later.
        std::thread::sleep(std::time::Duration::from_millis(50));
        begin.write_all(b"come").unwrap();
        drop(begin);
        assert_eq!(reader.join().unwrap().unwrap(), "come");
    }

    #[test]
    fn a_file_without_an_end_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, [0; 100]).unwrap();
        assert_eq!(read_at_most(&path, 100).unwrap().len(), 100);
        let error = read_at_most(&path, 99).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::FileTooLarge);
    }

    #[test]
    fn nothing_is_written_behind_a_link_into_a_pipe_or_into_a_device() {
        let (_folder, [file, pipe, link]) = folder_with_link_to("file");
        write(&file, "a longer text").unwrap();
        write(&file, "text").unwrap();
        assert_eq!(read_text(&file, LARGEST).unwrap(), "text");
        let refused = |path: &Path| write(path, "x").unwrap_err().kind();
        for path in [&pipe, &link, Path::new("/dev/null")] {
            assert_eq!(refused(path), io::ErrorKind::InvalidInput, "{path:?}");
        }
        let _reader = open_at(&pipe, OFlags::RDONLY | OFlags::NONBLOCK, Mode::empty()).unwrap();
        assert_eq!(refused(&pipe), io::ErrorKind::InvalidInput);
        assert_eq!(read_text(&file, LARGEST).unwrap(), "text");
    }
}
