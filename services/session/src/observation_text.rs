//! A running graph in words.

use runtime::Counts;

use crate::observation::{Observation, ObservedFault, ObservedProcess, Times};

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

    /// A condition, if it holds.
    fn when(self, so: bool, colour: u8, text: &str) -> String {
        if so {
            self.of(colour, text)
        } else {
            text.to_owned()
        }
    }
}

/// Text in a column of that width, at least one space before it.
fn right(text: &str, width: usize) -> String {
    format!(" {text:>0$}", width - 1)
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

/// Columns of words, before those of numbers; and columns for which 80 characters have room.
const WORDS: usize = 2;
const NARROW: usize = 9;

/// A process's cells: heading, width, text, and the text's colour.
fn cells(one: &ObservedProcess) -> [(&'static str, usize, String, Option<u8>); 11] {
    let state = match one.state {
        "running" => Paint::GREEN,
        "gone" | "stopped" | "absent" => Paint::RED,
        _ => Paint::YELLOW,
    };
    let age = match one.age_us.in_all {
        0 => String::new(),
        _ => one.age_us.p99.map_or("–".to_owned(), short),
    };
    let core = one.core.map_or("any".to_owned(), |core| core.to_string());
    let (missed, lost) = (one.missed, one.counts.lost);
    [
        ("process", 11, one.name.clone(), None),
        ("state", 10, one.state.to_owned(), Some(state)),
        ("start", 6, one.starts.to_string(), None),
        ("tick", 9, one.ticks.to_string(), None),
        ("ticks/s", 8, format!("{:.0}", one.ticks_per_s), None),
        ("step µs", 17, in_words(&one.step_us), None),
        ("age µs", 7, age, None),
        (
            "missed",
            7,
            missed.to_string(),
            (missed > 0).then_some(Paint::YELLOW),
        ),
        (
            "lost",
            5,
            lost.to_string(),
            (lost > 0).then_some(Paint::RED),
        ),
        ("pid", 9, one.pid.to_string(), None),
        ("core", 6, core, None),
    ]
}

/// The table of the processes, of which there is one at least.
fn processes(run: &Observation, paint: Paint, shown: usize) -> Vec<String> {
    let aligned = |place: usize, text: &str, width| match place < WORDS {
        true => left(text, width),
        false => right(text, width),
    };
    let mut lines = vec![String::new()];
    for one in &run.processes {
        let (mut heading, mut line) = (String::new(), String::new());
        for (place, (title, width, text, colour)) in cells(one).iter().take(shown).enumerate() {
            heading += &aligned(place, title, *width);
            let text = aligned(place, text, *width);
            line += &colour.map_or(text.clone(), |colour| paint.of(colour, &text));
        }
        lines[0] = paint.of(Paint::BOLD, &heading);
        lines.push(line);
    }
    lines
}

/// The last faults, as many as there is room for.
fn faults(run: &Observation, paint: Paint, room: usize) -> Vec<String> {
    let (hidden, shown) = run.faults.split_at(run.faults.len().saturating_sub(room));
    let active = hidden.iter().filter(|fault| fault.active).count();
    let earlier = format!("{} earlier faults, {active} of them active", hidden.len());
    let line = |fault: &ObservedFault| {
        let ObservedFault {
            process,
            kind,
            origin,
            tick,
            active,
        } = fault;
        let force = if *active { "active" } else { "inactive" };
        let text = format!("fault {kind} of {process} from tick {tick}, {origin}, {force}");
        paint.when(*active, Paint::RED, &text)
    };
    let earlier = (!hidden.is_empty()).then_some(earlier);
    earlier.into_iter().chain(shown.iter().map(line)).collect()
}

/// A running graph in lines that fit a terminal of so many columns and rows: 80 and 24 for up to eight processes, four singularities and five faults.
#[must_use]
pub fn observation_lines(
    run: &Observation,
    is_coloured: bool,
    (columns, rows): (usize, usize),
) -> Vec<String> {
    let paint = Paint(is_coloured);
    let title = format!("{}: {}, {} Hz", run.run, run.mode, run.rate_hz);
    let mut lines = vec![paint.of(Paint::BOLD, &title)];
    let shown = if columns >= 96 { usize::MAX } else { NARROW };
    lines.extend(processes(run, paint, shown));
    lines.push(
        "step: input to output, p50/p99/longest; age: since the tick's sample, p99".to_owned(),
    );
    let refusals = run.processes.iter().filter_map(|one| {
        let count = one.counts.not_finite + one.counts.fenced;
        (count > 0).then(|| format!("{} {count}", one.name))
    });
    let refusals: Vec<_> = refusals.collect();
    if !refusals.is_empty() {
        let text = format!("outputs refused: {}", refusals.join(", "));
        lines.push(paint.of(Paint::YELLOW, &text));
    }
    let stale = match run.stale_ticks {
        0 => String::new(),
        ticks => format!(", no fresh torque for {ticks} ticks"),
    };
    let drive = paint.when(run.drive != "active", Paint::RED, run.drive);
    // Of the process that makes the ticks; the others count none.
    let all = |count: fn(&Counts) -> u64| -> u64 {
        run.processes.iter().map(|one| count(&one.counts)).sum()
    };
    let torque = [
        all(|one| one.in_time),
        all(|one| one.late),
        all(|one| one.none),
    ];
    let [in_time, late, none] = torque;
    lines.push(format!(
        "torque in time {in_time}, late {late}, none {none}"
    ));
    lines.push(format!("drive {drive}{stale}; task {}", run.phase));
    lines.extend(run.singularities.iter().map(|one| {
        let place = if one.inside { "inside " } else { "outside" };
        let text = format!(
            "  {}s = {:+.4}  {place}  {}, {}",
            left(&one.name, 11),
            one.s,
            one.class,
            one.mode
        );
        paint.when(one.inside, Paint::MAGENTA, &text)
    }));
    let room = rows.saturating_sub(lines.len() + 2).max(1);
    lines.extend(faults(run, paint, room));
    if rows < usize::MAX {
        lines.push("q quits".to_owned());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::ObservedSingularity;

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
}
