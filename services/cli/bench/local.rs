//! What one tick of each process computes, without any message.

use std::hint::black_box;
use std::path::Path;

use chain::Chain;
use message_log::{LogError, LogWriter};
use model::{Model, Robot};
use nalgebra::SVector;
use recorder::{Judge, Row, Tick};
use runtime::now_ns;
use shared_types::job::Mode;
use shared_types::scenario::Scenario;
use shared_types::topics::{self, Build, ByTopic, Each, Family, Topic};

use super::super::failure::Failure;
use super::super::run;
use super::{Distribution, Row as BenchRow, histogram};

/// What the recorder did with a whole scenario.
#[derive(serde::Serialize)]
pub(super) struct Recorded {
    /// Processor time of the whole recorder process per tick, in a run of its own; µs.
    cpu_us_per_tick: f64,
    /// The recording, at 1 kHz.
    recording_mb_per_min: f64,
    /// The messages that `armplane replay` reads, at 1 kHz.
    messages_mb_per_min: f64,
}

impl Recorded {
    pub(super) fn sentence(&self) -> String {
        let Self { cpu_us_per_tick, recording_mb_per_min, messages_mb_per_min } = self;
        format!(
            "recorder: {cpu_us_per_tick:.1} µs of processor time a tick; {recording_mb_per_min:.0} MB a minute of recording and \
             {messages_mb_per_min:.0} of messages at 1 kHz"
        )
    }
}

const N: usize = 6;
/// Evaluations per sample: a clock reading costs a tenth of one.
const BATCH: u64 = 100;
const SAMPLES: u64 = 5_000;

/// The arm's terms at postures along a circle in joint space.
pub(super) fn model(robot: &Robot) -> Result<Vec<BenchRow>, Failure> {
    let model = Model::<N>::new(robot, None).map_err(Failure::work)?;
    let posture = |sample: u64| {
        let angle = sample as f64 * 0.01;
        (
            SVector::<f64, N>::from_fn(|joint, _| 0.3 + (angle + joint as f64).sin()),
            SVector::<f64, N>::from_fn(|joint, _| (angle * joint as f64).cos()),
        )
    };
    let timed = |work: &dyn Fn(&SVector<f64, N>, &SVector<f64, N>)| {
        let mut times = histogram();
        for sample in 0..SAMPLES {
            let (q, qdot) = posture(sample);
            let began = now_ns();
            (0..BATCH).for_each(|_| work(black_box(&q), black_box(&qdot)));
            // Hundredths: a histogram of whole nanoseconds would be too coarse.
            times.saturating_record(now_ns() - began);
        }
        Distribution::of(&times).divided_by(BATCH as f64)
    };
    let row = |mechanism: &str, distribution| BenchRow::alone("model", mechanism, distribution);
    Ok(vec![
        row(
            "A, bias and J in one pass",
            timed(&|q, qdot| {
                black_box(model.evaluate(q, qdot));
            }),
        ),
        row(
            "mass matrix",
            timed(&|q, _| {
                black_box(model.mass_matrix(q));
            }),
        ),
        row(
            "inverse dynamics",
            timed(&|q, qdot| {
                black_box(model.inverse_dynamics(q, qdot, qdot));
            }),
        ),
        row(
            "forward dynamics",
            timed(&|q, qdot| {
                black_box(model.forward_dynamics(q, qdot, qdot));
            }),
        ),
    ])
}

