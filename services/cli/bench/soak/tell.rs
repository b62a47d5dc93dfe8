//! What the soak says: a table by kind, figures, and a picture.

use std::collections::BTreeMap;

use serde::Serialize;

use super::super::super::out::say;
use super::super::super::plot::{Axis, BLUE, Color, GREY, INK, Page, Panel, RED, Row, numbered};
use super::super::super::table::{digits, number, table};
use super::Soak;
use super::judge::Messages;
use super::round::{Round, Struck};

/// Everything of one kind, over all rounds and processes.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Kind {
    kind: String,
    times: u64,
    /// How many of them something noticed.
    noticed: u64,
    noticed_ms_p50: Option<f64>,
    noticed_ms_max: Option<f64>,
    /// Deaths that it cost, each followed by a restart or the end of the run.
    deaths: u64,
    mended_ms_p50: Option<f64>,
    mended_ms_max: Option<f64>,
    /// How often the drives had to stop the arm.
    stops: u64,
    stood_ms_p50: Option<f64>,
    stood_ms_max: Option<f64>,
    /// How the rounds ended in which it struck.
    goal: u64,
    rest: u64,
    ended: u64,
}

/// Over all rounds.
#[derive(Clone, Debug, Default, Serialize)]
pub(super) struct Totals {
    rounds: u64,
    broken: u64,
    goal: u64,
    rest: u64,
    ended: u64,
    ticks: u64,
    blows: u64,
    left_out: BTreeMap<&'static str, u64>,
    restarts: BTreeMap<String, u64>,
    messages: Messages,
    /// Losses over the deaths of the recorder: no other cause is allowed, and a recorder that falls behind shows here too.
    lost_per_death_of_recorder: f64,
    deadlines_missed: u64,
    deadlines_by_cause: BTreeMap<String, u64>,
    torque_max_ratio: f64,
    torque_step_max_ratio: f64,
    speed_max_ratio: f64,
    stale_ticks: u32,
    stood_s: f64,
}

fn p50(mut values: Vec<f64>) -> (Option<f64>, Option<f64>) {
    values.sort_by(f64::total_cmp);
    (values.get(values.len().saturating_sub(1) / 2).copied(), values.last().copied())
}

/// A row for each kind, in the order of their names, signals first.
pub(super) fn kinds(rounds: &[Round]) -> Vec<Kind> {
    let mut by_kind = BTreeMap::<&str, Vec<(&Round, &Struck)>>::new();
    for round in rounds {
        for struck in &round.struck {
            by_kind.entry(struck.kind.as_str()).or_default().push((round, struck));
        }
    }
    let row = |(kind, blows): (&str, Vec<(&Round, &Struck)>)| {
        let of = |value: fn(&Struck) -> Option<f64>| blows.iter().filter_map(|(_, struck)| value(struck)).collect::<Vec<_>>();
        let noticed = of(|struck| struck.noticed_ms);
        let stood = of(|struck| (struck.stood_ms > 0.0).then_some(struck.stood_ms));
        let ends = |end: &str| blows.iter().filter(|(round, _)| round.end == end).count() as u64;
        let count = (noticed.len() as u64, stood.len() as u64);
        let ((noticed_ms_p50, noticed_ms_max), (stood_ms_p50, stood_ms_max)) = (p50(noticed), p50(stood));
        let (mended_ms_p50, mended_ms_max) = p50(of(|struck| struck.mended_ms));
        Kind {
            kind: kind.to_owned(),
            times: blows.len() as u64,
            noticed: count.0,
            noticed_ms_p50,
            noticed_ms_max,
            deaths: blows.iter().map(|(_, struck)| u64::from(struck.deaths)).sum(),
            mended_ms_p50,
            mended_ms_max,
            stops: count.1,
            stood_ms_p50,
            stood_ms_max,
            goal: ends("goal reached"),
            rest: ends("rest"),
            ended: ends("ended") + ends("interrupted"),
        }
    };
    by_kind.into_iter().map(row).collect()
}

