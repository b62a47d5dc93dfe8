//! Two laws in one recording: the same plant, seed and task.

use std::path::{Path, PathBuf};

use chain::Tick;
use model::Robot;
use recorder::TaskError;
use serde::Serialize;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::MAX_DOF;
use shared_types::bounds::larger;
use shared_types::scenario::Strategy;
use viz::plot::digits;
use viz::{Recording, RunInfo, TickRow};

use crate::text::percent;
use crate::trial::Trial;

/// Pictures of both arms per second, as in every recording.
const PICTURE_HZ: u32 = 50;
/// How often the counters are written; pictures.
const COUNTERS_EVERY: u64 = 10;

/// How a law did so far.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Racer {
    /// Largest distance of the hand from its reference; mm.
    pub position_max_mm: f64,
    /// Largest angle between the hand and its reference; degrees.
    pub orientation_max_deg: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
}

/// A race, run.
#[derive(Clone, Debug, Serialize)]
pub struct Race {
    /// The scenario's name.
    pub scenario: String,
    /// Seed of both runs.
    pub seed: u64,
    /// The law that is drawn solid, and how it did.
    pub law: (String, Racer),
    /// The law that is drawn translucent, and how it did.
    pub rival: (String, Racer),
    /// Folder of the recording.
    pub folder: PathBuf,
}

impl Racer {
    fn add(&mut self, tick: &Tick, error: TaskError, robot: &Robot) {
        self.position_max_mm = larger(self.position_max_mm, error.position[0]);
        self.orientation_max_deg = larger(self.orientation_max_deg, error.orientation[0]);
        for (joint, rate) in robot.joints.iter().zip(&tick.plant_state.qdot) {
            self.speed_max_ratio = larger(self.speed_max_ratio, rate.abs() / joint.velocity);
        }
    }
}

/// Runs a scenario under two laws, one after the other on one thread, and records both arms in one recording: the scenario's law solid, the
/// rival translucent.
///
/// # Errors
/// [`Failure`] where the scenario cannot be run under a law, or the recording not be written.
pub fn race(
    name: &str,
    settings: &[String],
    seed: Option<u64>,
    rival: Strategy,
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<Race, Failure> {
    let load::Loaded {
        scenario, robot, ..
    } = load::scenario(name, settings, seed)?;
    let scenario = chain::without_faults(&scenario);
    let law = scenario.control.strategy;
    let names = [law, rival].map(Strategy::name);
    if law == rival {
        let (scenario, law) = (&scenario.name, law.name());
        return Err(Failure::Input(format!(
            "{scenario} already runs under {law}: choose another law with --law"
        )));
    }
    let results = Results::create(out, "race")?;
    let every = u64::from((scenario.rate_hz / PICTURE_HZ).max(1));
    observer(Progress::Begin {
        title: "race",
        length: 2,
        unit: "laws",
    });
    let theirs = run(&Trial::under(rival, &robot, &scenario), every)?;
    observer(Progress::Step);
    let own = Trial::under(law, &robot, &scenario);
    let ours = record(&own, names, &theirs, every, &results.folder)?;
    observer(Progress::End);
    let rival = theirs
        .last()
        .map_or_else(Racer::default, |(_, racer)| *racer);
    let race = Race {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        law: (names[0].to_owned(), ours),
        rival: (names[1].to_owned(), rival),
        folder: results.folder.clone(),
    };
    let json = serde_json::to_value(&race).map_err(Failure::work)?;
    results.save("race.json", &json)?;
    Ok(race)
}

/// Where a law's joints are at each picture, and how it has done by then; once more at its end.
fn run(trial: &Trial<'_>, every: u64) -> Result<Vec<([f64; MAX_DOF], Racer)>, Failure> {
    let (mut places, mut racer, mut q) = (Vec::new(), Racer::default(), [0.0; MAX_DOF]);
    let ended = trial.watch(|tick, error| {
        racer.add(tick, error, trial.robot);
        q = tick.plant_state.q;
        if tick.sensor.header.tick % every == 0 {
            places.push((q, racer));
        }
    });
    ended.map_err(Failure::input)?;
    places.push((q, racer));
    Ok(places)
}

/// Records a law's run with the rival of these places beside it; how the law did.
fn record(
    trial: &Trial<'_>,
    names: [&str; 2],
    rival: &[([f64; MAX_DOF], Racer)],
    every: u64,
    folder: &Path,
) -> Result<Racer, Failure> {
    let Trial {
        robot, scenario, ..
    } = trial;
    let run = format!("race-{}-{}", scenario.name, scenario.seed);
    let info = RunInfo {
        scenario,
        robot,
        run: &run,
        version: env!("CARGO_PKG_VERSION"),
        seed: scenario.seed,
        hops: None,
        lives: viz::Lives::default(),
    };
    let mut recording = Recording::create(folder, &info).map_err(Failure::work)?;
    let (mut ours, mut words, mut failed) = (Racer::default(), String::new(), None);
    let ended = trial.watch(|tick, error| {
        let number = tick.sensor.header.tick;
        ours.add(tick, error, robot);
        // A rival that is done stays where it is.
        let picture = (number / every) as usize;
        if number % every == 0
            && let Some((q, theirs)) = rival.get(picture).or(rival.last())
        {
            if (number / every).is_multiple_of(COUNTERS_EVERY) {
                words = counters(names, [&ours, theirs]);
            }
            recording.rival(number, q, &words);
        }
        let mut messages = tick.lent();
        if scenario.servo.is_none() {
            // The chain has a place for them in any run.
            (messages.target, messages.servo_state) = (None, None);
        }
        let drawn = recording.tick(&TickRow::new(number, messages));
        failed = failed.take().or(drawn.err());
    });
    ended.map_err(Failure::input)?;
    failed.map_or(Ok(()), |error| Err(Failure::work(error)))?;
    recording.finish().map_err(Failure::work)?;
    Ok(ours)
}

/// Both laws' numbers so far, as Markdown.
fn counters([law, rival]: [&str; 2], racers: [&Racer; 2]) -> String {
    let [ours, theirs] = racers.map(|racer| {
        let [turn, way] = [racer.orientation_max_deg, racer.position_max_mm].map(digits);
        let speed = percent(racer.speed_max_ratio);
        format!("off by at most **{turn}°** and **{way} mm**, joints at most at **{speed}** of their speed")
    });
    format!(
        "Solid: **{law}**, {ours}.  \nRed: **{rival}**, {theirs}.  \nThe same plant, seed and task.\n"
    )
}
