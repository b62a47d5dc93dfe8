//! From a tick to what is seen of it: THE function that the viewer's rows and the report's pictures are made of. PURE.

use glam::{Mat3, Vec3};
use shared_types::codes::{MODE_REGULAR, MODE_REORIENT, singularity_name};
use shared_types::messages::SingularityState;
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use crate::facts::Facts;
use crate::narration::{History, Moment, Words, colour_of};
use crate::pose::{Placement, Rgba, pose};
use crate::scene::{Mark, NullMotion};
use crate::signals::{Now, TickRow};
use crate::story::{News, Story};

/// A singularity of the arm.
#[derive(Clone, Debug)]
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) kind: u32,
    pub(crate) colour: Rgba,
}

/// A singularity's mark, and what has happened to ζ there.
#[derive(Clone, Debug)]
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
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    pub(crate) tick: u64,
    pub(crate) q: [f64; MAX_DOF],
    pub(crate) links: [Placement; MAX_DOF],
    pub(crate) hand: Placement,
    pub(crate) desired: Option<Placement>,
    pub(crate) signs: Vec<Sign>,
    pub(crate) words: Words,
    /// The present null-space motion: postures gone through, oldest first, and how far each joint has turned.
    pub(crate) postures: Vec<[f64; MAX_DOF]>,
    pub(crate) turned: [f64; MAX_DOF],
}

/// The turn of ζ since the arm entered a neighbourhood.
#[derive(Clone, Debug, Default)]
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
    pub(crate) named: Vec<Named>,
    /// The largest errors so far, mm and degrees.
    pub(crate) errors: [f64; 2],
    history: History,
    null: NullMotion,
    sweeps: [Sweep; MAX_SINGULARITIES],
}

/// Steps of ζ that are kept; degrees. Less than three of them are worth no picture.
const SWEEP_DEG: f32 = 8.0;
pub(crate) const FEW: usize = 2;
/// How far ζ is turned when the hand is free about the old one; degrees.
const FREE_DEG: f32 = 44.0;

impl Scene {
    pub(crate) fn new(facts: &Facts, story: Story) -> Self {
        Self {
            story,
            named: Vec::new(),
            errors: [0.0; 2],
            history: History::new(facts.stands_still),
            null: NullMotion::new(facts.length_m),
            sweeps: Default::default(),
        }
    }

    /// Takes a tick in, and tells what is new in it; the picture of a tick that has one.
    pub(crate) fn push(
        &mut self,
        facts: &Facts,
        row: &TickRow,
        tell: &mut dyn FnMut(u64, News),
    ) -> Option<Picture> {
        self.story.push(row, tell);
        self.history.push(row);
        if self.named.is_empty() {
            let all = row.singularities().iter().enumerate();
            let named = all.map(|(i, one)| Named {
                name: singularity_name(one.kind, i).to_owned(),
                kind: one.kind,
                colour: colour_of(one.kind, i),
            });
            self.named = named.collect();
        }
        let q = row.q().filter(|_| facts.is_pictured(row.tick))?;
        let now = Now::new(row, &facts.limits, None);
        for (angular, to_shown) in [1e3, 1f64.to_degrees()].into_iter().enumerate() {
            let parts = now.error(angular as u32).unwrap_or_default();
            let most = parts.into_iter().fold(0.0, f64::max) * to_shown;
            self.errors[angular] = self.errors[angular].max(most);
        }
        self.null.update(row);
        let hand = row.plant_state.map(|state| pose(&state.p_BE, &state.R_BE));
        let hand = hand.unwrap_or_else(|| facts.hand(q));
        let p_BC = row.singularity.map_or([0.0; 3], |report| report.p_BC);
        let all = row.singularities().iter().enumerate();
        let signs = all.map(|(i, one)| self.sign(facts, row, i, Mark::new(one, p_BC), &hand));
        Some(Picture {
            tick: row.tick,
            q: *q,
            links: facts.links(q),
            hand,
            desired: row.control_state.map(|d| pose(&d.p_BE_d, &d.R_BE_d)),
            signs: signs.collect(),
            words: self.words(facts, row),
            postures: self.null.postures.clone(),
            turned: self.null.turned,
        })
    }

    /// The events of a tick.
    pub(crate) fn words(&self, facts: &Facts, row: &TickRow) -> Words {
        let moment = Moment {
            row,
            history: &self.history,
            title: facts.title,
            joints: facts.joints(),
            rate_hz: facts.rate_hz,
            directions: facts.directions().min(facts.joints()),
            fault: self
                .story
                .fault(row.tick)
                .map(|fault| fault.headline.as_str()),
            pressed: Now::new(row, &facts.limits, None).pressed(),
        };
        moment.words()
    }

    fn sign(
        &mut self,
        facts: &Facts,
        row: &TickRow,
        i: usize,
        mark: Mark,
        hand: &Placement,
    ) -> Sign {
        let command = row.control_state;
        let mode = command.map_or(MODE_REGULAR, |state| state.mode[i]);
        let number = command.map_or(0, |state| state.segment as usize);
        let segment = facts.job.scenario.segment.get(number);
        let sweep = &mut self.sweeps[i];
        // It left as it came, or the task has gone on to something else.
        let is_over = segment.is_some() && sweep.segment.is_some_and(|of| of != number);
        if is_over || (!mark.is_inside() && sweep.freed.is_none()) {
            *sweep = Sweep::default();
        }
        let mut note = String::new();
        let turn = segment.and_then(|segment| segment.turn.as_ref());
        if let Some(R_0) = sweep.freed {
            note = "the old ζ is free again".to_owned();
            if let Some(turn) = turn {
                let (axis, angle) =
                    glam::Quat::from_mat3(&(hand.R * R_0.transpose())).to_axis_angle();
                let by = (angle * axis.dot(sweep.directions[0])).to_degrees().abs();
                sweep.segment = Some(number);
                note = format!("free again: {by:.0}°{}", of(Some(turn.by_deg)));
            }
        } else if mark.is_inside() {
            sweep.turn(mark.zeta());
            if sweep.directions.len() > FEW {
                let goal = segment.and_then(|one| one.reorient.as_ref());
                let goal = goal.filter(|turn| turn.singularity == self.named[i].name);
                let goal = of(goal.map(|turn| turn.by_deg));
                note = format!("ζ turned {:.0}°{goal}", sweep.turned_deg);
                let is_turning = mode == MODE_REORIENT;
                sweep.freed = (sweep.turned_deg > FREE_DEG && !is_turning).then_some(hand.R);
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
        let steps = self.directions.windows(2);
        let swept: f32 = steps.map(|pair| pair[0].angle_between(pair[1])).sum();
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
