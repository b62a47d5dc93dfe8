//! A run's summary as text for people.

use std::fmt;
use std::path::Path;

use shared_types::summary::{ServoSummary, Summary};
use viz::RECORDING;
use viz::digits;

use crate::results::{SCENARIO, SUMMARY};
use crate::table::{count, number, table};

/// The errors, singularities, limits, times and faults of a run, the files in its folder, and at last its outcome.
#[derive(Debug)]
pub struct RunText<'a> {
    /// Of the run.
    pub summary: &'a Summary,
    /// With its results.
    pub folder: &'a Path,
}

impl fmt::Display for RunText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { summary, folder } = self;
        if let Some(from) = &summary.of.from {
            writeln!(f, "from       {from}")?;
        }
        // A run without a tick has no numbers.
        if summary.ticks > 0 {
            errors(f, summary)?;
            loads(f, summary)?;
            if let Some(servo) = &summary.servo {
                steered(f, servo)?;
            }
            times(f, summary)?;
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
    }
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
    rows.add_row([
        "orientation, °".into(),
        number(digits(task.orientation_max_deg)),
        number(digits(task.orthogonal_max_deg)),
        number(digits(task.final_orientation_deg)),
    ]);
    writeln!(f, "{rows}")?;
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

fn loads(f: &mut fmt::Formatter<'_>, summary: &Summary) -> fmt::Result {
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
    if joints.switches > 0 {
        writeln!(
            f,
            "switches   {} changes of mode; mode switches injected {} mJ",
            joints.switches,
            digits(joints.switch_energy_j * 1e3)
        )?;
    }
    Ok(())
}

fn times(f: &mut fmt::Formatter<'_>, summary: &Summary) -> fmt::Result {
    let simulated_s = summary.ticks as f64 / f64::from(summary.of.rate_hz.max(1));
    writeln!(
        f,
        "time       {} ticks at {} Hz in {:.2} s: {:.0} ticks/s, {:.1} × real time, {}",
        summary.ticks,
        summary.of.rate_hz,
        summary.pace.wall_s,
        summary.pace.ticks_per_s,
        simulated_s / summary.pace.wall_s.max(1e-9),
        summary.of.mode
    )?;
    if let Some(chain) = summary.latency_us.get("chain") {
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
    let counts = servo
        .refused
        .iter()
        .map(|(reason, count)| ("refused", count, reason));
    let stops = servo
        .stops
        .iter()
        .map(|(reason, count)| ("stopped", count, reason));
    for (event, count, reason) in counts.chain(stops) {
        writeln!(f, "{event}    {count} × {reason}")?;
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

fn files(f: &mut fmt::Formatter<'_>, summary: &Summary, folder: &Path) -> fmt::Result {
    if !summary.recorder.error.is_empty() {
        writeln!(f, "recording  {}", summary.recorder.error)?;
    }
    writeln!(f, "{}", folder.display())?;
    if folder.join(SUMMARY).exists() {
        writeln!(f, "  {SUMMARY:<13}  all numbers, for programs")?;
    }
    let drawn = folder.join(RECORDING);
    if let Ok(file) = std::fs::metadata(&drawn) {
        let (megabytes, folder) = (file.len() as f64 / 1e6, folder.display());
        writeln!(
            f,
            "  {RECORDING:<13}  {megabytes:.1} MB; open it with `armplane view {folder}`"
        )?;
    }
    if summary.recorder.bytes > 0 {
        let (messages, megabytes) = (recorder::MESSAGES, summary.recorder.bytes as f64 / 1e6);
        writeln!(
            f,
            "  {messages}  {megabytes:.1} MB; compare with this build by `armplane replay {}`",
            folder.display()
        )?;
    }
    if summary.servo.is_some() {
        writeln!(
            f,
            "  {SCENARIO:<13}  and targets.csv: `armplane run` of it repeats the run"
        )?;
    }
    let (scenario, outcome) = (&summary.of.scenario, &summary.outcome);
    writeln!(f, "{scenario}: {outcome} — {}", summary.reason)
}
