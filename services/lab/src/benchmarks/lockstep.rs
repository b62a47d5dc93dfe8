//! Ticks per second of a whole run in lockstep, of this program and another one in alternating runs.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde::Serialize;
use serde_json::Value;
use session::table::{number, table};
use session::{Failure, Observer, Progress, load};
use viz::digits;

use crate::folder::scratch;
use crate::text::quantile;

/// Runs of one program.
#[derive(Serialize)]
pub struct Speeds {
    /// The program.
    pub program: PathBuf,
    /// Its version, as it says.
    pub version: String,
    /// Ticks per second of each run, in the order of the runs.
    pub ticks_per_s: Vec<f64>,
}

/// Runs of this program, and of another one in alternation: a machine that is busy for a while slows both.
#[derive(Serialize)]
pub struct Lockstep {
    /// The scenario of each run.
    pub scenario: &'static str,
    /// This program.
    pub own: Speeds,
    /// The other one.
    pub other: Option<Speeds>,
    /// This program's speed over the other's, of each pair of neighbouring runs.
    pub ratios: Option<Vec<f64>>,
}

/// Runs the default scenario `runs` times with recording, each time beside a run of the program `against`.
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
    observer(Progress::Begin {
        title: scenario,
        length: u64::from(runs) * (1 + u64::from(other.is_some())),
        unit: "runs",
    });
    for round in 0..runs {
        let mut both: Vec<&mut Speeds> = [&mut own].into_iter().chain(&mut other).collect();
        if round % 2 == 1 {
            both.reverse();
        }
        for speeds in both {
            speeds.ticks_per_s.push(run(&speeds.program, scenario)?);
            observer(Progress::Step);
        }
    }
    observer(Progress::End);
    let ratios = other.as_ref().map(|other| {
        let pairs = own.ticks_per_s.iter().zip(&other.ticks_per_s);
        pairs.map(|(own, other)| own / other).collect()
    });
    Ok(Lockstep {
        scenario,
        own,
        other,
        ratios,
    })
}

/// Ticks per second of one run.
fn run(program: &Path, scenario: &str) -> Result<f64, Failure> {
    let mut folder = scratch()?;
    let out = folder.path().join("run");
    let text = output(
        Command::new(program)
            .args(["run", scenario, "--json", "--out"])
            .arg(out),
    );
    // The run got Ctrl-C as well, and says less.
    folder.check_signals()?;
    let text = text?;
    let summary: Value = serde_json::from_slice(&text).unwrap_or_default();
    let speed = summary["ticks_per_s"]
        .as_f64()
        .filter(|speed| speed.is_finite() && *speed > 0.0);
    speed.ok_or_else(|| {
        let program = program.display();
        Failure::Work(format!(
            "{program} gives no summary of its run: it is no armplane"
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
    let last = words.lines().last().unwrap_or_default();
    Err(Failure::Work(format!(
        "{program} failed ({}): {last}",
        output.status
    )))
}

impl fmt::Display for Lockstep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let quartiles =
            |values: &[f64]| [0.25, 0.5, 0.75].map(|share| quantile(values.iter().copied(), share));
        let mut rows = table(&[
            "ticks a second, recording on",
            "runs",
            "lower quartile",
            "median",
            "upper quartile",
        ]);
        for speeds in [&self.own].into_iter().chain(&self.other) {
            let program = speeds.program.display().to_string();
            rows.add_row(
                [program.into(), number(speeds.ticks_per_s.len())]
                    .into_iter()
                    .chain(
                        quartiles(&speeds.ticks_per_s).map(|speed| number(format!("{speed:.0}"))),
                    ),
            );
        }
        writeln!(f, "{rows}")?;
        let Some(ratios) = &self.ratios else {
            return Ok(());
        };
        let [low, median, high] = quartiles(ratios).map(digits);
        writeln!(
            f,
            "{}: this program makes {median} times the other's ticks (quartiles of the pairs: {low} to {high})",
            self.scenario
        )
    }
}
