//! Two laws in one recording: the same plant, seed and task.

use std::path::{Path, PathBuf};

use model::Robot;
use recorder::Judge;
use serde::Serialize;
use session::{Failure, Observer, Progress, Results, load};
use shared_types::bounds::larger;
use shared_types::scenario::{Scenario, Strategy};
use viz::{Recording, RunInfo, TickRow};

use super::law::under;

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

/// The rival's data of one tick.
struct Place {
    q: [f64; shared_types::MAX_DOF],
    racer: Racer,
}

impl Racer {
    fn tick(&mut self, tick: &chain::Tick, robot: &Robot, judge: &mut Judge) {
        let lent = tick.lent();
        if let Some(tick) = recorder::Tick::of(&lent) {
            let error = judge.tick(tick);
            self.position_max_mm = larger(self.position_max_mm, error.position[0]);
            self.orientation_max_deg = larger(self.orientation_max_deg, error.orientation[0]);
        }
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
    if law == rival {
        return Err(Failure::Input(format!(
            "{} runs under {} already: name another law with --law",
            scenario.name,
            law.name()
        )));
    }
    let results = Results::create(out, "race")?;
    let every = u64::from((scenario.rate_hz / PICTURE_HZ).max(1));
    observer(Progress::Begin {
        title: "race",
        length: 2,
        unit: "laws",
    });
    let places = rival_places(&robot, &under(&scenario, rival), every)?;
    observer(Progress::Step);

    let run = format!("race-{}-{}", scenario.name, scenario.seed);
    let info = RunInfo {
        scenario: &scenario,
        robot: &robot,
        run: &run,
        version: env!("CARGO_PKG_VERSION"),
        seed: scenario.seed,
        hops: None,
        lives: viz::Lives::default(),
    };
    let mut recording = Recording::create(&results.folder, &info).map_err(Failure::work)?;
    let mut judge = Judge::new(&robot, &scenario).map_err(Failure::input)?;
    let (mut racer, mut words, mut failed) = (Racer::default(), String::new(), None);
    let names = [law.name(), rival.name()];
    chain::run(&robot, &scenario, |tick| {
        let number = tick.sensor.header.tick;
        racer.tick(tick, &robot, &mut judge);
        // A rival that is done stays where it is.
        if number % every == 0
            && let Some(place) = places.get((number / every) as usize).or(places.last())
        {
            if (number / every) % COUNTERS_EVERY == 0 {
                words = counters(names, [&racer, &place.racer]);
            }
            recording.rival(number, &place.q, &words);
        }
        let mut messages = tick.lent();
        if scenario.servo.is_none() {
            // The chain has a place for them in any run.
            (messages.target, messages.servo_state) = (None, None);
        }
        failed = failed
            .take()
            .or(recording.tick(&TickRow::new(number, messages)).err());
    })
    .map_err(Failure::input)?;
    failed.map_or(Ok(()), |error| Err(Failure::work(error)))?;
    recording.finish().map_err(Failure::work)?;
    observer(Progress::End);
    let end = places.last().map(|place| place.racer).unwrap_or_default();
    let race = Race {
        scenario: scenario.name.clone(),
        seed: scenario.seed,
        law: (names[0].to_owned(), racer),
        rival: (names[1].to_owned(), end),
        folder: results.folder.clone(),
    };
    results.save(
        "race.json",
        &serde_json::to_value(&race).map_err(Failure::work)?,
    )?;
    Ok(race)
}

/// Where the rival's joints are at each picture, and how it has done by then.
fn rival_places(robot: &Robot, scenario: &Scenario, every: u64) -> Result<Vec<Place>, Failure> {
    let mut judge = Judge::new(robot, scenario).map_err(Failure::input)?;
    let (mut places, mut racer) = (Vec::new(), Racer::default());
    chain::run(robot, scenario, |tick| {
        racer.tick(tick, robot, &mut judge);
        if tick.sensor.header.tick % every == 0 {
            places.push(Place {
                q: tick.plant_state.q,
                racer,
            });
        }
    })
    .map_err(Failure::input)?;
    Ok(places)
}

/// Both laws' numbers so far, as Markdown.
fn counters([law, rival]: [&str; 2], racers: [&Racer; 2]) -> String {
    let row = |what: &str, of: fn(&Racer) -> String| {
        format!("| {what} | **{}** | {} |\n", of(racers[0]), of(racers[1]))
    };
    let mut words = format!(
        "## Solid: {law}. Red: {rival}\n\n| so far, at most | {law} | {rival} |\n|---|---|---|\n"
    );
    words += &row("hand turned off its path", |racer| {
        angle(racer.orientation_max_deg)
    });
    words += &row("hand moved off its path", |racer| {
        length(racer.position_max_mm)
    });
    words += &row("joint speed, of the limit", |racer| {
        format!("{:.0} %", 100.0 * racer.speed_max_ratio)
    });
    words + "\n*The same plant, seed and task. Green: the reference of the solid arm.*\n"
}

fn angle(deg: f64) -> String {
    if deg < 0.1 {
        format!("{deg:.3}°")
    } else {
        format!("{deg:.1}°")
    }
}

fn length(mm: f64) -> String {
    if mm < 1.0 {
        format!("{mm:.2} mm")
    } else {
        format!("{mm:.1} mm")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_show_both_laws() {
        let ours = Racer {
            position_max_mm: 0.023,
            orientation_max_deg: 0.006,
            speed_max_ratio: 0.28,
        };
        let theirs = Racer {
            position_max_mm: 12.5,
            orientation_max_deg: 4.42,
            speed_max_ratio: 1.02,
        };
        let words = counters(["blended", "damped-least-squares"], [&ours, &theirs]);
        for expected in [
            "**0.006°** | 4.4°",
            "**0.02 mm** | 12.5 mm",
            "**28 %** | 102 %",
        ] {
            assert!(words.contains(expected), "{expected}: {words}");
        }
    }
}
