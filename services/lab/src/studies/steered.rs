//! Steered runs judged: random twists on many arms, and the reasons in the kept messages of a session.

use std::fmt;

use chain::Tick;
use control::singularity::family::Family;
use model::{Robot, with_dof};
use recorder::TaskError;
use serde::Serialize;
use session::load::Loaded;
use session::table::{number, table};
use session::{Failure, Observer, Steering};
use shared_types::bounds::{larger, share};
use shared_types::codes::{
    REASON_EFFORT, REASON_HELD, REASON_LIMIT, REASON_OVER, REASON_REACH, REASON_RESTING,
    REASON_SINGULARITY, REASON_STALE, REFUSALS, name_of, reason_text, singularity_name,
};
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;
use shared_types::{MAX_DOF, ServoState};
use viz::plot::digits;

use crate::pool::on_all_cores;
use crate::trial::Trial;

/// The arms of the study: of the built-in ones that serve all task axes the first of each family.
pub fn robots() -> Vec<&'static str> {
    let mut families = Vec::new();
    let mut robots = Vec::new();
    for name in Robot::builtin_names() {
        let robot = Robot::builtin(name)
            .ok()
            .filter(|robot| robot.task.is_full());
        let family = robot.and_then(|robot| with_dof!(robot.dof(), N => Family::<N>::of(&robot, &Analysis::default()).name()));
        if let Some(family) = family.filter(|family| !families.contains(family)) {
            families.push(family);
            robots.push(*name);
        }
    }
    robots
}

/// Share of the speed asked for below which an arm stands still, and for how long it may, s.
const STILL: (f64, f64) = (0.02, 0.5);
/// Largest error orthogonal to the singular directions, mm.
const ORTHOGONAL_MM: f64 = 0.5;
/// The same of orientation, degrees: the bound on the reference's lead, 0.02 rad, and what the position has beyond its own.
const ORTHOGONAL_DEG: f64 = 1.5;
/// Twist that asks for motion; m/s, rad/s.
const MOVES: f64 = 1e-3;

/// The findings on one arm over all its sessions.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Score {
    /// The arm.
    pub robot: String,
    /// Simulated time, s.
    pub seconds: f64,
    /// Largest share of a joint's speed.
    pub speed: f64,
    /// Largest share of a joint's torque.
    pub torque: f64,
    /// Largest change of a torque in a tick over what the drive accepts.
    pub step: f64,
    /// Sessions in which a joint left its range.
    pub limits: u64,
    /// Largest error orthogonal to the singular directions, mm and degrees.
    pub orthogonal_mm: f64,
    /// The same of orientation.
    pub orthogonal_deg: f64,
    /// Time stalled without a stated reason, s.
    pub stalled_s: f64,
    /// Time slowed before or at joint limits, s.
    pub limit_s: f64,
    /// Time at the boundary of reach, s.
    pub reach_s: f64,
    /// Time slowed by a singularity or a joint's speed or torque, s.
    pub slowed_s: f64,
    /// How often the law stopped for a moment.
    pub stops: u64,
    /// The worst events beyond the bars, the worst first, with their cause.
    pub events: Vec<Event>,
}

/// A moment at which a bar is not kept.
#[derive(Clone, Debug, Serialize)]
pub struct Event {
    /// How many times the bar; the events of a table are sorted by it.
    pub times: f64,
    /// Session, time, measure and the controller's reason.
    pub text: String,
}

/// Most events that are kept.
const EVENTS: usize = 10;

impl Score {
    /// Whether the bars are kept: no limit exceeded, no torque step beyond the rate, 0.5 mm, 1.5°, no stall without a reason.
    pub fn is_kept(&self) -> bool {
        self.speed <= 1.0
            && self.torque <= 1.0
            && self.step <= 1.0 + 1e-6
            && self.limits == 0
            && self.orthogonal_mm <= ORTHOGONAL_MM
            && self.orthogonal_deg <= ORTHOGONAL_DEG
            && self.stalled_s <= 0.0
    }

    fn add(&mut self, other: &Self) {
        self.events.extend(other.events.iter().cloned());
        self.events.sort_by(|a, b| b.times.total_cmp(&a.times));
        self.events.truncate(EVENTS);
        self.seconds += other.seconds;
        self.speed = larger(self.speed, other.speed);
        self.torque = larger(self.torque, other.torque);
        self.step = larger(self.step, other.step);
        self.limits += other.limits;
        self.orthogonal_mm = larger(self.orthogonal_mm, other.orthogonal_mm);
        self.orthogonal_deg = larger(self.orthogonal_deg, other.orthogonal_deg);
        self.stalled_s += other.stalled_s;
        self.limit_s += other.limit_s;
        self.reach_s += other.reach_s;
        self.slowed_s += other.slowed_s;
        self.stops += other.stops;
    }
}

