//! The journal of a partition that is not complete: a line for each finished run, appended in one write.
//!
//! A kill between two writes loses nothing, a kill within one leaves a line without end or with a wrong check sum: it is cut off when the
//! journal is read, and that run is computed again.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use super::cell::Cell;

/// A journal that is open for appending.
#[derive(Debug)]
pub(super) struct Journal {
    file: File,
}

/// A finished run: its number and the cells after its keys.
pub(super) type Finished = (u64, Vec<Cell>);

impl Journal {
    /// Opens or makes a journal, and reads the runs in it.
    ///
    /// # Errors
    /// Where the file cannot be read or written.
    pub(super) fn open(path: &Path) -> io::Result<(Self, Vec<Finished>)> {
        let text = match files::read(path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(error),
        };
        let (mut finished, mut known, mut sound) = (Vec::<Finished>::new(), BTreeSet::new(), 0);
        for line in text.split_inclusive(|byte| *byte == b'\n') {
            let Some(run) = read(line) else { break };
            sound += line.len() as u64;
            if known.insert(run.0) {
                finished.push(run);
            }
        }
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        file.set_len(sound)?;
        Ok((Self { file }, finished))
    }

    /// Appends a finished run.
    ///
    /// # Errors
    /// Where it cannot be written.
    pub(super) fn append(&mut self, run: u64, cells: &[Cell]) -> io::Result<()> {
        let written: Vec<String> = cells.iter().map(Cell::write).collect();
        let content = serde_json::to_string(&(run, written))?;
        self.file
            .write_all(format!("{:016x} {content}\n", xxh3_64(content.as_bytes())).as_bytes())
    }
}

fn read(line: &[u8]) -> Option<Finished> {
    let (sum, content) = std::str::from_utf8(line)
        .ok()?
        .strip_suffix('\n')?
        .split_once(' ')?;
    if u64::from_str_radix(sum, 16).ok()? != xxh3_64(content.as_bytes()) {
        return None;
    }
    let (run, cells): (u64, Vec<String>) = serde_json::from_str(content).ok()?;
    Some((
        run,
        cells
            .iter()
            .map(|cell| Cell::read(cell))
            .collect::<Option<_>>()?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_half_line_of_a_kill_is_cut_off_and_everything_before_it_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let cells = |x: f64| {
            vec![
                Cell::Absent,
                Cell::Boolean(true),
                Cell::Whole(-3),
                Cell::Number(x),
                Cell::Text("ζ \"1\"\n2".to_owned()),
            ]
        };
        let runs: Vec<Finished> =
            vec![(4, cells(0.1)), (2, cells(f64::INFINITY)), (3, cells(-0.0))];
        let (mut journal, before) = Journal::open(&path).unwrap();
        assert!(before.is_empty());
        for (run, cells) in &runs {
            journal.append(*run, cells).unwrap();
        }
        let whole = std::fs::read(&path).unwrap();
        let last = whole[..whole.len() - 1]
            .iter()
            .rposition(|byte| *byte == b'\n')
            .unwrap()
            + 1;
        for cut in last..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let kept = if cut == whole.len() { 3 } else { 2 };
            let (mut journal, found) = Journal::open(&path).unwrap();
            assert_eq!(found, runs[..kept]);
            journal.append(9, &cells(1.0)).unwrap();
            assert_eq!(
                Journal::open(&path).unwrap().1.len(),
                kept + 1,
                "what is appended after the cut is read"
            );
        }
        let mut damaged = whole.clone();
        damaged[last + 20] ^= 1;
        std::fs::write(&path, &damaged).unwrap();
        assert_eq!(Journal::open(&path).unwrap().1, runs[..2]);
    }
}
