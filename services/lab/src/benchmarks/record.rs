//! The recorder's work per tick, and its output.

use std::path::Path;

use message_log::{LogError, LogWriter, Logs};
use model::Robot;
use recorder::{Judge, Row, Tick};
use runtime::now_ns;
use session::{Failure, Observer, load};
use shared_types::job::Mode;
use shared_types::scenario::Scenario;
use shared_types::topics::{self, Build, ByTopic, Each, Family, TOPICS, Topic};

use super::distribution::{Distribution, Row as BenchRow, histogram};
use crate::folder::scratch;

/// The recorder's work over a whole scenario.
#[derive(serde::Serialize)]
pub struct Recorded {
    /// Processor time of the whole recorder process per tick, in a run of its own; µs.
    pub cpu_us_per_tick: f64,
    /// The recording, at 1 kHz.
    pub recording_mb_per_min: f64,
    /// The messages that `armplane replay` reads, at 1 kHz.
    pub messages_mb_per_min: f64,
}

/// The recorder's work per tick, step by step; and a run in its own process.
pub fn record(
    robot: &Robot,
    scenario: &Scenario,
    observer: Observer<'_>,
) -> Result<(Vec<BenchRow>, Recorded), Failure> {
    let folder = scratch()?;
    let job = load::job(
        robot,
        scenario.clone(),
        load::graph(None)?,
        Mode::Lockstep,
        folder.path().to_owned(),
    );
    let mut tape = recorder::Tape::start(robot, &job).map_err(Failure::work)?;
    let mut judge = Judge::new(robot, scenario).map_err(Failure::work)?;
    let parts = folder.path().join("parts");
    let mut files = ByTopic::<Files>::try_build(&mut Create(&parts, Logs::new(job.id, TOPICS)))
        .map_err(Failure::work)?;
    let mut times: [_; 3] = std::array::from_fn(|_| histogram());
    chain::run(robot, scenario, |tick| {
        let row = Row::new(tick.sensor.header.tick, tick.into());
        let began = now_ns();
        Tick::of(&tick.lent()).into_iter().for_each(|tick| {
            judge.tick(tick);
        });
        let judged = now_ns();
        tape.tick(&row);
        let taped = now_ns();
        // The run below reports a full disk.
        let _ = topics::try_each(&mut Add(&mut files, tick));
        for (times, lap) in times
            .iter_mut()
            .zip([judged - began, taped - judged, now_ns() - taped])
        {
            times.saturating_record(lap);
        }
    })
    .map_err(Failure::input)?;
    tape.finish();
    let rows = ["judge", "recording", "messages"].iter().zip(&times);
    let rows = rows
        .map(|(what, times)| BenchRow::alone("record", what, Distribution::of(times)))
        .collect();

    let (outcome, account) = session::launch(&job, session::plan(&job)?, observer)?;
    let account = account
        .ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?
        .recorder;
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

struct Create<'a>(&'a Path, Logs);

impl Build<Files> for Create<'_> {
    type Error = LogError;
    fn build<M: Topic>(&mut self) -> Result<LogWriter<M>, LogError> {
        LogWriter::create(self.0, &self.1)
    }
}

struct Add<'a>(&'a mut ByTopic<Files>, &'a chain::Tick);

impl Each for Add<'_> {
    type Output = Result<(), LogError>;
    fn each<M: Topic>(&mut self) -> Self::Output {
        M::of_mut(self.0).add(M::of(self.1))
    }
}