/// Seeded random twists as a text of targets: every 1 to 3 s another direction, up to 0.25 m/s and 0.6 rad/s, at times one of the two alone.
pub fn twists(seed: u64, seconds: f64) -> String {
    let mut random = Uniform(seed);
    let mut text = "# armplane targets 1, length m\n".to_owned();
    let mut time = 0.0;
    while time < seconds {
        let lasts = random.within(1.0, 3.0).min(seconds - time);
        let mut direction = |most: f64| {
            let v: [f64; 3] = std::array::from_fn(|_| random.within(-1.0, 1.0));
            let size = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-3);
            let speed = random.within(0.2, 1.0) * most;
            v.map(|x| x / size * speed)
        };
        let (linear, angular) = (direction(0.25), direction(0.6));
        let kind = random.within(0.0, 4.0);
        let values = linear
            .map(|x| if kind < 1.0 { 0.0 } else { x })
            .into_iter()
            .chain(angular.map(|x| if kind > 3.0 { 0.0 } else { x }));
        let values: Vec<String> = values.map(|x| format!("{x:.4}")).collect();
        text += &format!("{time:.3}, twist, base, {lasts:.3}, {}\n", values.join(" "));
        time += lasts;
    }
    text + &format!("{seconds:.3}, end\n")
}

/// Sessions of random twists on each arm, the seeds from 1 on; the scores of each arm over all its sessions.
///
/// # Errors
/// [`Failure`] where an arm cannot be steered.
pub fn random(
    subjects: &[Steering],
    seeds: u64,
    seconds: f64,
    observer: Observer<'_>,
) -> Result<Vec<Score>, Failure> {
    let mut sessions = Vec::new();
    for subject in subjects {
        for seed in 1..=seeds {
            let targets = session::Targets::Text(twists(seed, seconds));
            let mut loaded = Steering {
                targets,
                duration_s: None,
                ..subject.clone()
            }
            .load()?;
            // Twists that know nothing of a floor: an arm that is pressed against one is no finding on the law.
            loaded.scenario.plant.floor_m = None;
            sessions.push((subject.subject.clone(), seed, loaded));
        }
    }
    let done = on_all_cores(
        "random twists",
        &sessions,
        |(_, seed, loaded)| score(loaded, *seed),
        observer,
    );
    let mut scores: Vec<Score> = Vec::new();
    for ((robot, ..), one) in sessions.iter().zip(done) {
        let one = one?;
        if scores.last().is_none_or(|score| score.robot != *robot) {
            scores.push(Score {
                robot: robot.clone(),
                ..Score::default()
            });
        }
        if let Some(score) = scores.last_mut() {
            score.add(&one);
        }
    }
    Ok(scores)
}

/// One session on one thread.
fn score(
    Loaded {
        scenario, robot, ..
    }: &Loaded,
    seed: u64,
) -> Result<Score, Failure> {
    let (dt, mut before, mut still) = (scenario.dt_s(), None::<[f64; MAX_DOF]>, 0.0);
    let mut score = Score {
        seconds: scenario.duration_s(),
        ..Score::default()
    };
    let mut worst: [Option<Event>; 5] = Default::default();
    let trial = Trial {
        robot,
        scenario: scenario.clone(),
        graph: None,
    };
    let verdict = trial.watch(|tick, error| {
        let state = &tick.servo_state;
        still = if stands(state) { still + dt } else { 0.0 };
        let stalled = if still > STILL.1 { still } else { 0.0 };
        let seconds = tick.torque.header.tick as f64 * dt;
        let kind = |place: usize| {
            tick.singularity
                .singularities
                .get(place)
                .map(|one| one.kind)
        };
        if stalled > 0.0 {
            score.stalled_s += dt;
        }
        let (speed, beyond) = score.take(robot, tick, before, dt);
        before = Some(tick.torque.tau);
        for (worst, (times, what)) in worst
            .iter_mut()
            .zip(excesses(error, speed, beyond, stalled))
        {
            if times > 1.0 && worst.as_ref().is_none_or(|worst| times > worst.times) {
                *worst = Some(Event {
                    times,
                    text: format!(
                        "seed {seed}, {seconds:.2} s: {what}; {}",
                        describe(state, kind)
                    ),
                });
            }
        }
        score.stops = u64::from(state.stops);
    });
    let verdict = verdict.map_err(Failure::input)?;
    score.speed = verdict.joints.speed_max_ratio;
    score.torque = verdict.joints.torque_max_ratio;
    (score.orthogonal_mm, score.orthogonal_deg) = (
        verdict.task.orthogonal_max_mm,
        verdict.task.orthogonal_max_deg,
    );
    score.events = worst.into_iter().flatten().collect();
    Ok(score)
}

/// Whether an arm stands though it is asked to move, and says nothing of why.
fn stands(state: &ServoState) -> bool {
    let stated = [
        REASON_LIMIT,
        REASON_REACH,
        REASON_RESTING,
        REASON_STALE,
        REASON_OVER,
        REASON_HELD,
    ];
    !stated.contains(&state.reason)
        && state.V_target.iter().any(|x| x.abs() > MOVES)
        && state.speed_scale < STILL.0
}

