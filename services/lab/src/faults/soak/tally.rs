//! A soak's rounds, added up by kind of fault and over everything.

use std::collections::BTreeMap;

use serde::Serialize;
use shared_types::process::Program;

use super::judge::Messages;
use super::round::{Injected, Round};

/// Everything of one kind, over all rounds and processes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Kind {
    /// Kind of the fault.
    pub kind: String,
    /// Injections.
    pub times: u64,
    /// How many of them something detected.
    pub detected: u64,
    /// Median time to detection, ms.
    pub detected_ms_p50: Option<f64>,
    /// Longest time to detection, ms.
    pub detected_ms_max: Option<f64>,
    /// Deaths that it cost, each followed by a restart or the end of the run.
    pub deaths: u64,
    /// Median time to recovery, ms.
    pub recovered_ms_p50: Option<f64>,
    /// Longest time to recovery, ms.
    pub recovered_ms_max: Option<f64>,
    /// How often the drives had to stop the arm.
    pub stops: u64,
    /// Median duration of a stop of the arm, ms.
    pub stopped_ms_p50: Option<f64>,
    /// Longest stop of the arm, ms.
    pub stopped_ms_max: Option<f64>,
    /// How the rounds ended in which it injected.
    pub goal: u64,
    /// Runs that came to rest before the goal.
    pub rest: u64,
    /// Runs that ended by design.
    pub ended: u64,
}

/// Over all rounds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Totals {
    /// Rounds.
    pub rounds: u64,
    /// Guarantees that were broken.
    pub broken: u64,
    /// Runs that reached the goal.
    pub goal: u64,
    /// Runs that came to rest before the goal.
    pub rest: u64,
    /// Runs that ended by design.
    pub ended: u64,
    /// Ticks run.
    pub ticks: u64,
    /// Faults planned.
    pub planned: u64,
    /// Faults left out, by reason.
    pub left_out: BTreeMap<&'static str, u64>,
    /// Restarts.
    pub restarts: BTreeMap<String, u64>,
    /// Messages compared.
    pub messages: Messages,
    /// Losses over the deaths of the recorder: no other cause is allowed, and a recorder that falls behind shows here too.
    pub lost_per_death_of_recorder: f64,
    /// Missed deadlines.
    pub deadlines_missed: u64,
    /// Missed deadlines by cause.
    pub deadlines_by_cause: BTreeMap<String, u64>,
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest change of a torque between two ticks over its limit.
    pub torque_step_max_ratio: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Age of the oldest torque in force, ticks.
    pub stale_ticks: u32,
    /// Time that the arm was stopped, s.
    pub stopped_s: f64,
}

fn p50(mut values: Vec<f64>) -> (Option<f64>, Option<f64>) {
    values.sort_by(f64::total_cmp);
    (
        values.get(values.len().saturating_sub(1) / 2).copied(),
        values.last().copied(),
    )
}

/// A row for each kind, in the order of their names, signals first.
pub(super) fn kinds(rounds: &[Round]) -> Vec<Kind> {
    let mut by_kind = BTreeMap::<&str, Vec<(&Round, &Injected)>>::new();
    for round in rounds {
        for injected in &round.injected {
            by_kind
                .entry(injected.kind.as_str())
                .or_default()
                .push((round, injected));
        }
    }
    let row = |(kind, planned): (&str, Vec<(&Round, &Injected)>)| {
        let of = |value: fn(&Injected) -> Option<f64>| {
            planned
                .iter()
                .filter_map(|(_, injected)| value(injected))
                .collect::<Vec<_>>()
        };
        let detected = of(|injected| injected.detected_ms);
        let stood = of(|injected| (injected.stopped_ms > 0.0).then_some(injected.stopped_ms));
        let ends = |end: &str| planned.iter().filter(|(round, _)| round.end == end).count() as u64;
        let count = (detected.len() as u64, stood.len() as u64);
        let ((detected_ms_p50, detected_ms_max), (stopped_ms_p50, stopped_ms_max)) =
            (p50(detected), p50(stood));
        let (recovered_ms_p50, recovered_ms_max) = p50(of(|injected| injected.recovered_ms));
        Kind {
            kind: kind.to_owned(),
            times: planned.len() as u64,
            detected: count.0,
            detected_ms_p50,
            detected_ms_max,
            deaths: planned
                .iter()
                .map(|(_, injected)| u64::from(injected.deaths))
                .sum(),
            recovered_ms_p50,
            recovered_ms_max,
            stops: count.1,
            stopped_ms_p50,
            stopped_ms_max,
            goal: ends("goal reached"),
            rest: ends("rest"),
            ended: ends("ended") + ends("interrupted"),
        }
    };
    by_kind.into_iter().map(row).collect()
}

impl Totals {
    /// Sums and maxima over `rounds`.
    pub fn of(rounds: &[Round]) -> Self {
        let mut totals = Self {
            rounds: rounds.len() as u64,
            ..Self::default()
        };
        for round in rounds {
            totals.broken += u64::from(!round.broken.is_empty());
            match round.end {
                "goal reached" => totals.goal += 1,
                "rest" => totals.rest += 1,
                _ => totals.ended += 1,
            }
            totals.ticks += round.ticks;
            totals.planned += round.injected.len() as u64;
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
                (&mut sum.in_files, one.in_files),
            ] {
                *sum += one;
            }
            totals.deadlines_missed += round.deadlines.missed;
            for (cause, count) in &round.deadlines.by_cause {
                *totals.deadlines_by_cause.entry(cause.clone()).or_default() += count;
            }
            totals.torque_max_ratio = totals.torque_max_ratio.max(round.torque_max_ratio);
            totals.torque_step_max_ratio = totals
                .torque_step_max_ratio
                .max(round.torque_step_max_ratio);
            totals.speed_max_ratio = totals.speed_max_ratio.max(round.speed_max_ratio);
            totals.stale_ticks = totals.stale_ticks.max(round.stale_ticks);
            totals.stopped_s += round
                .stops
                .iter()
                .map(|stop| (stop.until - stop.from) as f64)
                .sum::<f64>()
                / f64::from(round.rate_hz);
        }
        let deaths = totals
            .restarts
            .get(Program::Recorder.name())
            .copied()
            .unwrap_or_default();
        totals.lost_per_death_of_recorder = totals.messages.lost as f64 / deaths.max(1) as f64;
        totals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_lower_of_two() {
        assert_eq!(p50(vec![3.0, 1.0, 2.0]), (Some(2.0), Some(3.0)));
        assert_eq!(p50(vec![3.0, 1.0]), (Some(1.0), Some(3.0)));
        assert_eq!(p50(vec![]), (None, None));
    }
}
