//! A running graph in words.

use crate::observation::{Observation, ObservedFault, ObservedProcess, ObservedSingularity, Times};

/// Colours, where they are wanted.
#[derive(Clone, Copy)]
struct Paint(bool);

impl Paint {
    const BOLD: u8 = 1;
    const RED: u8 = 31;
    const GREEN: u8 = 32;
    const YELLOW: u8 = 33;
    const MAGENTA: u8 = 35;

    fn of(self, colour: u8, text: &str) -> String {
        if self.0 {
            format!("\x1b[{colour}m{text}\x1b[0m")
        } else {
            text.to_owned()
        }
    }

    /// Where something is so.
    fn when(self, so: bool, colour: u8, text: &str) -> String {
        if so {
            self.of(colour, text)
        } else {
            text.to_owned()
        }
    }
}

/// Text in a column of that width, at least one space before it.
fn right(text: impl ToString, width: usize) -> String {
    format!(" {:>1$}", text.to_string(), width - 1)
}

/// Text in a column of that width, one space behind it; cut where it is longer.
fn left(text: &str, width: usize) -> String {
    format!(
        "{:<1$} ",
        text.chars().take(width - 1).collect::<String>(),
        width - 1
    )
}

/// A time in µs, in at most five characters up to ten seconds: thousands as `12k`, tenths below ten.
fn short(time: f64) -> String {
    match time {
        9_999.5.. => format!("{:.0}k", time / 1e3),
        9.95.. => format!("{time:.0}"),
        _ => format!("{time:.1}"),
    }
}

/// "p50/p99/longest" in µs; empty for a process that computes nothing.
fn in_words(times: &Times) -> String {
    let part = |time: Option<f64>| time.map_or("–".to_owned(), short);
    if times.in_all == 0 {
        String::new()
    } else {
        format!(
            "{}/{}/{}",
            part(times.p50),
            part(times.p99),
            short(times.max)
        )
    }
}

