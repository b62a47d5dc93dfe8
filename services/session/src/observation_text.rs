//! A running graph in words.

use crate::observation::{Observation, ObservedFault, ObservedProcess, Times};
use crate::table::{Cell, Color, count, number, table};

const BOLD: u8 = 1;
const RED: u8 = 31;
const YELLOW: u8 = 33;
const MAGENTA: u8 = 35;

/// The text, in a colour if a condition holds.
fn painted(is_coloured: bool, colour: u8, text: &str) -> String {
    match is_coloured {
        true => format!("\x1b[{colour}m{text}\x1b[0m"),
        false => text.to_owned(),
    }
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

/// The table of the processes in so many columns of a terminal, and the headings of what has no room.
fn processes(run: &Observation, is_coloured: bool, columns: usize) -> (Vec<String>, Vec<String>) {
    let mut rows = table(&[
        "process", "state", "start", "tick", "ticks/s", "step µs", "age µs", "missed", "lost",
        "pid", "core",
    ]);
    let counted = |count: u64, colour: Color| match count {
        0 => number(0),
        _ => number(count).fg(colour),
    };
    for one in &run.processes {
        let state = match one.state {
            "running" => Color::Green,
            "gone" | "stopped" | "absent" => Color::Red,
            _ => Color::Yellow,
        };
        let age = match one.age_us.in_all {
            0 => String::new(),
            _ => one.age_us.p99.map_or("–".to_owned(), short),
        };
        rows.add_row([
            one.name.as_str().into(),
            Cell::new(one.state).fg(state),
            number(one.starts),
            number(one.ticks),
            number(format!("{:.0}", one.ticks_per_s)),
            number(in_words(&one.step_us)),
            number(age),
            counted(one.missed, Color::Yellow),
            counted(one.counts.lost, Color::Red),
            number(one.pid),
            number(one.core.map_or("any".to_owned(), |core| core.to_string())),
        ]);
    }
    rows.lines(columns, is_coloured)
}

/// The last faults, as many as there is room for.
fn faults(
    run: &Observation,
    is_coloured: bool,
    room: usize,
    fitted: &dyn Fn(&str) -> String,
) -> Vec<String> {
    let (hidden, shown) = run.faults.split_at(run.faults.len().saturating_sub(room));
    let active = hidden.iter().filter(|fault| fault.active).count();
    let earlier = format!(
        "{}, {active} of them active",
        count(hidden.len() as u64, "earlier fault")
    );
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
        painted(is_coloured && *active, RED, &fitted(&text))
    };
    let earlier = (!hidden.is_empty()).then_some(earlier);
    earlier.into_iter().chain(shown.iter().map(line)).collect()
}

/// A running graph in lines that fit a terminal of so many columns and rows, for up to eight processes, four singularities and five faults.
pub fn observation_lines(
    run: &Observation,
    is_coloured: bool,
    (columns, rows): (usize, usize),
) -> Vec<String> {
    // On a screen no line may be longer; a pipe takes all.
    let fitted = |line: &str| match line.char_indices().nth(columns - 1) {
        Some((at, last)) if rows < usize::MAX && line.len() > at + last.len_utf8() => {
            format!("{}…", &line[..at])
        }
        _ => line.to_owned(),
    };
    let title = format!("{}, {} Hz: {}", run.mode, run.rate_hz, run.title);
    let mut lines = vec![painted(is_coloured, BOLD, &fitted(&title))];
    let (table, hidden) = processes(run, is_coloured, columns);
    lines.extend(table);
    lines.push("step: p50/p99/longest; age: since the tick's sample, p99".to_owned());
    let refusals = run.processes.iter().filter_map(|one| {
        let count = one.counts.not_finite + one.counts.fenced;
        (count > 0).then(|| format!("{} {count}", one.name))
    });
    let refusals: Vec<_> = refusals.collect();
    if !refusals.is_empty() {
        let text = format!("outputs refused: {}", refusals.join(", "));
        lines.push(painted(is_coloured, YELLOW, &text));
    }
    let stale = match run.stale_ticks {
        0 => String::new(),
        ticks => format!(", no fresh torque for {}", count(ticks, "tick")),
    };
    let drive = painted(is_coloured && run.drive != "active", RED, run.drive);
    // Of the process that makes the ticks; the others count none.
    let counts = |one: &ObservedProcess| [one.counts.in_time, one.counts.late, one.counts.none];
    let of = run.processes.iter().map(counts);
    let [in_time, late, none] = of.fold([0; 3], |all, one| [0, 1, 2].map(|i| all[i] + one[i]));
    lines.push(format!(
        "torque in time {in_time}, late {late}, none {none}"
    ));
    lines.push(format!("drive {drive}{stale}; task {}", run.phase));
    lines.extend(run.singularities.iter().map(|one| {
        let place = if one.inside { "inside " } else { "outside" };
        let text = format!(
            "  {:<10} s = {:+.4}  {place}  {}, {}",
            one.name, one.s, one.class, one.mode
        );
        painted(is_coloured && one.inside, MAGENTA, &text)
    }));
    let room = rows.saturating_sub(lines.len() + 2).max(1);
    lines.extend(faults(run, is_coloured, room, &fitted));
    let quits = (rows < usize::MAX).then(|| "q quits".to_owned());
    let more = (!hidden.is_empty()).then(|| format!("--json has {}", hidden.join(", ")));
    let keys: Vec<_> = quits.into_iter().chain(more).collect();
    lines.extend((!keys.is_empty()).then(|| fitted(&keys.join("; "))));
    lines
}
