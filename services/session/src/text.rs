//! A run's summary as text for people.

use std::fmt;
use std::path::Path;

use shared_types::summary::{ForceSummary, ServoSummary, Summary};
use viz::RECORDING;
use viz::digits;

use crate::results::{SCENARIO, SUMMARY};

/// Columns of the table of errors at most.
const WIDTH: usize = 80;

use crate::table::{count, number, size, table};

/// The outcome of a run and its cause, and further causes in a line each.
pub fn verdict(summary: &Summary) -> String {
    let (scenario, outcome) = (&summary.of.scenario, &summary.outcome);
    let causes = summary.reason.replace("; ", "\n  also     ");
    format!("{scenario}: {outcome} — {causes}")
}

/// The errors, singularities, limits, times and faults of a run, and its folder; [`verdict`] follows. `is_long`: also what few people look for, switches
/// and latency.
pub fn run_text(summary: &Summary, folder: &Path, is_long: bool) -> impl fmt::Display {
    fmt::from_fn(move |f| {
        if let Some(from) = &summary.of.from {
            writeln!(f, "from       {from}")?;
        }
        // A run that ended before its first answer has no numbers.
        if summary.ticks > 1 {
            errors(f, summary)?;
            loads(f, summary, is_long)?;
            if let Some(force) = &summary.task.force {
                pressed(f, force)?;
            }
            if let Some(servo) = &summary.servo {
                steered(f, servo)?;
            }
            times(f, summary, is_long)?;
            faults(f, summary)?;
        }
        let processes = summary.processes.iter();
        for process in processes.filter(|process| process.lines_dropped > 0) {
            let (name, lines) = (&process.name, process.lines_dropped);
            writeln!(
                f,
                "dropped    {} of {name}: too fast, or not read",
                count(lines, "line")
            )?;
        }
        files(f, summary, folder)
    })
}

fn errors(f: &mut fmt::Formatter<'_>, summary: &Summary) -> fmt::Result {
    let mut rows = table(&["task", "largest", "orthogonal to ζ", "at the end"]);
    let task = &summary.task;
    rows.add_row([
        "position, mm".into(),
        number(digits(task.position_max_mm)),
        number(digits(task.orthogonal_max_mm)),
        number(digits(task.final_position_mm)),
    ]);
    // Exactly zero is the error of axes that the task does not count.
    let turned = [
        task.orientation_max_deg,
        task.orthogonal_max_deg,
        task.final_orientation_deg,
    ];
    if turned != [0.0; 3] {
        let [largest, orthogonal, at_end] = turned.map(|deg| number(digits(deg)));
        rows.add_row(["orientation, °".into(), largest, orthogonal, at_end]);
    }
    // Without rules: the results are to fit a small terminal together with the verdict.
    rows.lines(WIDTH, false)
        .0
        .iter()
        .try_for_each(|row| writeln!(f, "{row}"))?;
    let entered = summary.singularities.iter();
    for singularity in entered.filter(|one| one.inside_ticks > 0) {
        writeln!(
            f,
            "{:<10} {}, min |s| {}, inside for {}",
            singularity.name,
            singularity.class,
            digits(singularity.s_min),
            count(singularity.inside_ticks, "tick")
        )?;
    }
    Ok(())
}

fn loads(f: &mut fmt::Formatter<'_>, summary: &Summary, is_long: bool) -> fmt::Result {
    let percent = |ratio: f64| format!("{:.0} %", ratio * 100.0);
    let joints = &summary.joints;
    let torque = match joints.has_torque_limit {
        true => {
            let commanded = if joints.torque_commanded_max_ratio > 1.0 + 1e-9 {
                format!(
                    " (commanded {:.3e} times it)",
                    joints.torque_commanded_max_ratio
                )
            } else {
                String::new()
            };
            format!(
                "torque {} of the limit{commanded}, largest step in one tick {}",
                percent(joints.torque_max_ratio),
                percent(joints.torque_step_max_ratio.min(9.99))
            )
        }
        false => "torque without a limit".to_owned(),
    };
    let speed = match joints.has_speed_limit {
        true => format!("speed {} of the limit", percent(joints.speed_max_ratio)),
        false => "speed without a limit".to_owned(),
    };
    writeln!(f, "joints     {torque}; {speed}")?;
    if is_long && joints.switches > 0 {
        writeln!(
            f,
            "switches   {} changes of mode; mode switches injected {} mJ",
            joints.switches,
            digits(joints.switch_energy_j * 1e3)
        )?;
    }
    Ok(())
}

