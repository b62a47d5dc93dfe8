//! Ticks per second of a whole run in lockstep, of this program and another one in turns.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::{Value, json};
use session::table::{number, table};
use session::{Failure, Observer, Progress, load};
use viz::plot::digits;

use crate::folder::scratch;
use crate::quantile::quantile;

/// Runs of one program.
pub struct Speeds {
    /// The program.
    pub program: PathBuf,
    /// Its version, as it says.
    pub version: String,
    /// Ticks per second of each run, in the order of the runs.
    pub ticks_per_s: Vec<f64>,
}

/// Runs of this program, and of another one in turns with it: a machine that is busy for a while slows both.
pub struct Lockstep {
    /// The scenario of each run.
    pub scenario: &'static str,
    /// This program.
    pub own: Speeds,
    /// The other one.
    pub other: Option<Speeds>,
}

/// Runs the default scenario `runs` times with recording, each time followed by a run of the program `against`.
///
/// # Errors
/// [`Failure`] where a program does not start, or its run fails or gives no JSON.
pub fn lockstep(
    runs: u32,
    against: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Lockstep, Failure> {
    let scenario = load::DEFAULT_SCENARIO;
    let begin = |program: PathBuf| -> Result<Speeds, Failure> {
        let version = output(Command::new(&program).arg("--version"))?;
        Ok(Speeds {
            program,
            version: String::from_utf8_lossy(&version).trim().to_owned(),
            ticks_per_s: Vec::new(),
        })
    };
    let mut own = begin(std::env::current_exe().map_err(Failure::work)?)?;
    let mut other = against
        .map(|program| begin(program.to_owned()))
        .transpose()?;
    let programs = 1 + u64::from(other.is_some());
    observer(Progress::Begin {
        title: scenario,
        length: u64::from(runs) * programs,
        unit: "runs",
    });
    for round in 0..runs {
        let mut both: Vec<&mut Speeds> = [&mut own].into_iter().chain(&mut other).collect();
        if round % 2 == 1 {
            both.reverse();
        }
        for speeds in both {
            let speed = run(&speeds.program, scenario)?;
            speeds.ticks_per_s.push(speed);
            observer(Progress::Step);
        }
    }
    observer(Progress::End);
    Ok(Lockstep {
        scenario,
        own,
        other,
    })
}

/// Ticks per second of one run.
fn run(program: &Path, scenario: &str) -> Result<f64, Failure> {
    let folder = scratch()?;
    let text = output(
        Command::new(program)
            .args(["run", scenario, "--json", "--out"])
            .arg(folder.path().join("run")),
    )?;
    let summary: Value = serde_json::from_slice(&text).unwrap_or_default();
    let speed = summary["ticks_per_s"]
        .as_f64()
        .filter(|speed| speed.is_finite() && *speed > 0.0);
    speed.ok_or_else(|| {
        Failure::Work(format!(
            "{} gives no summary of its run: it is no armplane",
            program.display()
        ))
    })
}

fn output(command: &mut Command) -> Result<Vec<u8>, Failure> {
    let program = command.get_program().to_string_lossy().into_owned();
    let output = command.stdin(Stdio::null()).stderr(Stdio::piped()).output();
    let output =
        output.map_err(|error| Failure::Input(format!("cannot start {program}: {error}")))?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    let words = String::from_utf8_lossy(&output.stderr);
    Err(Failure::Work(format!(
        "{program} failed ({}): {}",
        output.status,
        words.lines().last().unwrap_or_default()
    )))
}

impl Lockstep {
    /// This program's speed over the other's, of each pair of neighbouring runs.
    fn ratios(&self) -> Option<Vec<f64>> {
        let other = self.other.as_ref()?;
        Some(
            self.own
                .ticks_per_s
                .iter()
                .zip(&other.ticks_per_s)
                .map(|(own, other)| own / other)
                .collect(),
        )
    }

    /// For machines.
    #[must_use]
    pub fn json(&self) -> Value {
        let of = |speeds: &Speeds| json!({"program": speeds.program, "version": speeds.version, "ticks_per_s": speeds.ticks_per_s});
        json!({"scenario": self.scenario, "own": of(&self.own), "other": self.other.as_ref().map(of), "ratios": self.ratios()})
    }
}

impl fmt::Display for Lockstep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows = table(&[
            "ticks a second, recording on",
            "runs",
            "lower quartile",
            "median",
            "upper quartile",
        ]);
        for speeds in [&self.own].into_iter().chain(&self.other) {
            let quartiles = [0.25, 0.5, 0.75].map(|share| {
                number(format!(
                    "{:.0}",
                    quantile(speeds.ticks_per_s.iter().copied(), share)
                ))
            });
            rows.add_row(
                [
                    speeds.program.display().to_string().into(),
                    number(speeds.ticks_per_s.len()),
                ]
                .into_iter()
                .chain(quartiles),
            );
        }
        writeln!(f, "{rows}")?;
        let Some(ratios) = self.ratios() else {
            return Ok(());
        };
        let [low, median, high] =
            [0.25, 0.5, 0.75].map(|share| digits(quantile(ratios.iter().copied(), share)));
        writeln!(
            f,
            "{}: this program makes {median} times the other's ticks (quartiles of the pairs: {low} to {high})",
            self.scenario
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_compared_one_by_one() {
        let speeds = |ticks_per_s: &[f64]| Speeds {
            program: "a".into(),
            version: String::new(),
            ticks_per_s: ticks_per_s.to_vec(),
        };
        // The machine was half as fast during the second pair.
        let measured = Lockstep {
            scenario: "x",
            own: speeds(&[40.0, 20.0, 40.0]),
            other: Some(speeds(&[20.0, 10.0, 20.0])),
        };
        assert_eq!(measured.ratios().unwrap(), [2.0; 3]);
        assert!(measured.to_string().contains("2.000 times"), "{measured}");
        assert_eq!(measured.json()["other"]["ticks_per_s"][1], 10.0);
    }
}