impl Totals {
    pub(super) fn of(rounds: &[Round]) -> Self {
        let mut totals = Self { rounds: rounds.len() as u64, ..Self::default() };
        for round in rounds {
            totals.broken += u64::from(!round.broken.is_empty());
            match round.end {
                "goal reached" => totals.goal += 1,
                "rest" => totals.rest += 1,
                _ => totals.ended += 1,
            }
            totals.ticks += round.ticks;
            totals.blows += round.struck.len() as u64;
            for (why, count) in &round.left_out {
                *totals.left_out.entry(why).or_default() += count;
            }
            for (process, restarts) in &round.restarts {
                *totals.restarts.entry(process.clone()).or_default() += u64::from(*restarts);
            }
            let (sum, one) = (&mut totals.messages, round.messages);
            for (sum, one) in [
                (&mut sum.sent, one.sent),
                (&mut sum.taken_in, one.taken_in),
                (&mut sum.refused, one.refused),
                (&mut sum.fenced, one.fenced),
                (&mut sum.lost, one.lost),
                (&mut sum.kept, one.kept),
            ] {
                *sum += one;
            }
            totals.deadlines_missed += round.deadlines.missed;
            for (cause, count) in &round.deadlines.by_cause {
                *totals.deadlines_by_cause.entry(cause.clone()).or_default() += count;
            }
            totals.torque_max_ratio = totals.torque_max_ratio.max(round.torque_max_ratio);
            totals.torque_step_max_ratio = totals.torque_step_max_ratio.max(round.torque_step_max_ratio);
            totals.speed_max_ratio = totals.speed_max_ratio.max(round.speed_max_ratio);
            totals.stale_ticks = totals.stale_ticks.max(round.stale_ticks);
            totals.stood_s += round.stops.iter().map(|stop| (stop.until - stop.from) as f64).sum::<f64>() / f64::from(round.rate_hz);
        }
        let deaths = totals.restarts.get("recorder").copied().unwrap_or_default();
        totals.lost_per_death_of_recorder = totals.messages.lost as f64 / deaths.max(1) as f64;
        totals
    }
}

impl Soak {
    /// Whether every promise was kept.
    pub(in super::super) fn has_passed(&self) -> bool {
        self.passed
    }

    /// The signal that ended it before its time.
    pub(in super::super) fn interrupted(&self) -> Option<&str> {
        self.interrupted.as_deref()
    }

    pub(in super::super) fn tell(&self) {
        let mut rows = table(&[
            "kind",
            "times",
            "noticed",
            "ms p50",
            "max",
            "deaths",
            "mended, ms p50",
            "max",
            "stops",
            "stood, ms p50",
            "max",
            "goal",
            "rest",
            "ended",
        ]);
        let optional = |value: Option<f64>| number(value.map_or(String::from("–"), digits));
        for kind in &self.kinds {
            rows.add_row([
                kind.kind.clone().into(),
                number(kind.times),
                number(kind.noticed),
                optional(kind.noticed_ms_p50),
                optional(kind.noticed_ms_max),
                number(kind.deaths),
                optional(kind.mended_ms_p50),
                optional(kind.mended_ms_max),
                number(kind.stops),
                optional(kind.stood_ms_p50),
                optional(kind.stood_ms_max),
                number(kind.goal),
                number(kind.rest),
                number(kind.ended),
            ]);
        }
        say!("{rows}");
        let all = &self.totals;
        say!(
            "rounds     {}: {} reached the goal, {} came to rest, {} ended by design; {:.0} s at {} Hz, seed {}",
            all.rounds,
            all.goal,
            all.rest,
            all.ended,
            all.ticks as f64 / f64::from(self.rate_hz),
            self.rate_hz,
            self.seed
        );
        let left_out = all.left_out.iter().map(|(why, count)| format!("{count} because {why}")).collect::<Vec<_>>().join(", ");
        say!("faults     {} struck{}", all.blows, if left_out.is_empty() { String::new() } else { format!("; left out {left_out}") });
        let restarts = all.restarts.iter().filter(|(_, count)| **count > 0).map(|(process, count)| format!("{process} {count}"));
        say!("restarts   {}", restarts.collect::<Vec<_>>().join(", "));
        let Messages { sent, taken_in, refused, fenced, lost, kept } = all.messages;
        say!("messages   {sent} sent, {taken_in} taken in by the recorder, {kept} read back from its files");
        say!(
            "           {refused} refused for a number that is not finite, {fenced} of a dead incarnation; {lost} lost, sent while the recorder was away or too far behind ({:.0} for each of its deaths)",
            all.lost_per_death_of_recorder
        );
        say!("deadlines  {} missed of {}", all.deadlines_missed, all.ticks);
        for (cause, count) in &all.deadlines_by_cause {
            say!("           {count} {cause}");
        }
        let percent = |ratio: f64| format!("{:.1} %", ratio * 100.0);
        say!(
            "worst      torque {} of the limit, step in one tick {}, speed {}; a torque {} ticks old",
            percent(all.torque_max_ratio),
            percent(all.torque_step_max_ratio),
            percent(all.speed_max_ratio),
            all.stale_ticks
        );
        say!("the arm    was stopped or braked for {:.1} s", all.stood_s);
        if let (Some(first), Some(last)) = (self.usage.first(), self.usage.last()) {
            say!(
                "the soak   {:.1} to {:.1} MB, {} to {} open files, {} to {} threads from its first round to its last",
                first.resident_kb as f64 / 1e3,
                last.resident_kb as f64 / 1e3,
                first.open_files,
                last.open_files,
                first.threads,
                last.threads
            );
        }
        for round in self.rounds.iter().filter(|round| !round.broken.is_empty()) {
            for what in &round.broken {
                say!("BROKEN     round {}, seed {}: {what}", round.round, round.seed);
            }
        }
        if let Some(kept) = &self.kept {
            say!("           {}/round-NNN/scenario.toml holds the faults of each such round", kept.display());
        }
        if self.passed {
            say!("every promise was kept, and nothing is left over");
        }
    }

