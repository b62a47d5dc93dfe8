//! A soak as text for people.

use std::fmt;

use session::table::{number, table};
use viz::plot::digits;

use super::judge::Messages;
use super::rounds::Soak;

/// Faults by kind, totals, and each guarantee that does not hold.
impl fmt::Display for Soak {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.kinds(f)?;
        self.injected(f)?;
        self.messages(f)?;
        self.margins(f)?;
        self.usage(f)?;
        self.verdict(f)
    }
}

impl Soak {
    fn kinds(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows = table(&[
            "kind",
            "times",
            "detected",
            "detected after, ms",
            "deaths",
            "recovered after, ms",
            "stops",
            "stopped after, ms",
            "goal",
            "rest",
            "ended",
        ]);
        let optional = |value: Option<f64>| value.map_or("–".to_owned(), digits);
        let median_and_most = |p50, max| number(format!("{} / {}", optional(p50), optional(max)));
        for kind in &self.kinds {
            rows.add_row([
                kind.kind.clone().into(),
                number(kind.times),
                number(kind.detected),
                median_and_most(kind.detected_ms_p50, kind.detected_ms_max),
                number(kind.deaths),
                median_and_most(kind.recovered_ms_p50, kind.recovered_ms_max),
                number(kind.stops),
                median_and_most(kind.stopped_ms_p50, kind.stopped_ms_max),
                number(kind.goal),
                number(kind.rest),
                number(kind.ended),
            ]);
        }
        writeln!(f, "{rows}\nafter, ms: median / maximum")
    }

    fn injected(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = &self.totals;
        writeln!(
            f,
            "rounds     {}: {} reached the goal, {} came to rest, {} ended by design; {:.0} s at {} Hz, seed {}",
            all.rounds,
            all.goal,
            all.rest,
            all.ended,
            all.ticks as f64 / f64::from(self.rate_hz),
            self.rate_hz,
            self.seed
        )?;
        let left_out = all
            .left_out
            .iter()
            .map(|(why, count)| format!("{count} because {why}"))
            .collect::<Vec<_>>()
            .join(", ");
        writeln!(
            f,
            "faults     {} injected{}",
            all.planned,
            if left_out.is_empty() {
                String::new()
            } else {
                format!("; left out {left_out}")
            }
        )?;
        let restarts = all
            .restarts
            .iter()
            .filter(|(_, count)| **count > 0)
            .map(|(process, count)| format!("{process} {count}"));
        writeln!(f, "restarts   {}", restarts.collect::<Vec<_>>().join(", "))
    }

    fn messages(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Messages {
            sent,
            taken_in,
            refused,
            fenced,
            lost,
            in_files,
        } = self.totals.messages;
        writeln!(
            f,
            "messages   {sent} sent, {taken_in} received by the recorder, {in_files} read back from its files"
        )?;
        writeln!(
            f,
            "           {refused} refused for a number that is not finite, {fenced} of a dead incarnation; {lost} lost, sent while the recorder was away or too far behind ({:.0} for each of its deaths)",
            self.totals.lost_per_death_of_recorder
        )
    }

    fn margins(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = &self.totals;
        writeln!(
            f,
            "deadlines  {} missed of {}",
            all.deadlines_missed, all.ticks
        )?;
        for (cause, count) in &all.deadlines_by_cause {
            writeln!(f, "           {count} {cause}")?;
        }
        let percent = |ratio: f64| format!("{:.1} %", ratio * 100.0);
        writeln!(
            f,
            "worst      torque {} of the limit, step in one tick {}, speed {}; a torque {} ticks old",
            percent(all.torque_max_ratio),
            percent(all.torque_step_max_ratio),
            percent(all.speed_max_ratio),
            all.stale_ticks
        )?;
        writeln!(
            f,
            "the arm    was stopped or braked for {:.1} s",
            all.stopped_s
        )
    }

    fn usage(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Some(first), Some(last)) = (self.usage.first(), self.usage.last()) else {
            return Ok(());
        };
        writeln!(
            f,
            "the soak   {:.1} to {:.1} MB, {} to {} open files, {} to {} threads from its first round to its last",
            first.resident_kb as f64 / 1e3,
            last.resident_kb as f64 / 1e3,
            first.open_files,
            last.open_files,
            first.threads,
            last.threads
        )
    }

    fn verdict(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for round in self.rounds.iter().filter(|round| !round.broken.is_empty()) {
            for what in &round.broken {
                writeln!(
                    f,
                    "BROKEN     round {}, seed {}: {what}",
                    round.round, round.seed
                )?;
            }
        }
        if let Some(folder) = &self.folder {
            writeln!(
                f,
                "           {}/round-NNN/scenario.toml holds the faults of each such round",
                folder.display()
            )?;
        }
        if self.passed {
            writeln!(f, "every guarantee held, and nothing is left behind")?;
        }
        Ok(())
    }
}