fn times(f: &mut fmt::Formatter<'_>, summary: &Summary, is_long: bool) -> fmt::Result {
    let rate_hz = f64::from(summary.of.rate_hz.max(1));
    writeln!(
        f,
        "time       {} ticks at {} Hz in {:.2} s: {:.0} ticks/s, {:.1} × real time, {}",
        summary.ticks,
        summary.of.rate_hz,
        summary.pace.wall_s,
        summary.pace.ticks_per_s,
        summary.pace.ticks_per_s / rate_hz,
        summary.of.mode
    )?;
    if let Some(stretch) = summary.task.slowed() {
        writeln!(
            f,
            "slowed     {stretch:.2} × the planned time: the path waited for the arm"
        )?;
    }
    if let Some(chain) = summary.latency_us.get("chain").filter(|_| is_long) {
        writeln!(
            f,
            "latency    chain, sensor sent to torque received: p50 {:.1} µs, p99 {:.1}, p99.9 {:.1}, max {:.1}",
            chain.p50, chain.p99, chain.p999, chain.max
        )?;
    }
    let Some(deadlines) = &summary.deadlines else {
        return Ok(());
    };
    writeln!(
        f,
        "deadlines  {} of {} ticks had torque in time, {} late, {} none",
        deadlines.in_time, deadlines.total, deadlines.late, deadlines.none
    )
}

fn faults(f: &mut fmt::Formatter<'_>, summary: &Summary) -> fmt::Result {
    if !summary.not_finite.is_empty() {
        writeln!(f, "not finite {}", summary.not_finite.join(", "))?;
    }
    let faults = summary.faults.iter();
    for fault in faults.filter(|fault| fault.detail != summary.reason) {
        let ms = |event: &str, ms: Option<f64>| {
            ms.map(|ms| format!(", {event} after {ms:.2} ms"))
                .unwrap_or_default()
        };
        let course = if fault.occurred {
            ms("detected", fault.detected_ms) + &ms("recovered", fault.recovered_ms)
        } else {
            ", did not take effect".into()
        };
        writeln!(f, "fault      {} ({}){course}", fault.detail, fault.origin)?;
    }
    Ok(())
}

fn pressed(f: &mut fmt::Formatter<'_>, force: &ForceSummary) -> fmt::Result {
    writeln!(
        f,
        "force      {} N by {}: off by {} N in the root mean square, {} at most; impact {} N; {} without contact",
        digits(force.newtons),
        force.source,
        digits(force.rms_n),
        digits(force.error_max_n),
        digits(force.impact_max_n),
        count(force.lift_off_ticks, "tick")
    )?;
    if let (Some(rms), Some(most)) = (force.moment_rms_nm, force.moment_max_nm) {
        let (rms, most) = (digits(rms), digits(most));
        writeln!(
            f,
            "moments    off by {rms} N·m in the root mean square, {most} at most"
        )?;
    }
    Ok(())
}

/// The longest of the stated reasons first.
fn steered(f: &mut fmt::Formatter<'_>, servo: &ServoSummary) -> fmt::Result {
    let mut seconds: Vec<_> = servo.seconds.iter().collect();
    seconds.sort_by(|a, b| b.1.total_cmp(a.1));
    for (i, (reason, seconds)) in seconds.into_iter().enumerate() {
        writeln!(
            f,
            "{}{seconds:7.2} s  {reason}",
            if i == 0 { "session    " } else { "           " }
        )?;
    }
    for (event, counts) in [("refused", &servo.refused), ("stopped", &servo.stops)] {
        for (reason, count) in counts {
            writeln!(f, "{event}    {count} × {reason}")?;
        }
    }
    if servo.after_end > 0 {
        writeln!(
            f,
            "ignored    {} after the `end` of the session",
            count(servo.after_end, "target")
        )?;
    }
    Ok(())
}

/// A folder as one writes it here: relative where it is below.
pub(crate) fn from_here(folder: &Path) -> &Path {
    let here = std::env::current_dir().unwrap_or_default();
    match folder.strip_prefix(here) {
        Ok(below) if below.as_os_str().is_empty() => Path::new("."),
        below => below.unwrap_or(folder),
    }
}

fn files(f: &mut fmt::Formatter<'_>, summary: &Summary, folder: &Path) -> fmt::Result {
    if !summary.recorder.error.is_empty() {
        writeln!(f, "recording  {}", summary.recorder.error)?;
    }
    let of = |name: &str| {
        let file = std::fs::metadata(folder.join(name)).ok()?;
        Some(format!("{name} {}", size(file.len())))
    };
    let files = [SUMMARY, RECORDING, recorder::MESSAGES]
        .into_iter()
        .filter_map(of);
    let files = files.collect::<Vec<_>>().join(", ");
    let folder = from_here(folder).display();
    writeln!(f, "files      {folder}: {files}")?;
    if summary.recorder.bytes > 0 {
        writeln!(
            f,
            "next       `armplane view {folder}`, or report, export, replay"
        )?;
    }
    if summary.servo.is_some() {
        writeln!(f, "again      `armplane run {folder}/{SCENARIO}`")?;
    }
    Ok(())
}