    /// Faults against time in a row per process, with what the drives did; and one round of them closely.
    pub(in super::super) fn picture(&self) -> Page {
        let rate = f64::from(self.rate_hz);
        let lengths: Vec<f64> = self.rounds.iter().map(|round| round.ticks as f64 / rate).collect();
        let total: f64 = lengths.iter().sum();
        let processes: Vec<String> = ["plant", "estimator", "analyzer", "controller", "recorder"].map(str::to_owned).to_vec();
        let rows: Vec<String> = processes.iter().cloned().chain(["drives".to_owned()]).collect();
        let drives = processes.len() as f64;
        let mut all = Panel::new(
            "every fault by process; below, when the drives stopped the arm or held it",
            Axis::named("time, s").within(0.0..total.max(1.0)),
            Axis::names(rows.clone()),
        );
        for (class, color) in CLASSES.iter().zip(colors()) {
            all.line(class, color, &[]);
        }
        let mut from = 0.0;
        for (round, length) in self.rounds.iter().zip(&lengths) {
            all.line("", Color { 3: 0.5, ..GREY }, &[(from, -0.5), (from, drives + 0.5)]);
            for struck in &round.struck {
                let row = processes.iter().position(|process| *process == struck.process).unwrap_or_default() as f64;
                // Classes a little apart, so that the later do not hide the earlier.
                let class = class_of(&struck.kind);
                all.dots(colors()[class], 2.0, &[(from + struck.at_s, row + 0.13 * (class as f64 - 2.0))]);
            }
            for stop in &round.stops {
                let until = (stop.until as f64 / rate).max(stop.from as f64 / rate + 0.0005 * total);
                stroke(&mut all, INK, from + stop.from as f64 / rate, from + until, drives);
            }
            from += length;
        }
        let busiest = self.rounds.iter().filter(|round| round.end == "goal reached").max_by_key(|round| round.struck.len());
        let mut page_rows = vec![Row::of(270.0, [all])];
        if let Some(round) = busiest.or(self.rounds.first()) {
            let seconds = (round.ticks as f64 / rate).max(1.0);
            let title = format!("round {} closely: how long each lasted; a dot where a process died", round.round);
            let mut one = Panel::new(&title, Axis::named("time, s").within(0.0..seconds), Axis::names(rows));
            for struck in &round.struck {
                let row = processes.iter().position(|process| *process == struck.process).unwrap_or_default() as f64;
                let class = class_of(&struck.kind);
                let y = row + 0.13 * (class as f64 - 2.0);
                // Until the process was back, where it went.
                let length_s = struck.mended_ms.map_or(struck.length_s, |ms| ms * 1e-3);
                stroke(&mut one, colors()[class], struck.at_s, (struck.at_s + length_s.max(0.001 * seconds)).min(seconds), y);
                if struck.deaths > 0 {
                    one.dots(colors()[class], 2.6, &[(struck.at_s, y)]);
                }
            }
            for stop in &round.stops {
                let from = stop.from as f64 / rate;
                stroke(&mut one, INK, from, (stop.until as f64 / rate).max(from + 0.001 * seconds), drives);
            }
            page_rows.push(Row::of(270.0, [one]));
        }
        let noticed: Vec<&Kind> = self.kinds.iter().filter(|kind| kind.noticed_ms_p50.is_some()).collect();
        let mut panel = Panel::new(
            "time until something noticed, ms: half of them, and the slowest",
            Axis::default().logarithmic().within(0.001..10_000.0),
            Axis::names(noticed.iter().map(|kind| format!("{} ({})", kind.kind, kind.times))),
        );
        for (row, kind) in noticed.iter().enumerate() {
            let (half, most) = (kind.noticed_ms_p50.unwrap_or_default(), kind.noticed_ms_max.unwrap_or_default());
            let color = colors()[class_of(&kind.kind)];
            panel.line("", Color { 3: 0.4, ..color }, &[(half, row as f64), (most, row as f64)]);
            panel.dots(color, 3.0, &[(half, row as f64)]);
            panel.dots(color, 1.8, &[(most, row as f64)]);
        }
        page_rows.push(Row::of(90.0 + 13.0 * noticed.len() as f64, [panel]));
        let totals = &self.totals;
        Page {
            title: "The soak".to_owned(),
            subtitle: format!(
                "{} faults in {:.0} s of real time at {} Hz, {} rounds: {} reached the goal, {} came to rest, {} ended by design, {} broke a promise",
                totals.blows, total, self.rate_hz, totals.rounds, totals.goal, totals.rest, totals.ended, totals.broken
            ),
            rows: page_rows,
            width: 1100.0,
            ..Page::default()
        }
    }
}

