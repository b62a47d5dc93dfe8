//! A soak as a picture: faults against time by process, one round closely, and the times until a fault is detected.

use shared_types::fault;
use shared_types::process::Program;
use viz::plot::{Axis, BLUE, Color, GREY, INK, Page, Panel, RED, Row, numbered};

use super::round::{Injected, Round};
use super::rounds::Soak;
use super::tally::Kind;

/// Faults against time in a row per process, with what the drives did; and one round of them closely.
pub fn picture(soak: &Soak) -> Page {
    let busiest = soak
        .rounds
        .iter()
        .filter(|round| round.end == "goal reached")
        .max_by_key(|round| round.injected.len());
    let closely = busiest
        .or(soak.rounds.first())
        .map(|round| Row::of(270.0, [one_round(soak, round)]));
    let detected: Vec<&Kind> = soak
        .kinds
        .iter()
        .filter(|kind| kind.detected_ms_p50.is_some())
        .collect();
    let detection = Row::of(90.0 + 13.0 * detected.len() as f64, [detection(&detected)]);
    let totals = &soak.totals;
    Page {
        title: "The soak".to_owned(),
        subtitle: format!(
            "{} faults in {:.0} s of real time at {} Hz, {} rounds: {} reached the goal, {} came to rest, {} ended by design, {} broke a guarantee",
            totals.planned,
            soak.rounds
                .iter()
                .map(|round| seconds(soak, round))
                .sum::<f64>(),
            soak.rate_hz,
            totals.rounds,
            totals.goal,
            totals.rest,
            totals.ended,
            totals.broken
        ),
        rows: [Row::of(270.0, [every_round(soak)])]
            .into_iter()
            .chain(closely)
            .chain([detection])
            .collect(),
        width: 1100.0,
        ..Page::default()
    }
}

/// Length of a round, s.
fn seconds(soak: &Soak, round: &Round) -> f64 {
    round.ticks as f64 / f64::from(soak.rate_hz)
}

/// The row of a fault: that of its process, its class a little apart, so that the later do not hide the earlier.
fn height(injected: &Injected) -> f64 {
    let row = Program::ALL
        .iter()
        .position(|program| program.name() == injected.process)
        .unwrap_or_default();
    row as f64 + 0.13 * (class_of(&injected.kind) as f64 - 2.0)
}

/// A row per process, and one for the drives.
fn rows() -> Axis {
    Axis::names(
        Program::ALL
            .iter()
            .map(|program| program.name().to_owned())
            .chain(["drives".to_owned()]),
    )
}

/// Every fault of all rounds, one after the other.
fn every_round(soak: &Soak) -> Panel {
    let (rate, drives) = (f64::from(soak.rate_hz), Program::ALL.len() as f64);
    let total: f64 = soak.rounds.iter().map(|round| seconds(soak, round)).sum();
    let mut panel = Panel::new(
        "every fault by process; below, when the drives stopped the arm or held it",
        Axis::named("time, s").within(0.0..total.max(1.0)),
        rows(),
    );
    for (class, color) in CLASSES.iter().zip(colors()) {
        panel.line(class, color, &[]);
    }
    let mut from = 0.0;
    for round in &soak.rounds {
        panel.line(
            "",
            Color { 3: 0.5, ..GREY },
            &[(from, -0.5), (from, drives + 0.5)],
        );
        for injected in &round.injected {
            panel.dots(
                colors()[class_of(&injected.kind)],
                2.0,
                &[(from + injected.at_s, height(injected))],
            );
        }
        for stop in &round.stops {
            let until = (stop.until as f64 / rate).max(stop.from as f64 / rate + 0.0005 * total);
            stroke(
                &mut panel,
                INK,
                from + stop.from as f64 / rate,
                from + until,
                drives,
            );
        }
        from += seconds(soak, round);
    }
    panel
}

