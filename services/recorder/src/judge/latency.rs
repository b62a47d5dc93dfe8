//! Latencies, from the stamps of the messages.

use std::collections::BTreeMap;

use hdrhistogram::Histogram;
use shared_types::graph::Graph;
use shared_types::summary::Latency;
use shared_types::{SensorSample, Stamps, TorqueCommand};

use super::histogram::histogram;

/// Gathers the latencies of a run, each tick.
#[derive(Debug)]
pub(super) struct LatencyMeter {
    /// Sensor to torque in the plant's hands.
    pub(super) chain: Histogram<u32>,
    /// The way of a tick around the loop, from the plant on.
    hops: Vec<Hop>,
    /// No latency is measured over a gap.
    last_sensor: Option<SensorSample>,
    /// Between two points of the real-time grid; 0 without one.
    pub(super) period_ns: u64,
    /// When the tick before the last one was due.
    due_before_ns: u64,
    first_ns: u64,
    last_ns: u64,
}

/// A process on the way of a tick around the loop.
#[derive(Debug)]
struct Hop {
    name: String,
    /// Its place in the stamps.
    place: usize,
    /// Its own part.
    own: Histogram<u32>,
    /// The way to it from the one before it; empty of the first.
    way: Histogram<u32>,
}

impl LatencyMeter {
    pub(super) fn new(graph: &Graph) -> Self {
        let hops = graph.chain().into_iter().map(|(place, process)| Hop {
            name: process.name.clone(),
            place,
            own: histogram(),
            way: histogram(),
        });
        Self {
            chain: histogram(),
            hops: hops.collect(),
            last_sensor: None,
            period_ns: 0,
            due_before_ns: 0,
            first_ns: 0,
            last_ns: 0,
        }
    }

    /// Wall-clock time between the first and the last sample; s.
    pub(super) fn wall_s(&self) -> f64 {
        self.last_ns.saturating_sub(self.first_ns) as f64 * 1e-9
    }

    pub(super) fn summary(&self) -> BTreeMap<String, Latency> {
        let own = self.hops.iter().map(|hop| (hop.name.clone(), &hop.own));
        let ways = self.hops.windows(2).map(|pair| {
            let name = format!("{} to {}", pair[0].name, pair[1].name);
            (name, &pair[1].way)
        });
        let chain = std::iter::once(("chain".to_owned(), &self.chain));
        let all = chain.chain(own).chain(ways);
        all.map(|(name, times)| (name, latency(times))).collect()
    }

    /// Each hand-over and each computation, from the stamps of the last message of the way.
    pub(super) fn measure_hops(&mut self, command: &TorqueCommand) {
        let Stamps {
            received_ns,
            sent_ns,
            ..
        } = command.header.stamps;
        let mut before = None;
        for hop in &mut self.hops {
            let place = hop.place;
            // The plant's own part is measured by its samples.
            if let Some(before) = before.replace(place) {
                measure(&mut hop.way, sent_ns[before], received_ns[place]);
                measure(&mut hop.own, received_ns[place], sent_ns[place]);
            }
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
            measure(&mut self.chain, then.origin_ns(), ended);
            if self.period_ns > 0 && self.due_before_ns > 0 {
                // No coordinated omission: a request at a skipped grid point would have waited for this answer.
                let skipped = (self.due_before_ns + self.period_ns..then.due_ns)
                    .step_by(self.period_ns as usize);
                skipped.for_each(|due| measure(&mut self.chain, due, ended));
            }
            self.due_before_ns = then.due_ns;
            let began = if now.due_ns > 0 {
                now.due_ns
            } else {
                now.received_ns[0]
            };
            if let Some(plant) = self.hops.first_mut() {
                measure(&mut plant.own, began, sent);
            }
        }
        if self.first_ns == 0 {
            self.first_ns = sent;
        }
        self.last_ns = sent.max(self.last_ns);
        self.last_sensor = Some(*sensor);
    }
}

/// Adds a time to a distribution.
fn measure(times: &mut Histogram<u32>, from_ns: u64, to_ns: u64) {
    if from_ns != 0 && to_ns != 0 {
        // It grows with its samples, so it can hold every time.
        let _ = times.record(to_ns.saturating_sub(from_ns));
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
