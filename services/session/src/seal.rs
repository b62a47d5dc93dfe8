//! The seal of the files that repeat a run: one that was damaged is named, not run.

use std::fmt::Write as _;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use crate::failure::Failure;

/// How the first line of a sealed scenario begins; name and checksum of each file follow.
const MARK: &str = "# Repeats a run of armplane; delete this line before an edit. Checksums:";

/// The line that seals a scenario: its own checksum, and those of the `others` that stand beside it and that it names.
pub(crate) fn line(scenario: &str, others: &[(&str, Vec<u8>)]) -> String {
    let mut line = format!("{MARK} {:016x}", xxh3_64(scenario.as_bytes()));
    for (name, bytes) in others {
        // Writing to a string does not fail.
        let _ = write!(line, " {name}={:016x}", xxh3_64(bytes));
    }
    line + "\n"
}

/// Checks a scenario that is sealed, and the files that its seal names; any other text passes.
///
/// # Errors
/// [`Failure::Input`] with the name of the file that is not what armplane wrote.
pub(crate) fn check(file: &str, text: &str, folder: &Path) -> Result<(), Failure> {
    let changed = |name: &str| {
        Failure::Input(format!(
            "{name} has changed since the run: to run it as it is now, delete the first line of {file}"
        ))
    };
    let Some(rest) = text.strip_prefix(MARK) else {
        return match is_damaged(text.lines().next().unwrap_or_default()) {
            true => Err(changed(file)),
            false => Ok(()),
        };
    };
    let (sums, scenario) = rest.split_once('\n').unwrap_or((rest, ""));
    let mut sums = sums.split_whitespace();
    let is = |sum: Option<&str>, bytes: &[u8]| sum == Some(&format!("{:016x}", xxh3_64(bytes)));
    if !is(sums.next(), scenario.as_bytes()) {
        return Err(changed(file));
    }
    for pair in sums {
        let (name, sum) = pair.split_once('=').unwrap_or((pair, ""));
        let path = folder.join(name);
        if !is(Some(sum), files::read(&path).unwrap_or_default().as_slice()) {
            return Err(changed(&path.display().to_string()));
        }
    }
    Ok(())
}

/// Whether a first line was a seal before it was damaged: it still has more than a third of the words of [`MARK`].
fn is_damaged(line: &str) -> bool {
    let is_left = |word: &&str| line.split_whitespace().any(|one| one == *word);
    let words = MARK.split_whitespace();
    3 * words.clone().filter(is_left).count() > words.count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_of_every_file_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let (scenario, robot) = ("name = \"mine\"\n", b"<robot/>".to_vec());
        let path = folder.path().join("robot.urdf");
        std::fs::write(&path, &robot).unwrap();
        let text = line(scenario, &[("robot.urdf", robot.clone())]) + scenario;
        let check = |text: &str| check("scenario.toml", text, folder.path());
        assert!(check(&text).is_ok() && check(scenario).is_ok());
        for at in 0..text.len() {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1;
            assert!(
                check(&String::from_utf8(bytes).unwrap()).is_err(),
                "byte {at}"
            );
        }
        for cut in 1..MARK.len() / 2 {
            assert!(check(&text[cut..]).is_err(), "without {cut} bytes");
        }
        std::fs::write(&path, b"<robots/>").unwrap();
        assert!(check(&text).is_err());
        std::fs::remove_file(&path).unwrap();
        assert!(check(&text).is_err());
    }
}
