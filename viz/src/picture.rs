//! From a tick to what is seen of it: THE function that the viewer's rows and the report's pictures are made of. PURE.

use glam::{Affine3, Mat3, Vec3};
use shared_types::codes::MODE_REORIENT;
use shared_types::messages::SingularityState;
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use crate::eye::Room;
use crate::facts::Facts;
use crate::narration::{History, Moment, Words, mode};
use crate::pose::pose;
use crate::run::Tick;
use crate::scene::{Mark, NullMotion};
use crate::signals::Now;
use crate::story::{News, Story};

/// A singularity's mark, and what has happened to ζ there.
pub(crate) struct Sign {
    pub(crate) mark: Mark,
    pub(crate) mode: u32,
    /// ζ at successive steps since the arm entered.
    pub(crate) swept: Vec<Vec3>,
    /// Whether the hand can rotate about the old ζ again.
    pub(crate) is_free: bool,
    /// The words that go with it.
    pub(crate) note: String,
}

/// All that is seen of a tick.
pub(crate) struct Picture {
    pub(crate) tick: u64,
    pub(crate) q: [f64; MAX_DOF],
    pub(crate) links: [Affine3; MAX_DOF],
    pub(crate) hand: Affine3,
    pub(crate) desired: Option<Affine3>,
    pub(crate) signs: Vec<Sign>,
    pub(crate) words: Words,
    /// The present null-space motion: postures gone through, oldest first, and how far each joint has turned.
    pub(crate) postures: Vec<[f64; MAX_DOF]>,
    pub(crate) turned: [f64; MAX_DOF],
}

/// The turn of ζ since the arm entered a neighbourhood.
#[derive(Default)]
struct Sweep {
    directions: Vec<Vec3>,
    turned_deg: f32,
    /// The hand when ζ had been turned away, and the segment that has rotated it about the old ζ since.
    freed: Option<Mat3>,
    segment: Option<usize>,
}

/// A run so far, as pictures are made of it.
pub(crate) struct Scene {
    pub(crate) story: Story,
    pub(crate) room: Room,
    /// The largest errors so far, mm and degrees.
    pub(crate) errors: [f64; 2],
    history: History,
    null: NullMotion,
    sweeps: [Sweep; MAX_SINGULARITIES],
}

/// Pictures per second: enough for eyes.
const PICTURE_HZ: f64 = 50.0;
/// Steps of ζ that are kept; degrees. Less than three of them are worth no picture.
const SWEEP_DEG: f32 = 8.0;
pub(crate) const FEW: usize = 2;
/// How far ζ is turned when the hand is free about the old one; degrees.
const FREE_DEG: f32 = 44.0;

impl Scene {
    pub(crate) fn new(facts: &Facts) -> Self {
        Self {
            story: Story::new(facts),
            room: Room::default(),
            errors: [0.0; 2],
            history: History::default(),
            null: NullMotion::default(),
            sweeps: Default::default(),
        }
    }

    /// Takes a tick in, and tells what is new in it; the picture of a tick that has one.
    pub(crate) fn push(
        &mut self,
        facts: &Facts,
        row: &Tick,
        tell: &mut dyn FnMut(u64, News),
    ) -> Option<Picture> {
        self.story.push(row, tell);
        self.history.push(row);
        let is_pictured = row.tick.is_multiple_of(facts.every(1.0 / PICTURE_HZ));
        let q = row.q().filter(|_| is_pictured)?;
        let now = Now::new(row, facts);
        for (angular, to_shown) in [1e3, 1f64.to_degrees()].into_iter().enumerate() {
            let most = now
                .error(angular as u32)
                .unwrap_or_default()
                .into_iter()
                .fold(0.0, f64::max)
                * to_shown;
            self.errors[angular] = self.errors[angular].max(most);
        }
        self.null.update(row, facts.robot.length_m);
        let hand = row.plant_state.map(|state| pose(&state.p_BE, &state.R_BE));
        let hand = hand.unwrap_or_else(|| facts.hand(q));
        let count = row.singularities().len();
        let signs = (0..count).map(|i| self.sign(facts, row, i, &hand));
        let picture = Picture {
            tick: row.tick,
            q: *q,
            links: facts.links(q),
            hand,
            desired: row.control_state.map(|d| pose(&d.p_BE_d, &d.R_BE_d)),
            signs: signs.collect(),
            words: self.words(facts, row),
            postures: self.null.postures.clone(),
            turned: self.null.turned,
        };
        self.room.push(facts, &picture);
        Some(picture)
    }

