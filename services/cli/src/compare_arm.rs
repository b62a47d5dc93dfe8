//! `armplane compare sweep --robot`: lines through exactly singular postures of one arm.

use std::path::Path;
use std::process::ExitCode;

use lab::studies::compare::{ArmLines, ArmSweep, Line, Outcome};
use serde_json::json;
use session::{Failure, Results};

use crate::out::say;
use crate::progress::Terminal;
use session::table::{number, table};
use viz::plot::digits;

/// Draws, runs and prints the lines of one arm; saves them with the scenarios of those that did not reach their goal.
pub(crate) fn compare_arm(sweep: &ArmSweep<'_>, out: Option<&Path>, as_json: bool) -> Result<ExitCode, Failure> {
    let terminal = Terminal::default();
    let lines = sweep.run(&|progress| terminal.show(progress))?;
    let results = Results::create(out, "compare")?;
    let whole = json!({"version": env!("CARGO_PKG_VERSION"), "sweep": lines});
    results.save("compare.json", &whole)?;
    for (i, line) in lines.lines.iter().enumerate().filter(|(_, line)| line.outcome != Outcome::Reached) {
        std::fs::write(results.folder.join(format!("line-{}.toml", i + 1)), line.scenario_text()?).map_err(Failure::work)?;
    }
    if as_json {
        say!("{whole}");
    } else {
        print(&lines);
        say!("{}\n  compare.json, and a scenario for each line that did not reach its goal", results.folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

fn word(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Reached => "reached",
        Outcome::Refused => "refused",
        Outcome::Missed => "missed",
        Outcome::Silent => "SILENT",
    }
}

fn print(lines: &ArmLines) {
    say!(
        "{}: {} lines through exactly singular postures, {} m/s, {} (seed {})",
        lines.robot,
        lines.lines.len(),
        lines.speed_m_s,
        lines.law,
        lines.seed
    );
    let headings =
        ["line", "singular", "at its", "goal", "orthogonal, mm", "°", "along ζ, mm", "°", "speed", "torque step", "time", "plan, ms", "S2"];
    let mut rows = table(&headings);
    for (i, line) in lines.lines.iter().enumerate() {
        let of =
            |value: &dyn Fn(&lab::studies::compare::Score) -> String| number(line.score.as_ref().map_or_else(|| "–".to_owned(), value));
        rows.add_row([
            number(i + 1),
            line.singularities.clone().into(),
            line.place.into(),
            word(line.outcome).into(),
            of(&|score| digits(score.orthogonal_max_mm)),
            of(&|score| digits(score.orthogonal_max_deg)),
            of(&|score| digits(score.along_max_mm)),
            of(&|score| digits(score.along_max_deg)),
            of(&|score| format!("{:.0} %", score.speed_max_ratio * 100.0)),
            of(&|score| format!("{:.1} %", score.torque_step_max_ratio * 100.0)),
            of(&|score| format!("× {:.2}", score.time_stretch)),
            number(format!("{:.0}", line.planning_ms)),
            line.score.as_ref().map_or_else(String::new, lab::studies::compare::Score::success).into(),
        ]);
    }
    say!("{rows}");
    for (i, line) in lines.lines.iter().enumerate().filter(|(_, line)| line.outcome != Outcome::Reached) {
        say!("line {}, {}: {}", i + 1, word(line.outcome), line.reason);
    }
    let mut names: Vec<&str> = lines.lines.iter().map(|line| line.singularities.as_str()).collect();
    names.sort_unstable();
    names.dedup();
    let mut rows = table(&[
        "singular",
        "lines",
        "reached",
        "refused",
        "missed",
        "silent",
        "S2 %",
        "torque step, largest",
        "plan, median and largest, ms",
    ]);
    for name in names.iter().map(Some).chain([None]) {
        let of: Vec<&Line> = lines.lines.iter().filter(|line| name.is_none_or(|name| line.singularities == **name)).collect();
        let count = |outcome| number(of.iter().filter(|line| line.outcome == outcome).count());
        let scores = || of.iter().filter_map(|line| line.score.as_ref());
        let mut planning: Vec<f64> = of.iter().map(|line| line.planning_ms).collect();
        planning.sort_by(f64::total_cmp);
        let step = scores().map(|score| score.torque_step_max_ratio).fold(0.0, f64::max);
        rows.add_row([
            name.map_or("all", |name| *name).into(),
            number(of.len()),
            count(Outcome::Reached),
            count(Outcome::Refused),
            count(Outcome::Missed),
            count(Outcome::Silent),
            number(format!("{:.0}", 100.0 * scores().filter(|score| score.s2).count() as f64 / of.len() as f64)),
            number(format!("{:.1} %", step * 100.0)),
            number(format!("{:.0} {:.0}", planning[planning.len() / 2], planning[planning.len() - 1])),
        ]);
    }
    say!("{rows}");
}