/// A running graph in lines that fit a terminal of so many columns and rows: 80 and 24 for up to eight processes, four singularities and five faults.
#[must_use]
pub fn observation_lines(
    run: &Observation,
    is_coloured: bool,
    (columns, rows): (usize, usize),
) -> Vec<String> {
    let paint = Paint(is_coloured);
    let is_wide = columns >= 96;
    let mut lines = vec![paint.of(
        Paint::BOLD,
        &format!("{}: {}, {} Hz", run.run, run.mode, run.rate_hz),
    )];
    let headings = [
        ("start", 6),
        ("tick", 9),
        ("ticks/s", 8),
        ("step µs", 17),
        ("age µs", 7),
        ("missed", 7),
        ("lost", 5),
    ];
    let more = if is_wide {
        format!("{}{}", right("pid", 9), right("core", 6))
    } else {
        String::new()
    };
    let heading = headings
        .iter()
        .map(|(name, width)| right(name, *width))
        .collect::<String>();
    lines.push(paint.of(
        Paint::BOLD,
        &format!(
            "{}{}{heading}{more}",
            left("process", 11),
            left("state", 10)
        ),
    ));
    for ObservedProcess {
        name,
        state,
        pid,
        starts,
        core,
        ticks,
        ticks_per_s,
        missed,
        counts,
        step_us,
        age_us,
    } in &run.processes
    {
        let colour = match *state {
            "running" => Paint::GREEN,
            "gone" | "stopped" | "absent" => Paint::RED,
            _ => Paint::YELLOW,
        };
        let age = if age_us.in_all == 0 {
            String::new()
        } else {
            age_us.p99.map_or("–".to_owned(), short)
        };
        let numbers = [
            right(starts, 6),
            right(ticks, 9),
            right(format!("{ticks_per_s:.0}"), 8),
            right(in_words(step_us), 17),
            right(age, 7),
        ];
        let more = if is_wide {
            format!(
                "{}{}",
                right(pid, 9),
                right(core.map_or("any".to_owned(), |core| core.to_string()), 6)
            )
        } else {
            String::new()
        };
        let missed = paint.when(*missed > 0, Paint::YELLOW, &right(missed, 7));
        let lost = paint.when(counts.lost > 0, Paint::RED, &right(counts.lost, 5));
        lines.push(format!(
            "{}{}{}{missed}{lost}{more}",
            left(name, 11),
            paint.of(colour, &left(state, 10)),
            numbers.concat()
        ));
    }
    lines.push(
        "step: input to output, p50/p99/longest; age: since the tick's sample, p99".to_owned(),
    );
    let refused = run
        .processes
        .iter()
        .filter(|process| process.counts.not_finite + process.counts.fenced > 0);
    let refused: Vec<_> = refused
        .map(|one| format!("{} {}", one.name, one.counts.not_finite + one.counts.fenced))
        .collect();
    if !refused.is_empty() {
        lines.push(paint.of(
            Paint::YELLOW,
            &format!("outputs refused: {}", refused.join(", ")),
        ));
    }
    let stale = if run.stale_ticks > 0 {
        format!(", no fresh torque for {} ticks", run.stale_ticks)
    } else {
        String::new()
    };
    lines.push(format!(
        "drive {}{stale}; task {}",
        paint.when(run.drive != "active", Paint::RED, run.drive),
        run.phase
    ));
    for ObservedSingularity {
        name,
        s,
        inside,
        class,
        mode,
    } in &run.singularities
    {
        let text = format!(
            "  {}s = {s:+.4}  {}  {class}, {mode}",
            left(name, 11),
            if *inside { "inside " } else { "outside" }
        );
        lines.push(paint.when(*inside, Paint::MAGENTA, &text));
    }
    // The last ones, as many as there is room for.
    let room = rows.saturating_sub(lines.len() + 2).max(1);
    let hidden = run.faults.len().saturating_sub(room);
    if hidden > 0 {
        lines.push(format!(
            "{hidden} earlier faults, {} of them active",
            run.faults[..hidden]
                .iter()
                .filter(|fault| fault.active)
                .count()
        ));
    }
    for ObservedFault {
        process,
        kind,
        origin,
        tick,
        active,
    } in &run.faults[hidden..]
    {
        let text = format!(
            "fault {kind} of {process} from tick {tick}, {origin}, {}",
            if *active { "active" } else { "inactive" }
        );
        lines.push(paint.when(*active, Paint::RED, &text));
    }
    if rows < usize::MAX {
        lines.push("q quits".to_owned());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times() -> Times {
        Times {
            count: 500,
            p50: Some(123.4),
            p99: Some(39_223.3),
            p999: None,
            max: 124_911.6,
            in_all: 9,
        }
    }

    fn full() -> Observation {
        let process = |i: usize| ObservedProcess {
            name: format!("a-process-of-mine-{i}"),
            state: "connected",
            pid: 4_194_304,
            starts: 12,
            core: Some(1),
            ticks: 12_345_678,
            ticks_per_s: 16_123.4,
            missed: 4321,
            counts: Default::default(),
            step_us: times(),
            age_us: times(),
        };
        let singularity = |name: &str| ObservedSingularity {
            name: name.to_owned(),
            s: -0.1234,
            inside: true,
            class: "type 2",
            mode: "reorient",
        };
        let fault = |tick: u64| ObservedFault {
            process: "controller".to_owned(),
            kind: "slow-disk",
            origin: "planned",
            tick,
            active: true,
        };
        Observation {
            run: "armplane-0-28845-364045-82d8".to_owned(),
            mode: "realtime",
            rate_hz: 1000,
            processes: (0..8).map(process).collect(),
            drive: "stopping",
            stale_ticks: 1234,
            phase: "running",
            singularities: ["elbow", "wrist", "overhead", "s4"].map(singularity).into(),
            faults: (0..9).map(|k| fault(100_000 * k)).collect(),
        }
    }

    #[test]
    fn a_full_graph_fits_the_smallest_terminal() {
        let lines = observation_lines(&full(), false, (80, 24));
        assert!(lines.len() <= 24, "{}", lines.len());
        assert!(
            lines.iter().all(|line| line.chars().count() <= 80),
            "{lines:#?}"
        );
        assert!(
            lines.iter().any(|line| line.contains("from tick 800000")),
            "the last fault is shown: {lines:#?}"
        );
        assert_eq!(lines.last().map(String::as_str), Some("q quits"));
    }

    #[test]
    fn colours_change_no_width() {
        let (plain, painted) = (
            observation_lines(&full(), false, (120, 24)),
            observation_lines(&full(), true, (120, 24)),
        );
        let stripped = painted.iter().map(|line| {
            let parts = line.split("\x1b[").enumerate();
            parts
                .map(|(i, part)| {
                    if i == 0 {
                        part
                    } else {
                        part.split_once('m').map_or("", |(_, rest)| rest)
                    }
                })
                .collect::<String>()
        });
        assert!(painted.iter().any(|line| line.contains("\x1b[31m")));
        assert_eq!(stripped.collect::<Vec<_>>(), plain);
    }
}