/// How many times the bar each measure of a tick is, in words: the largest share of a joint's speed, the distance beyond a range, rad, and the time stalled, s.
fn excesses(error: TaskError, speed: f64, beyond: f64, stalled: f64) -> [(f64, String); 5] {
    let (mm, deg) = (error.position[1], error.orientation[1]);
    // Beyond a range by so much is no worse than twice the bar of a degree.
    let any = |by: f64| if by > 0.0 { 1.0 + by } else { 0.0 };
    [
        (mm / ORTHOGONAL_MM, format!("{mm:.3} mm orthogonal to ζ")),
        (deg / ORTHOGONAL_DEG, format!("{deg:.3}° orthogonal to ζ")),
        (
            any(beyond),
            format!("a joint {beyond:.4} rad beyond its range"),
        ),
        (speed, format!("a joint at {speed:.3} of its speed")),
        (any(stalled), format!("stalled for {stalled:.2} s")),
    ]
}

impl Score {
    /// Takes a tick in; the largest share of a joint's speed in it, and the largest distance of a joint beyond its range, rad.
    fn take(
        &mut self,
        robot: &Robot,
        tick: &Tick,
        before: Option<[f64; MAX_DOF]>,
        dt: f64,
    ) -> (f64, f64) {
        let (mut speed, mut beyond) = (0.0_f64, 0.0_f64);
        for (i, joint) in robot.joints.iter().enumerate() {
            if let Some(before) = before {
                self.step = larger(
                    self.step,
                    share(tick.torque.tau[i] - before[i], joint.torque_rate * dt),
                );
            }
            let q = tick.plant_state.q[i];
            beyond = larger(beyond, (q - joint.upper).max(joint.lower - q));
            speed = larger(speed, share(tick.plant_state.qdot[i], joint.velocity));
        }
        self.limits |= u64::from(beyond > 0.0 || beyond.is_nan());
        let seconds = match tick.servo_state.reason {
            REASON_LIMIT => &mut self.limit_s,
            REASON_REACH => &mut self.reach_s,
            REASON_SINGULARITY | REASON_EFFORT => &mut self.slowed_s,
            _ => return (speed, beyond),
        };
        *seconds += dt;
        (speed, beyond)
    }
}

/// The state of a session as one line; `kind` gives the kind of the singularity in a place, by which it is called.
pub fn describe(state: &ServoState, kind: impl Fn(usize) -> Option<u32>) -> String {
    let mut text = reason_text(state.reason, state.joint, state.upper).to_string();
    if ![REASON_RESTING, REASON_STALE, REASON_OVER].contains(&state.reason) {
        text += &format!("; speed {:.0} %", state.speed_scale * 100.0);
    }
    let place = (state.singularity as usize).checked_sub(1);
    if let Some((place, kind)) = place
        .and_then(|place| Some((place, kind(place)?)))
        .filter(|_| state.nearest < 1e8)
    {
        text += &format!(
            "; {} at {:.2} of its bound",
            singularity_name(kind, place),
            state.nearest
        );
    }
    if state.stops > 0 {
        text += &format!(
            "; {} × stopped: {}",
            state.stops,
            name_of(REFUSALS, state.stop)
        );
    }
    text
}

/// A table of scores for people.
#[derive(Debug)]
pub struct ScoresText<'a>(pub &'a [Score]);

impl fmt::Display for ScoresText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let heads = [
            "robot",
            "s",
            "speed",
            "torque",
            "step",
            "limits",
            "⊥ ζ, mm",
            "⊥ ζ, °",
            "stalled",
            "limit",
            "reach",
            "stop",
        ];
        let mut rows = table(&heads);
        for score in self.0 {
            rows.add_row([
                score.robot.clone().into(),
                number(format!("{:.0}", score.seconds)),
                number(digits(score.speed)),
                number(digits(score.torque)),
                number(digits(score.step)),
                number(score.limits),
                number(digits(score.orthogonal_mm)),
                number(digits(score.orthogonal_deg)),
                number(digits(score.stalled_s)),
                number(digits(score.limit_s)),
                number(digits(score.reach_s)),
                number(score.stops),
            ]);
        }
        writeln!(f, "{rows}")?;
        writeln!(
            f,
            "speed, torque: largest share of a limit; step: largest change of torque in a tick over what the drive accepts; limits: sessions in \
             which a joint left its range; ⊥ ζ: largest error orthogonal to ζ (asked for: 0.5 mm, 1.5°)\n\
             stalled: seconds at less than 2 % of the speed asked for, for longer than 0.5 s, neither reach nor a joint limit the reason; limit, \
             reach: seconds slowed there; stop: stops; --json has more"
        )?;
        let events = self
            .0
            .iter()
            .flat_map(|score| score.events.iter().map(|event| (&score.robot, event)));
        for (robot, event) in events {
            writeln!(f, "{robot}, {}", event.text)?;
        }
        Ok(())
    }
}