/// A line three times as thick as others.
fn stroke(panel: &mut Panel, color: Color, from: f64, to: f64, y: f64) {
    for place in [y - 0.05, y, y + 0.05] {
        panel.line("", color, &[(from, place), (to, place)]);
    }
}

/// What faults have in common, for their colours.
const CLASSES: [&str; 5] = ["deaths", "standing still", "messages", "sensors and drives", "clock, core, volume"];

fn colors() -> [Color; 5] {
    [RED, numbered(4), BLUE, numbered(2), numbered(3)]
}

fn class_of(kind: &str) -> usize {
    let word = kind.split([' ', ',']).next().unwrap_or_default();
    match word {
        "SIGSTOP" if kind.contains("SIGCONT") => 1,
        "hang" if kind.ends_with("paused") => 1,
        "kill" | "crash" | "hang" | "SIGKILL" | "SIGSTOP" => 0,
        "sensor" | "drive" => 3,
        "clock" | "starve" | "disk-full" | "slow-disk" => 4,
        _ => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_its_class() {
        let of = |kind: &str| CLASSES[class_of(kind)];
        assert_eq!(["kill", "SIGKILL, and again", "hang for-ever", "SIGSTOP"].map(of), ["deaths"; 4]);
        assert_eq!(["hang paused", "SIGSTOP, SIGCONT"].map(of), ["standing still"; 2]);
        assert_eq!(["drop", "corrupt nan"].map(of), ["messages"; 2]);
        assert_eq!((of("drive lost"), of("clock jump")), ("sensors and drives", "clock, core, volume"));
    }

    #[test]
    fn the_median_is_the_lower_of_two() {
        assert_eq!(p50(vec![3.0, 1.0, 2.0]), (Some(2.0), Some(3.0)));
        assert_eq!(p50(vec![3.0, 1.0]), (Some(1.0), Some(3.0)));
        assert_eq!(p50(vec![]), (None, None));
    }
}
