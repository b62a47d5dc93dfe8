//! Two laws in one recording: the same plant, seed and task.

use std::path::{Path, PathBuf};

use chain::Tick;
use model::Robot;
use recorder::TaskError;
use serde::Serialize;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::MAX_DOF;
use shared_types::bounds::larger;
use shared_types::job::{Job, Mode};
use shared_types::scenario::Strategy;
use viz::digits;
use viz::{Happened, Rival, Source};

use crate::text::percent;
use crate::trial::Trial;

/// Pictures of both arms per second, as in every recording.
const PICTURE_HZ: u32 = 50;
/// How often the counters are written; pictures.
const COUNTERS_EVERY: usize = 10;

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
        length: 3,
        unit: "laws",
    });
    let solid = Trial::under(law, &robot, &scenario);
    let translucent = Trial::under(rival, &robot, &scenario);
    let [ours, theirs] = [&solid, &translucent].map(|trial| {
        let driven = run(trial, every);
        observer(Progress::Step);
        driven
    });
    let (ours, theirs) = (ours?, theirs?);
    let rival_drawn = Rival {
        every,
        postures: theirs.iter().map(|(q, _)| *q).collect(),
        words: words(names, [&ours, &theirs]),
    };
    record(&solid, &rival_drawn, &results.folder)?;
    observer(Progress::End);
    let last = |places: &[Picture]| places.last().map_or_else(Racer::default, |last| last.1);
    let race = Race {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        law: (names[0].to_owned(), last(&ours)),
        rival: (names[1].to_owned(), last(&theirs)),
        folder: results.folder.clone(),
    };
    let json = serde_json::to_value(&race).map_err(Failure::work)?;
    results.save("race.json", &json)?;
    Ok(race)
}

/// Where a law's joints are, and how it has done by then.
type Picture = ([f64; MAX_DOF], Racer);

/// The counters in each picture: of the law and its rival, which may have ended before.
fn words(names: [&str; 2], [ours, theirs]: [&[Picture]; 2]) -> Vec<String> {
    let mut words = Vec::<String>::new();
    for (picture, (_, racer)) in ours.iter().enumerate() {
        // Counters that change with each picture cannot be read.
        let held = words
            .last()
            .filter(|_| picture % COUNTERS_EVERY > 0)
            .cloned();
        let rival = theirs.get(picture).or(theirs.last());
        let rival = rival.map_or_else(Racer::default, |(_, racer)| *racer);
        words.push(held.unwrap_or_else(|| counters(names, [racer, &rival])));
    }
    words
}

/// A law's pictures; once more at its end.
fn run(trial: &Trial<'_>, every: u64) -> Result<Vec<Picture>, Failure> {
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

/// Draws the scenario's own law with the rival beside it.
fn record(trial: &Trial<'_>, rival: &Rival, folder: &Path) -> Result<(), Failure> {
    let Trial {
        robot, scenario, ..
    } = trial;
    let (graph, out) = (load::graph_of(scenario, None)?, folder.to_owned());
    let job = Job {
        run: format!("race-{}-{}", scenario.name, scenario.seed),
        ..load::job(robot, scenario.clone(), graph, Mode::Lockstep, out)
    };
    trial.shown(None, |ticks| {
        let source = Source {
            job: &job,
            robot,
            happened: Happened {
                rival: Some(rival),
                ..Happened::default()
            },
            ticks,
            progress: &mut |_| true,
        };
        let written = viz::write_rrd(&folder.join(viz::RECORDING), source);
        written.map(drop).map_err(Failure::work)
    })
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