/// The pure steps over a whole scenario, hand in hand; the last row is all of them as the chain runs them.
pub(super) fn steps(robot: &Robot, scenario: &Scenario, which: &str) -> Result<Vec<BenchRow>, Failure> {
    let mut plant = plant::cycle(robot, scenario).map_err(Failure::work)?;
    let mut estimator = estimator::cycle(robot, scenario).map_err(Failure::work)?;
    let mut analyzer = analyzer::cycle(robot, scenario).map_err(Failure::work)?;
    let mut controller = controller::cycle(robot, scenario).map_err(Failure::work)?;
    let mut times: [_; 5] = std::array::from_fn(|_| histogram());
    for tick in 0.. {
        if plant.is_over() {
            break;
        }
        let mut last = now_ns();
        let mut lap = |times: &mut hdrhistogram::Histogram<u64>| {
            let now = now_ns();
            times.saturating_record(now - last);
            last = now;
        };
        let (sensor, _) = plant.sample(tick);
        lap(&mut times[0]);
        let estimate = estimator.step(&sensor);
        lap(&mut times[1]);
        let report = analyzer.step(&estimate);
        lap(&mut times[2]);
        let command = controller.step(&estimate, &report);
        lap(&mut times[3]);
        plant.step(Some(&command));
        lap(&mut times[4]);
    }
    let of = |index: usize| Distribution::of(&times[index]);
    if which == "plant" {
        return Ok(vec![BenchRow::alone("plant", "sample", of(0)), BenchRow::alone("plant", "move", of(4))]);
    }
    let mut chain = Chain::new(robot, scenario).map_err(Failure::work)?;
    let mut whole = histogram();
    while !chain.is_over() {
        let began = now_ns();
        black_box(chain.step());
        whole.saturating_record(now_ns() - began);
    }
    Ok(vec![
        BenchRow::alone("control", "estimator", of(1)),
        BenchRow::alone("control", "analyzer", of(2)),
        BenchRow::alone("control", "controller", of(3)),
        BenchRow::alone("control", "whole tick, one thread", Distribution::of(&whole)),
    ])
}

/// What the recorder does with each tick, step by step; and a run in its own process.
pub(super) fn record(robot: &Robot, scenario: &Scenario) -> Result<(Vec<BenchRow>, Recorded), Failure> {
    let folder = super::scratch()?;
    let job = super::job(robot, scenario.clone(), Mode::Lockstep, folder.path())?;
    let mut tape = recorder::Tape::<N>::start(robot, &job, 1).map_err(Failure::work)?;
    let mut judge = Judge::new(recorder::limits(robot), scenario.goal.clone(), scenario.duration_s() * f64::from(scenario.rate_hz));
    let parts = folder.path().join("parts");
    let mut files = ByTopic::<Files>::try_build(&mut Create(&parts)).map_err(Failure::work)?;
    let mut times: [_; 3] = std::array::from_fn(|_| histogram());
    chain::run(robot, scenario, |tick| {
        let row = Row::new(tick.sensor.header.tick, tick.into());
        let began = now_ns();
        Tick::of(&tick.lent()).into_iter().for_each(|tick| judge.tick(tick));
        let judged = now_ns();
        tape.tick(&row);
        let taped = now_ns();
        // A full disk is told by the run below.
        let _ = topics::try_each(&mut Add(&mut files, tick));
        for (times, lap) in times.iter_mut().zip([judged - began, taped - judged, now_ns() - taped]) {
            times.saturating_record(lap);
        }
    })
    .map_err(Failure::input)?;
    tape.finish();
    let rows = ["judge", "recording", "messages"].iter().zip(&times);
    let rows = rows.map(|(what, times)| BenchRow::alone("record", what, Distribution::of(times))).collect();

    let (outcome, account) = run::launch(&job, run::plan(&job)?)?;
    let account = account.ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?.recorder;
    if !account.error.is_empty() {
        return Err(Failure::Work(account.error));
    }
    let per_tick = |amount: f64| amount / outcome.ticks.max(1) as f64;
    let recorded = Recorded {
        cpu_us_per_tick: per_tick(account.cpu_s * 1e6),
        recording_mb_per_min: per_tick(account.bytes as f64 * 1e-6) * 60_000.0,
        messages_mb_per_min: per_tick(account.messages_bytes as f64 * 1e-6) * 60_000.0,
    };
    Ok((rows, recorded))
}

/// A file of kept messages for each topic.
struct Files;

impl Family for Files {
    type Of<M: Topic> = LogWriter<M>;
}

struct Create<'a>(&'a Path);

impl Build<Files> for Create<'_> {
    type Error = LogError;
    fn build<M: Topic>(&mut self) -> Result<LogWriter<M>, LogError> {
        LogWriter::create(self.0)
    }
}

struct Add<'a>(&'a mut ByTopic<Files>, &'a chain::Tick);

impl Each for Add<'_> {
    type Output = Result<(), LogError>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        M::of_mut(self.0).add(M::of(self.1))
    }
}
