//! What a hand-over, a cycle and a step cost, beside baseline transports of the machine.
//!
//! Each benchmark fills [`Row`]s: hand-overs in alternating runs of real processes, after one that warms everything up; steps on one thread. No
//! sample is left out.

mod hop;
mod lockstep;
mod ring;
mod steps;
mod transports;

use std::fmt;

use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use session::table::{number, table};
use viz::digits;

pub use hop::{Only, cycle, hop};
pub use lockstep::{Lockstep, lockstep};
pub use ring::peer;
pub use steps::steps;

/// Quantiles of the samples of one thing, µs.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Distribution {
    /// Number of samples.
    pub samples: u64,
    /// Median, µs.
    pub p50_us: f64,
    /// 99th percentile, µs.
    pub p99_us: f64,
    /// 99.9th percentile, µs.
    pub p999_us: f64,
    /// Largest, µs.
    pub max_us: f64,
}

impl Distribution {
    /// The distribution of a histogram of nanoseconds, of which each sample holds `share` things.
    fn of(nanoseconds: &Histogram<u64>, share: f64) -> Self {
        let us = |ns: u64| ns as f64 / 1e3 / share;
        let at = |quantile| us(nanoseconds.value_at_quantile(quantile));
        Self {
            samples: nanoseconds.len(),
            p50_us: at(0.5),
            p99_us: at(0.99),
            p999_us: at(0.999),
            max_us: us(nanoseconds.max()),
        }
    }
}

/// Nanoseconds up to 100 s, three digits.
fn histogram() -> Histogram<u64> {
    #[allow(clippy::expect_used, reason = "the bounds are constants")]
    Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds are valid")
}

/// One line of the result.
#[derive(Serialize)]
pub struct Row {
    /// Name of the benchmark.
    pub bench: &'static str,
    /// Transport or step measured.
    pub mechanism: String,
    /// Cores of the processes.
    pub placement: &'static str,
    /// Bytes of the message, or of all messages of a cycle; 0 where there is none.
    pub payload_bytes: usize,
    /// Times.
    #[serde(flatten)]
    pub times: Distribution,
    /// Median over that of the futex of the same placement and payload.
    pub ratio_p50: Option<f64>,
    /// 99th percentile over the same.
    pub ratio_p99: Option<f64>,
}

/// The rows as a table.
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
            let times = &row.times;
            let ratio = |ratio: Option<f64>| ratio.map_or(String::new(), |of| format!("{of:.2}"));
            let numbers = [times.p50_us, times.p99_us, times.p999_us, times.max_us];
            lines.add_row(
                [
                    row.bench.into(),
                    row.placement.into(),
                    number(row.payload_bytes),
                    row.mechanism.as_str().into(),
                ]
                .into_iter()
                .chain(numbers.map(|time| number(digits(time))))
                .chain([row.ratio_p50, row.ratio_p99].map(|of| number(ratio(of)))),
            );
        }
        writeln!(f, "{lines}")
    }
}

/// The machine of a measurement.
pub fn machine() -> Value {
    let (health, machine) = (launcher::doctor::examine(), session::machine());
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    json!({
        "cpu": machine.cpu, "cores": machine.cores, "pinned_to": runtime::realtime::allowed_cores(), "kernel": machine.kernel,
        "preempt_rt": health.preempt_rt, "clock_source": health.clock_source, "fifo": health.rights.fifo(),
        "locked_memory": health.rights.lock_memory(), "load": load.split(' ').take(3).collect::<Vec<_>>().join(" "),
    })
}

/// The same in one line, for people.
pub fn machine_line(machine: &Value) -> String {
    let text = |key: &str| machine[key].as_str().unwrap_or_default();
    let fifo = if machine["fifo"] == true {
        ""
    } else {
        "without "
    };
    format!(
        "{}, {}, {} cores, {fifo}SCHED_FIFO, load {}",
        text("cpu"),
        text("kernel"),
        machine["cores"],
        text("load")
    )
}
