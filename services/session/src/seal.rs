//! The seal of the files that repeat a run: armplane refuses to run a damaged file, and names it.

use std::fmt::Write as _;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use crate::failure::Failure;

/// Start of a sealed scenario's first line, before name and checksum of each file. The whole line
/// is TOML; a truncated one is an unknown key or invalid.
const MARK: &str =
    "checksums = \"This file repeats a run; delete this line before an edit. Checksums:";

/// The line that seals a scenario: a checksum of it and of the rest of the line, and those of the `others` that stand beside it and that it names.
pub(crate) fn line(scenario: &str, others: &[(String, Vec<u8>)]) -> String {
    let mut rest = String::new();
    for (name, bytes) in others {
        // Writing to a string does not fail.
        let _ = write!(rest, " {name}={:016x}", xxh3_64(bytes));
    }
    rest += "\"\n";
    let whole = xxh3_64((rest.clone() + scenario).as_bytes());
    format!("{MARK} {whole:016x}{rest}")
}

/// Checks a scenario that is sealed, and the files that its seal names; any other text passes. The text without the seal, on the same lines.
///
/// # Errors
/// [`Failure::Input`] with the name of the changed file.
pub(crate) fn open(file: &str, text: String, folder: &Path) -> Result<String, Failure> {
    let changed = |name: &str| {
        Failure::Input(format!(
            "{name} has changed since the run: to run it as it is now, delete the first line of {file}"
        ))
    };
    let (first, scenario) = text.split_once('\n').unwrap_or((&text, ""));
    let Some(sums) = first.strip_prefix(MARK) else {
        // A line that was a seal: TOML would take it for a comment.
        return match first.contains("delete this line before an edit") {
            true => Err(changed(file)),
            false => Ok(text),
        };
    };
    let pairs = sums.split([' ', '"']).filter_map(|sum| sum.split_once('='));
    let mut others = Vec::new();
    for (name, sum) in pairs {
        let path = folder.join(name);
        let bytes = files::read(&path).unwrap_or_default();
        if sum != format!("{:016x}", xxh3_64(&bytes)) {
            return Err(changed(&path.display().to_string()));
        }
        others.push((name.to_owned(), bytes));
    }
    if line(scenario, &others) + scenario != text {
        return Err(changed(file));
    }
    Ok(format!("\n{scenario}"))
}

/// Whether the text of a scenario is sealed.
pub(crate) fn is_sealed(text: &str) -> bool {
    text.starts_with(MARK)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::scenario::Scenario;

    #[test]
    fn every_flipped_bit_and_every_cut_through_the_first_line_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let (scenario, robot) = (
            "name = \"mine\"\nrobot = \"robot.urdf\"\nsettle_s = 1.0\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = 1.0\n",
            b"<robot/>".to_vec(),
        );
        let path = folder.path().join("robot.urdf");
        std::fs::write(&path, &robot).unwrap();
        let seal = line(scenario, &[("robot.urdf".to_owned(), robot.clone())]);
        let text = seal.clone() + scenario;
        let runs = |text: &[u8]| {
            let Ok(text) = String::from_utf8(text.to_vec()) else {
                return false;
            };
            let opened = open("scenario.toml", text, folder.path());
            opened.is_ok_and(|text| Scenario::parse("scenario.toml", &text, &[]).is_ok())
        };
        assert!(runs(text.as_bytes()) && runs(scenario.as_bytes()));
        assert!(runs(
            format!("# as in 0123456789abcdef\n{scenario}").as_bytes()
        ));
        for (at, bit) in (0..text.len()).flat_map(|at| (0..8).map(move |bit| (at, bit))) {
            let mut bytes = text.clone().into_bytes();
            bytes[at] ^= 1 << bit;
            assert!(!runs(&bytes), "byte {at}, bit {bit}");
        }
        // Without the whole line it runs.
        let whole = [seal.len() - 1, seal.len()];
        for from in 0..seal.len() {
            for to in (from + 1..=text.len()).filter(|to| from > 0 || !whole.contains(to)) {
                let cut = [&text[..from], &text[to..]].concat();
                assert!(!runs(cut.as_bytes()), "without bytes {from}..{to}");
            }
        }
        assert!(!runs(text.replace('\n', "\r\n").as_bytes()));
        assert!(!runs(format!("\n{text}").as_bytes()));
        std::fs::write(&path, b"<robots/>").unwrap();
        assert!(!runs(text.as_bytes()));
        std::fs::remove_file(&path).unwrap();
        assert!(!runs(text.as_bytes()));
    }
}