    /// The events of a tick.
    pub(crate) fn words(&self, facts: &Facts, row: &Tick) -> Words {
        let fault = self.story.fault(row.tick);
        let moment = Moment {
            row,
            facts,
            history: &self.history,
            fault: fault.map(|fault| fault.headline.as_str()),
        };
        moment.words()
    }

    fn sign(&mut self, facts: &Facts, row: &Tick, i: usize, hand: &Affine3) -> Sign {
        let p_BC = row.singularity.map_or([0.0; 3], |report| report.p_BC);
        let mark = Mark::new(&row.singularities()[i], p_BC);
        let mode = mode(row, i);
        let number = row.control_state.map_or(0, |state| state.segment as usize);
        let segment = facts.job.scenario.segment.get(number);
        let sweep = &mut self.sweeps[i];
        // It left as it came, or the task has gone on to something else.
        let is_over = segment.is_some() && sweep.segment.is_some_and(|of| of != number);
        if is_over || (!mark.is_inside && sweep.freed.is_none()) {
            *sweep = Sweep::default();
        }
        let mut note = String::new();
        let turn = segment.and_then(|segment| segment.turn.as_ref());
        if let Some(R_0) = sweep.freed {
            note = "the old ζ is free again".to_owned();
            if let Some(turn) = turn {
                let (axis, angle) =
                    glam::Quat::from_mat3(&(hand.matrix3 * R_0.transpose())).to_axis_angle();
                let by = (angle * axis.dot(sweep.directions[0])).to_degrees().abs();
                sweep.segment = Some(number);
                note = format!("free again: {by:.0}°{}", of(Some(turn.by_deg)));
            }
        } else if mark.is_inside {
            sweep.turn(mark.zeta());
            if sweep.directions.len() > FEW {
                let goal = segment
                    .and_then(|one| one.reorient.as_ref())
                    .filter(|turn| turn.singularity == self.story.named[i].name);
                let goal = of(goal.map(|turn| turn.by_deg));
                note = format!("ζ turned {:.0}°{goal}", sweep.turned_deg);
                let is_turning = mode == MODE_REORIENT;
                sweep.freed = (sweep.turned_deg > FREE_DEG && !is_turning).then_some(hand.matrix3);
            }
        }
        Sign {
            mark,
            mode,
            swept: sweep.directions.clone(),
            is_free: sweep.freed.is_some(),
            note,
        }
    }
}

impl Sweep {
    /// ζ is a line: its sign may be either.
    fn turn(&mut self, zeta: Vec3) {
        let Some(last) = self.directions.last() else {
            self.directions.push(zeta);
            return;
        };
        let zeta = zeta * last.dot(zeta).signum();
        let swept: f32 = self
            .directions
            .windows(2)
            .map(|pair| pair[0].angle_between(pair[1]))
            .sum();
        let step = last.angle_between(zeta);
        self.turned_deg = (swept + step).to_degrees();
        if step.to_degrees() > SWEEP_DEG {
            self.directions.push(zeta);
        }
    }
}

/// The part of words that names a goal.
fn of(goal: Option<f64>) -> String {
    goal.map_or(String::new(), |by_deg| format!(" of {:.0}°", by_deg.abs()))
}

/// |s| over the width of its neighbourhood.
pub(crate) fn nearness(one: &SingularityState) -> f64 {
    one.s.abs() / one.eta_in.max(1e-12)
}
