//! Latencies, from the stamps of the messages.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use shared_types::graph::{BUILT_IN, Graph};
use shared_types::summary::Latency;
use shared_types::{SensorSample, TorqueCommand};

use super::histogram::histogram;

/// A span of time that is measured each tick.
#[derive(Clone, Copy)]
pub(super) enum Span {
    /// Sensor to torque in the plant's hands.
    Chain,
    /// The own part of a process, by its place in the chain.
    Own(usize),
    /// The way to a process from the one before it.
    Way(usize),
}

/// The way of a tick around the loop: the processes in order, each with its place in the stamps.
#[derive(Clone, Debug)]
pub(super) struct Chain(Vec<(usize, String)>);

impl Default for Chain {
    /// The chain of the built-in graph.
    fn default() -> Self {
        Self::of(
            &Graph::parse("graph.toml", BUILT_IN)
                .expect("the graph that the program contains can be read"),
        )
    }
}

impl Chain {
    pub(super) fn of(graph: &Graph) -> Self {
        Self(
            graph
                .chain()
                .into_iter()
                .map(|(hop, process)| (hop, process.name.clone()))
                .collect(),
        )
    }

    fn spans(&self) -> impl Iterator<Item = Span> {
        let length = self.0.len();
        std::iter::once(Span::Chain)
            .chain((0..length).map(Span::Own))
            .chain((1..length).map(Span::Way))
    }

    /// The place of a span among all.
    fn place(&self, span: Span) -> usize {
        match span {
            Span::Chain => 0,
            Span::Own(place) => 1 + place,
            Span::Way(place) => self.0.len() + place,
        }
    }

    fn name(&self, span: Span) -> String {
        let name = |place: usize| self.0[place].1.as_str();
        match span {
            Span::Chain => "chain".to_owned(),
            Span::Own(place) => name(place).to_owned(),
            Span::Way(place) => format!("{} to {}", name(place - 1), name(place)),
        }
    }
}

/// Gathers the latencies of a run.
#[derive(Debug)]
pub(super) struct LatencyMeter {
    chain: Chain,
    /// One for each measured span.
    latencies: Vec<Histogram<u32>>,
    /// No latency is measured over a gap.
    last_sensor: Option<SensorSample>,
    /// Between two points of the real-time grid; 0 without one.
    period_ns: u64,
    /// When the tick before the last one was due.
    due_before_ns: u64,
    first_ns: u64,
    last_ns: u64,
}

impl LatencyMeter {
    pub(super) fn new(chain: Chain) -> Self {
        let latencies = chain.spans().map(|_| histogram()).collect();
        Self {
            chain,
            latencies,
            last_sensor: None,
            period_ns: 0,
            due_before_ns: 0,
            first_ns: 0,
            last_ns: 0,
        }
    }

    /// For ticks on a grid of `period_ns`.
    pub(super) fn on_grid(self, period_ns: u64) -> Self {
        Self { period_ns, ..self }
    }

    pub(super) fn of(&self, span: Span) -> &Histogram<u32> {
        &self.latencies[self.chain.place(span)]
    }

    /// Wall-clock time between the first and the last sample; s.
    pub(super) fn wall_s(&self) -> f64 {
        self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9
    }

    pub(super) fn summary(&self) -> BTreeMap<String, Latency> {
        self.chain
            .spans()
            .map(|span| (self.chain.name(span), latency(self.of(span))))
            .collect()
    }

    /// Adds a time to a distribution.
    fn measure(&mut self, span: Span, from_ns: u64, to_ns: u64) {
        if from_ns != 0 && to_ns != 0 {
            let time_ns = to_ns.saturating_sub(from_ns);
            // It grows with its samples, so it can hold every time.
            let _ = self.latencies[self.chain.place(span)].record(time_ns);
        }
    }

    /// Each hand-over and each computation, from the stamps of the last message of the way.
    pub(super) fn measure_hops(&mut self, command: &TorqueCommand) {
        let stamps = command.header.stamps;
        for place in 1..self.chain.0.len() {
            let (before, hop) = (self.chain.0[place - 1].0, self.chain.0[place].0);
            self.measure(
                Span::Way(place),
                stamps.sent_ns[before],
                stamps.received_ns[hop],
            );
            self.measure(
                Span::Own(place),
                stamps.received_ns[hop],
                stamps.sent_ns[hop],
            );
        }
    }

    /// Sensor to torque in the plant's hands, and the plant's own part; on a grid both from when the tick was due.
    pub(super) fn measure_chain(&mut self, sensor: &SensorSample) {
        let now = sensor.header.stamps;
        let sent = now.sent_ns[0];
        // The sample of tick k + 1 carries the time at which the plant received torque k.
        if let Some(last) = self.last_sensor
            && last.header.tick + 1 == sensor.header.tick
        {
            let then = last.header.stamps;
            // A torque that never came counts with all the time that the plant gave it.
            let ended = if now.received_ns[0] > then.sent_ns[0] {
                now.received_ns[0]
            } else {
                sent
            };
            self.measure(Span::Chain, then.origin_ns(), ended);
            if self.period_ns > 0 && self.due_before_ns > 0 {
                // No coordinated omission: a request at a skipped grid point would have waited for this answer.
                let skipped = (self.due_before_ns + self.period_ns..then.due_ns)
                    .step_by(self.period_ns as usize);
                skipped.for_each(|due| self.measure(Span::Chain, due, ended));
            }
            self.due_before_ns = then.due_ns;
            let began = if now.due_ns > 0 {
                now.due_ns
            } else {
                now.received_ns[0]
            };
            self.measure(Span::Own(0), began, sent);
        }
        self.first_ns = if self.first_ns == 0 {
            sent
        } else {
            self.first_ns
        };
        self.last_ns = sent.max(self.last_ns);
        self.last_sensor = Some(*sensor);
    }
}

fn latency(histogram: &Histogram<u32>) -> Latency {
    let us = |quantile: f64| histogram.value_at_quantile(quantile) as f64 * 1e-3;
    Latency {
        count: histogram.len(),
        p50: us(0.5),
        p99: us(0.99),
        p999: us(0.999),
        max: histogram.max() as f64 * 1e-3,
    }
}
