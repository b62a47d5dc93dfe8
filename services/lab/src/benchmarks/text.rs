//! Measurements as text for people.

use std::fmt;

use session::table::{number, table};
use viz::plot::digits;

use super::distribution::{Distribution, Row};
use super::hour::{EVERY_S, Hour, Look};
use super::realtime::Ran;
use super::record::Recorded;

/// The rows of a table.
pub struct Rows<'a>(pub &'a [Row]);

impl fmt::Display for Rows<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines = table(&[
            "bench",
            "placement",
            "bytes",
            "mechanism",
            "p50 µs",
            "p99 µs",
            "p99.9 µs",
            "max µs",
            "ratio p50",
            "ratio p99",
        ]);
        for row in self.0 {
            let Distribution {
                p50_us,
                p99_us,
                p999_us,
                max_us,
                ..
            } = row.distribution;
            let ratio = |ratio: Option<f64>| {
                number(ratio.map_or(String::new(), |ratio| format!("{ratio:.2}")))
            };
            lines.add_row([
                row.bench.clone().into(),
                row.placement.clone().into(),
                number(row.payload_bytes),
                row.mechanism.clone().into(),
                number(digits(p50_us)),
                number(digits(p99_us)),
                number(digits(p999_us)),
                number(digits(max_us)),
                ratio(row.ratio_p50),
                ratio(row.ratio_p99),
            ]);
        }
        let samples = || self.0.iter().map(|row| row.distribution.samples);
        let (least, most) = (samples().min().unwrap_or(0), samples().max().unwrap_or(0));
        writeln!(
            f,
            "{lines}\n{} samples a row",
            if least == most {
                most.to_string()
            } else {
                format!("{least} to {most}")
            }
        )
    }
}

impl fmt::Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Recorded {
            cpu_us_per_tick,
            recording_mb_per_min,
            messages_mb_per_min,
        } = self;
        writeln!(
            f,
            "recorder: {cpu_us_per_tick:.1} µs of processor time a tick; {recording_mb_per_min:.0} MB a minute of recording and \
             {messages_mb_per_min:.0} of messages at 1 kHz"
        )
    }
}

impl fmt::Display for Hour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some((first, last)) = self.memory.first().zip(self.memory.last()) else {
            writeln!(
                f,
                "shorter than the {EVERY_S} s after which memory is looked at first"
            )?;
            return Ok(());
        };
        writeln!(
            f,
            "\n{:.0} s of the arm's time, {} ticks at {:.0} a second, {}: {:.1} µs of processor time a tick in the recorder, {:.1} MB a minute of \
             recording in {} parts and {:.0} of messages, {} lost",
            last.at_s,
            self.ticks,
            self.ticks_per_s,
            self.outcome,
            self.recorder_cpu_us_per_tick,
            self.recording_mb_per_min,
            self.parts,
            self.messages_mb_per_min,
            self.lost
        )?;
        let headings = [
            "process",
            "after 1 min, MB",
            "most, MB",
            "at the end, MB",
            "change in the second half, MB",
            "shared, MB",
        ];
        let mut rows = table(&headings);
        for name in first.processes.keys() {
            let own = |look: &Look| look.processes.get(name).map_or(0.0, |memory| memory.own_mb);
            let most = self.memory.iter().map(own).fold(0.0, f64::max);
            let half = &self.memory[self.memory.len() / 2];
            let shared = last
                .processes
                .get(name)
                .map_or(0.0, |memory| memory.shared_mb);
            let numbers = [own(first), most, own(last)].map(|mb| number(digits(mb)));
            let change = number(format!("{:+.2}", own(last) - own(half)));
            rows.add_row(
                [name.into()]
                    .into_iter()
                    .chain(numbers)
                    .chain([change, number(digits(shared))]),
            );
        }
        writeln!(f, "{rows}")
    }
}

impl fmt::Display for Ran {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let load = if self.loaded {
            "a busy thread on every core"
        } else {
            "no load of ours"
        };
        let seconds = self.ticks as f64 / f64::from(self.rate_hz);
        writeln!(
            f,
            "\n{} Hz for {seconds:.0} s, {load}: {} of {} deadlines missed, {}",
            self.rate_hz, self.deadlines.missed, self.ticks, self.outcome
        )?;
        let mut rows = table(&["process", "deadlines missed", "cause"]);
        for process in &self.processes {
            let causes = self.missed(process);
            let why = causes
                .iter()
                .map(|(cause, count)| format!("{count} {cause}"))
                .collect::<Vec<_>>()
                .join(", ");
            rows.add_row([
                process.clone().into(),
                number(causes.values().sum::<u64>()),
                why.into(),
            ]);
        }
        writeln!(f, "{rows}")?;
        let mut rows = table(&[
            "latency",
            "samples",
            "p50 µs",
            "p99 µs",
            "p99.9 µs",
            "max µs",
        ]);
        for (name, latency) in &self.latency_us {
            let times = [latency.p50, latency.p99, latency.p999, latency.max]
                .map(|time| number(digits(time)));
            rows.add_row(
                [name.clone().into(), number(latency.count)]
                    .into_iter()
                    .chain(times),
            );
        }
        writeln!(f, "{rows}")?;
        writeln!(
            f,
            "recorder: {} lost, {:.1} µs of processor time a tick",
            self.recorder.lost,
            self.cpu_us_per_tick()
        )
    }
}