/// One round closely: a stroke per fault while it lasts, or until its process was back.
fn one_round(soak: &Soak, round: &Round) -> Panel {
    let (rate, drives, seconds) = (
        f64::from(soak.rate_hz),
        Program::ALL.len() as f64,
        seconds(soak, round).max(1.0),
    );
    let title = format!(
        "round {} closely: how long each lasted; a dot where a process died",
        round.round
    );
    let mut panel = Panel::new(&title, Axis::named("time, s").within(0.0..seconds), rows());
    for injected in &round.injected {
        let (color, y) = (colors()[class_of(&injected.kind)], height(injected));
        let length_s = injected
            .recovered_ms
            .map_or(injected.length_s, |ms| ms * 1e-3);
        stroke(
            &mut panel,
            color,
            injected.at_s,
            (injected.at_s + length_s.max(0.001 * seconds)).min(seconds),
            y,
        );
        if injected.deaths > 0 {
            panel.dots(color, 2.6, &[(injected.at_s, y)]);
        }
    }
    for stop in &round.stops {
        let from = stop.from as f64 / rate;
        stroke(
            &mut panel,
            INK,
            from,
            (stop.until as f64 / rate).max(from + 0.001 * seconds),
            drives,
        );
    }
    panel
}

/// The times until faults of each kind are detected.
fn detection(detected: &[&Kind]) -> Panel {
    let mut panel = Panel::new(
        "time until a fault is detected, ms: median, and the largest",
        Axis::default().logarithmic().within(0.001..10_000.0),
        Axis::names(
            detected
                .iter()
                .map(|kind| format!("{} ({})", kind.kind, kind.times)),
        ),
    );
    for (row, kind) in detected.iter().enumerate() {
        let (half, most) = (
            kind.detected_ms_p50.unwrap_or_default(),
            kind.detected_ms_max.unwrap_or_default(),
        );
        let color = colors()[class_of(&kind.kind)];
        panel.line(
            "",
            Color { 3: 0.4, ..color },
            &[(half, row as f64), (most, row as f64)],
        );
        panel.dots(color, 3.0, &[(half, row as f64)]);
        panel.dots(color, 1.8, &[(most, row as f64)]);
    }
    panel
}

/// A line three times as thick as others.
fn stroke(panel: &mut Panel, color: Color, from: f64, to: f64, y: f64) {
    for place in [y - 0.05, y, y + 0.05] {
        panel.line("", color, &[(from, place), (to, place)]);
    }
}

/// Groups of faults, for their colours.
const CLASSES: [&str; 5] = [
    "deaths",
    "standing still",
    "messages",
    "sensors and drives",
    "clock, core, volume",
];

fn colors() -> [Color; 5] {
    [RED, numbered(4), BLUE, numbered(2), numbered(3)]
}

/// The class of an act, by its row in the table: the words of a fault's kind and way, or signals.
fn class_of(name: &str) -> usize {
    let (word, way) = name.split_once(' ').unwrap_or((name, ""));
    match word.parse::<fault::Kind>() {
        Ok(kind) if kind.ends_process(way.parse().ok()) => 0,
        Ok(kind) if kind.takes_down() => 1,
        Ok(kind) if kind.shapes_messages() || kind == fault::Kind::Cut => 2,
        Ok(kind) if kind.concerns_joint() => 3,
        Ok(_) => 4,
        Err(_) => usize::from(name.contains("SIGCONT")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_its_class() {
        let of = |kind: &str| CLASSES[class_of(kind)];
        assert_eq!(
            ["kill", "SIGKILL, and again", "hang for-ever", "SIGSTOP"].map(of),
            ["deaths"; 4]
        );
        assert_eq!(
            ["hang paused", "SIGSTOP, SIGCONT"].map(of),
            ["standing still"; 2]
        );
        assert_eq!(["drop", "corrupt nan"].map(of), ["messages"; 2]);
        assert_eq!(
            (of("drive lost"), of("clock jump")),
            ("sensors and drives", "clock, core, volume")
        );
        assert_eq!(
            (of("zombie"), of("page-out")),
            ("messages", "clock, core, volume")
        );
    }
}
