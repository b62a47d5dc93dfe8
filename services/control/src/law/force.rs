//! Forces of the hand: along one direction the force is controlled, about some axes the moment, in all other directions the motion (+).
//!
//! Along the unit vector e the hand presses with the measured force f = −eᵀF; f_s is the set-point, which rises within a ramp, k the surface's stiffness.
//!
//! ```text
//! δ̂' = ẋ_e − v̂ + 2ω_o(f/k − δ̂),   v̂' = −ω_o²(f/k − δ̂)        v̂: speed at which the surface gives way or slopes
//! v   = ½ω(f_s − f)/k + ω_i∫½ω(f_s − f)/k dt                   within ± the speed of the approach; before a contact that speed
//! approach ≤ e·ω·f_s/k                                           a contact met at v rises by k·v/(e·ω): by the set-point at most
//! a*·e = 2ω(v + v̂ − ẋ_e)                                        in the place of the path's
//! Γ  += −JᵀF                                                     bears the contact
//! ```
//!
//! So a force error is an error of depth with a critically damped answer, whatever the hand weighs in this posture. The contact is borne at once; therefore
//! it moves the hand in no direction, and a* of the kept rows (Eq. 3) is what accelerates it: neither does a force error move the hand across e nor a motion
//! across e press (test `force_and_motion_are_decoupled`). Along a lost direction ζ only an auxiliary coordinate moves the hand: it is led to where the force
//! has the hand ([`singular_rows`](super::singular_rows)), and until it is there, or where no posture leads there, the part of e that is left serves the
//! force alone, and the hand leaves its path (test `in_a_lock_what_is_left_of_the_axis_serves_the_force`). What lies along ζ itself the structure bears.
//!
//! A moment about an axis is controlled alike from the first contact on, with ω_e, m and k·r²/2 in the places of ẋ_e, f and k, r the radius of the hand's
//! face; it turns the hand about E, which stays on its path. Set-points of moments rise with the force. What a singularity takes of their axes follows the
//! path (scenario `wipe-through-wrist-lock` with a face: `services/chain/tests/bars.rs`).
//!
//! The estimator knows F too, so the disturbance torque that is compensated is friction and a wrong mass alone. Without a sensor at the wrist that torque
//! contains the contact, and its compensation bears it.

use crate::centre::PoseMotion;
use crate::controller::Setup;
use crate::linear::{
    Joints, Matrix3, Vector3, Vector6, angular, linear, rotation_exp, smoothstep, stack,
};
use crate::paper::operational_space::Cholesky;
use crate::reference::free_axis::rotation_error;
use crate::reference::path::{Path, Progress};
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::{Refusal, Report};
use model::{Pose, Terms};
use shared_types::TargetContent;
use shared_types::checkpoints::ForceCheckpoint;
use shared_types::codes::FRAME_HAND;
use shared_types::scenario::{Direction, Force, Scenario, Strategy};
use std::array;

/// With a sensor.
const BY_SENSOR: Tuning = Tuning {
    omega: 40.0,
    omega_o: 150.0,
    felt_s: 0.004,
};
/// With the observer's force, which comes later and is noisier.
const BY_OBSERVER: Tuning = Tuning {
    omega: 10.0,
    omega_o: 30.0,
    felt_s: 0.1,
};
/// Share of the approach's speed with which the rim of a face may move while the hand turns.
const TURNING: f64 = 0.3;
/// Cosine of the angle by which a force's axis may turn in a tick and be the same: 30°.
pub(crate) const SAME_AXIS: f64 = 0.866;
/// ω_i, 1/s.
const INTEGRAL: f64 = 5.0;
/// Share of the force from which on there is a contact, and the least such force, N.
const TOUCH: (f64, f64) = (0.1, 0.7);
/// Share of the force within which it counts as reached, and for how long, s.
pub(crate) const REACHED: (f64, f64) = (0.1, 0.05);
/// How long the force is away before a contact is lost, s.
const LOST_S: f64 = 0.02;
/// How long a segment waits for its force, s, or this many times as long as a slow approach takes.
const PATIENCE_S: f64 = 10.0;
const PATIENCE: f64 = 2.0;
/// Least ticks within 1/ω and 1/ω_o.
const TICKS: (f64, f64) = (5.0, 1.33);
/// Largest stiffness k·dt²/Λ whose contact, borne two ticks late, keeps twofold from swinging up: that is at π²/8.
const STIFFEST: f64 = 0.6;
/// Share of an axis that an arm need not serve.
const UNSERVED: f64 = 1e-3;
/// Cosine between e and what is left of it, from which on that serves the force in part, and in full: the hand leaves its path by the tangent of the angle.
const LEFT: (f64, f64) = (0.2, 0.4);
/// Least mobility along e with which a force is told from a disturbance, 1/kg.
const MOBILITY: f64 = 1e-6;

/// The forces of a scenario, by segment; of a steered run the terms on which targets press.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Forces(Vec<Option<Wanted>>);

/// Most moments of a force.
const MOMENTS: usize = 3;
const NO_MOMENTS: [(Direction, f64); MOMENTS] = [(([0.0; 3], false), 0.0); MOMENTS];

/// A force, its direction, and the moments with it.
#[derive(Clone, Debug, PartialEq)]
struct Wanted {
    force: Force,
    direction: Direction,
    /// The axes of the moments, and the set-points, N·m; zero beyond their number.
    moments: [(Direction, f64); MOMENTS],
    /// Radius of the hand's face, m; zero: it touches with a point.
    face_m: f64,
}

/// A force that is asked for at a tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Press<'a> {
    /// On which terms.
    wanted: &'a Wanted,
    /// Set-point, N.
    pub(crate) newtons: f64,
    /// Direction, base axes.
    pub(crate) e: Vector3,
    /// Axes of the moments, base axes, zero beyond their number.
    about: [Vector3; MOMENTS],
}

/// How far a segment's force is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// Nothing was met yet.
    #[default]
    Seeking,
    /// In contact; the path waits for the force.
    Rising,
    /// The path goes on.
    Moving,
    /// The same, but the contact is lost.
    Lost,
}

const STAGES: [Stage; 4] = [Stage::Seeking, Stage::Rising, Stage::Moving, Stage::Lost];

/// The state of a force from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pressing {
    /// 1 + index of the segment.
    leg: usize,
    stage: Stage,
    set_n: f64,
    felt_n: f64,
    /// Direction of the tick before, base axes.
    e: Vector3,
    /// The newest wrench of the wrist's sensor about E, base axes; of a steered run without one the observer's; N, N·m.
    pub(crate) wrist: Vector6,
    /// Along the force.
    along: Compliance,
    /// About the axes of the moments, and whether the hand gives way about them: from its first contact on.
    about: [Compliance; MOMENTS],
    turns: bool,
    /// A moment is not reached yet: off by more than a tenth of the force at the rim.
    is_off: bool,
    /// Place along e from which a surface is looked for, m.
    from_m: f64,
    waited_s: f64,
    lasted_s: f64,
}

/// How the hand gives way along an axis, or about one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Compliance {
    /// δ̂, m or rad.
    depth: f64,
    /// v̂, m/s or rad/s.
    surface_speed: f64,
    /// Of the error, as a speed.
    integral: f64,
}

/// Set-point and measurements of an axis: a force, N, and speeds, m/s; or a moment, N·m, and rad/s.
#[derive(Clone, Copy, Debug)]
struct Along {
    set: f64,
    felt: f64,
    speed: f64,
    stiffness: f64,
    /// Bound on the speed that answers to the error.
    fastest: f64,
}

impl Compliance {
    /// v + v̂ after a tick of `dt` s.
    fn step(&mut self, axis: &Along, tuning: &Tuning, dt: f64) -> f64 {
        let apart = axis.felt / axis.stiffness - self.depth;
        let Tuning { omega, omega_o, .. } = *tuning;
        self.depth += (axis.speed - self.surface_speed + 2.0 * omega_o * apart) * dt;
        self.surface_speed -= omega_o * omega_o * apart * dt;
        let v = 0.5 * omega * (axis.set - axis.felt) / axis.stiffness;
        let within = (v + self.integral).clamp(-axis.fastest, axis.fastest);
        // Where the bound acts, the error is not the integral's to mend.
        if within == v + self.integral {
            self.integral += INTEGRAL * v * dt;
        }
        within + self.surface_speed
    }
}

/// How quickly a force is answered.
#[derive(Clone, Copy, Debug)]
struct Tuning {
    /// ω, 1/s.
    omega: f64,
    /// ω_o, 1/s.
    omega_o: f64,
    /// Time constant of the force by which a contact is told, s.
    felt_s: f64,
}

impl Tuning {
    /// That of a sensor or of the observer, as quick as a tick of `dt` s allows.
    fn of(has_sensor: bool, dt: f64) -> Self {
        let base = if has_sensor { BY_SENSOR } else { BY_OBSERVER };
        Self {
            omega: base.omega.min(1.0 / (TICKS.0 * dt)),
            omega_o: base.omega_o.min(1.0 / (TICKS.1 * dt)),
            ..base
        }
    }

    /// The acceleration by which the hand, which has the speed `now`, takes up another; m/s² or rad/s².
    fn acceleration(&self, speed: f64, now: f64) -> f64 {
        2.0 * self.omega * (speed - now)
    }

    /// Speed of the approach, m/s: the impact on a surface as stiff as stated is at most twice the set-point.
    fn approach(&self, press: &Press<'_>) -> f64 {
        let Force {
            stiffness_n_m,
            approach_m_s,
            ..
        } = press.wanted.force;
        let gentle = std::f64::consts::E * self.omega * press.newtons / stiffness_n_m;
        approach_m_s.min(gentle)
    }
}

/// The measurements along e at a tick.
#[derive(Clone, Copy, Debug)]
struct Felt {
    force_n: f64,
    speed: f64,
    place_m: f64,
}

impl Wanted {
    /// So many newtons along a direction, and the moments, for a hand that is turned by `R_BE`; `None` of no force.
    fn press(&self, newtons: f64, direction: Direction, R_BE: &Matrix3) -> Option<Press<'_>> {
        let turned = |(axis, of_tool): Direction| match of_tool {
            true => R_BE * Vector3::from(axis),
            false => axis.into(),
        };
        (newtons > 0.0).then(|| Press {
            wanted: self,
            newtons,
            e: turned(direction),
            about: self.moments.map(|(axis, _)| turned(axis)),
        })
    }
}

impl Forces {
    /// Those of a scenario.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        let face_m = scenario.plant.face_radius_m;
        let force = |force: &Force| {
            let mut moments = NO_MOMENTS;
            for (place, one) in moments.iter_mut().zip(&force.moments) {
                *place = (one.direction()?, one.newton_metres);
            }
            Some(Wanted {
                force: force.clone(),
                direction: force.direction()?,
                moments,
                face_m,
            })
        };
        if !scenario.presses() {
            return Self::default();
        }
        if let Some(session) = &scenario.servo {
            return Self(vec![Some(Wanted {
                force: Force::on(session.stiffness_n_m),
                direction: ([0.0; 3], false),
                moments: NO_MOMENTS,
                face_m,
            })]);
        }
        let segments = scenario.segment.iter();
        let forces = segments.map(|one| one.force.as_ref().and_then(force));
        Self(forces.collect())
    }

    /// Whether no segment has a force.
    #[inline]
    pub(crate) fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// The force of a leg, and its direction for a hand that is turned by `R_BE`.
    pub(crate) fn at(&self, leg: usize, R_BE: &Matrix3) -> Option<Press<'_>> {
        let wanted = self.0.get(leg)?.as_ref()?;
        wanted.press(wanted.force.newtons, wanted.direction, R_BE)
    }

    /// The force of a target, for a hand that is turned by `R_BE`; `None`: it has none, or there is nothing to press on.
    pub(crate) fn of_target(&self, target: &TargetContent, R_BE: &Matrix3) -> Option<Press<'_>> {
        let force = Vector3::from(target.force);
        let newtons = force.norm();
        let direction = ((force / newtons).into(), target.force_frame == FRAME_HAND);
        let wanted = self.0.first()?.as_ref()?;
        wanted.press(newtons, direction, R_BE)
    }

    /// Moves on by `dt_s` on the path. A leg after one with a force begins where the surface has left the hand.
    pub(crate) fn advance<const N: usize>(
        &self,
        path: &Path,
        progress: &mut Progress,
        dt_s: f64,
        report: &Report<N>,
        X_BE: &Pose,
    ) {
        let before = progress.leg;
        path.advance(progress, dt_s, report);
        if let Some(press) = self.at(before, &X_BE.R)
            && progress.leg != before
        {
            progress.start.p += press.along(&(X_BE.p - progress.start.p));
            progress.start.R = press.turned(&progress.start.R, &X_BE.R);
            // Its goal may be a place.
            progress.begun = false;
            path.advance(progress, 0.0, report);
        }
    }

    /// Puts the hand's own motion along e and about the axes of the moments in place of the path's into the desired motion of E.
    #[inline(never)]
    pub(crate) fn free<const N: usize>(
        &self,
        state: &State<N>,
        desired: &mut PoseMotion,
        now: &Now<'_, N>,
    ) {
        let Now { terms, qdot, .. } = *now;
        let Some(press) = self.press(state, now) else {
            return;
        };
        let own = |V: Vector6| V - press.across(&V);
        desired.p += press.along(&(terms.X_BE.p - desired.p));
        desired.R = press.turned(&desired.R, &terms.X_BE.R);
        desired.V += own(terms.J * qdot - desired.V);
        desired.a -= own(desired.a);
    }

    /// The force of this tick. The axes of its moments as far as they are left: what is lost of them follows the path.
    fn press<const N: usize>(&self, state: &State<N>, now: &Now<'_, N>) -> Option<Press<'_>> {
        let R_BE = &now.terms.X_BE.R;
        if state.targets.presses {
            return self.of_target(&state.targets.held, R_BE);
        }
        let mut press = self.at(state.progress.leg, R_BE)?;
        for axis in &mut press.about {
            *axis *= if state.force.turns {
                left(now, axis).sqrt()
            } else {
                0.0
            };
        }
        Some(press)
    }

    /// Whether an arm can press as a target asks: its joints hold the force, each with up to its `effort`, N·m, and there is something to press on that is not
    /// too stiff for ticks of `dt` s.
    pub(crate) fn can_press<const N: usize>(
        &self,
        target: &TargetContent,
        terms: &Terms<N>,
        effort: &Joints<N>,
        dt: f64,
    ) -> bool {
        self.of_target(target, &terms.X_BE.R).is_some_and(|press| {
            let row = pressing_row(terms, &press.e);
            let (_, most) = strongest(terms, effort, &row);
            let stiffness_n_m = press.wanted.force.stiffness_n_m;
            (Force::LEAST_N..=most).contains(&press.newtons)
                && stiffest(terms, &row, dt).is_some_and(|most| stiffness_n_m <= most)
        })
    }

    /// A force that the arm cannot exert in this posture, in words: by a law that controls none, along an axis that its task does not serve, or stronger
    /// than the joints hold beside the arm's weight.
    pub(crate) fn impossible<const N: usize>(
        &self,
        terms: &Terms<N>,
        effort: &Joints<N>,
        strategy: Strategy,
        task: &[bool; 6],
        dt: f64,
    ) -> Option<String> {
        if !self.are_none() && !strategy.is_ours() && strategy != Strategy::OperationalSpace {
            let name = strategy.name();
            return Some(format!(
                "the law {name} controls no force: take blended, chang-khatib or operational-space"
            ));
        }
        (0..self.0.len()).find_map(|leg| {
            let press = self.at(leg, &terms.X_BE.R)?;
            let (force, e) = (&press.wanted.force, press.e);
            let is_unserved = |axis: &Vector3, first: usize| {
                (0..3).any(|i| !task[first + i] && axis[i].abs() > UNSERVED)
            };
            if is_unserved(&e, 0) {
                return Some(format!(
                    "segment {leg} presses along `{}`, and the arm's task does not serve all of that axis: press along another one",
                    force.axis
                ));
            }
            let twists = press.about.iter().zip(&force.moments);
            for (about, moment) in twists {
                let row = terms.J.fixed_rows::<3>(3).tr_mul(about);
                let (joint, most) = strongest(terms, effort, &(row * moment.newton_metres.signum()));
                let stiffest = stiffest(terms, &row, dt)?;
                let why = if is_unserved(about, 3) {
                    "the arm's task does not serve all of that axis: take another one".to_owned()
                } else if most < moment.newton_metres.abs() {
                    format!(
                        "joint {} holds {:.2} N·m in the start posture: ask for less",
                        joint + 1,
                        most.max(0.0)
                    )
                } else if press.turning_stiffness() > stiffest {
                    let smaller_m = (2.0 * stiffest / force.stiffness_n_m).sqrt();
                    format!("would swing up: take a face of {smaller_m:.2} m at most, or raise rate_hz")
                } else {
                    continue;
                };
                return Some(format!(
                    "segment {leg} controls a moment about `{}`, and {why}",
                    moment.axis
                ));
            }
            let row = pressing_row(terms, &e);
            let (joint, most) = strongest(terms, effort, &row);
            let stiffest = stiffest(terms, &row, dt)?;
            if force.stiffness_n_m > stiffest {
                return Some(format!(
                    "segment {leg} presses on {} N/m, and at {:.0} Hz the hand would bounce off what is stiffer than {stiffest:.0} N/m: raise rate_hz",
                    force.stiffness_n_m,
                    1.0 / dt
                ));
            }
            (most < force.newtons).then(|| {
                format!(
                    "segment {leg} asks for a force of {} N, and joint {} holds {:.1} N in the start posture: ask for less, or start in another posture",
                    force.newtons,
                    joint + 1,
                    most.max(0.0)
                )
            })
        })
    }
}

impl Press<'_> {
    /// A pose error, or a twist, without what is along e or about the axes of the moments.
    pub(crate) fn across(&self, V: &Vector6) -> Vector6 {
        let (v, omega) = (linear(V), angular(V));
        stack(&(v - self.along(&v)), &(omega - self.turn(&omega)))
    }

    /// The share of a vector that is along e.
    pub(crate) fn along(&self, v: &Vector3) -> Vector3 {
        self.e * self.e.dot(v)
    }

    /// The share of a rotation, or of its rate, that is about the axes of the moments.
    fn turn(&self, omega: &Vector3) -> Vector3 {
        self.about.iter().map(|axis| axis * axis.dot(omega)).sum()
    }

    /// `R_d`, turned about the axes of the moments to where `R` is.
    fn turned(&self, R_d: &Matrix3, R: &Matrix3) -> Matrix3 {
        if self.about[0] == Vector3::zeros() {
            return *R_d;
        }
        let turn = rotation_error(R_d, R, None);
        rotation_exp(&(turn - self.turn(&turn))) * R
    }

    /// The moments that are off their set-points, about each axis, under the wrench `F` on the hand; N·m.
    pub(crate) fn off_nm(&self, F: &Vector6) -> [f64; MOMENTS] {
        array::from_fn(|i| -self.about[i].dot(&angular(F)) - self.wanted.moments[i].1)
    }

    /// Stiffness of a surface against a turn of the face that lies on it, k·r²/2; N·m/rad.
    fn turning_stiffness(&self) -> f64 {
        let Wanted { force, face_m, .. } = self.wanted;
        0.5 * force.stiffness_n_m * face_m * face_m
    }

    /// The directions of the force and of the moments, as twists; zero beyond their number.
    pub(crate) fn axes(&self) -> [Vector6; 1 + MOMENTS] {
        let [a, b, c] = self.about.map(|axis| stack(&Vector3::zeros(), &axis));
        [stack(&self.e, &Vector3::zeros()), a, b, c]
    }

    /// Time in which the set-point rises, s.
    pub(crate) fn ramp_s(&self) -> f64 {
        self.wanted.force.ramp_s
    }

    /// Whether a moment is asked for.
    pub(crate) fn twists(&self) -> bool {
        !self.wanted.force.moments.is_empty()
    }
}

/// The joint that holds least along `row`, and the force that it holds: the largest f with |g_i + f·row_i| ≤ limit_i, N.
fn strongest<const N: usize>(
    terms: &Terms<N>,
    effort: &Joints<N>,
    row: &Joints<N>,
) -> (usize, f64) {
    let most = |i: usize| {
        let room = effort[i] - terms.gravity[i] * row[i].signum();
        room / row[i].abs().max(1e-9)
    };
    let joints = (0..N).map(|i| (i, most(i)));
    let least = joints.min_by(|a, b| a.1.total_cmp(&b.1));
    least.unwrap_or((0, f64::INFINITY))
}

/// The stiffest surface on which the arm stays along `row` with ticks of `dt` s, N/m or N·m/rad; `None` of a mass matrix that has no inverse.
fn stiffest<const N: usize>(terms: &Terms<N>, row: &Joints<N>, dt: f64) -> Option<f64> {
    let (_, mobility) = response(terms, row).ok()?;
    Some(STIFFEST / (mobility * dt * dt))
}

/// J_eᵀ: the row of the velocity of E along e.
fn pressing_row<const N: usize>(terms: &Terms<N>, e: &Vector3) -> Joints<N> {
    terms.J.fixed_rows::<3>(0).tr_mul(e)
}

/// The force's part of a tick: a* along e.
///
/// # Errors
/// [`Refusal::Contact`] where nothing is met, [`Refusal::Bounce`] where the hand is thrown off again and again, [`Refusal::Pressing`] where the force does not
/// come about; [`Refusal::Singular`] of a mass matrix that has no inverse.
#[inline(never)]
pub(crate) fn control<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
    motion: &mut Motion<N>,
) -> Result<(), Refusal> {
    let wrist = now.wrist.copied().unwrap_or(state.force.wrist);
    let leg = state.progress.leg;
    let Some(press) = setup.forces.press(state, now) else {
        state.force = Pressing::touching(wrist);
        return Ok(());
    };
    state.force.wrist = wrist;
    let e = press.e;
    let row = pressing_row(now.terms, &e);
    let has_sensor = setup.scenario.plant.wrist_sensor;
    let felt = Felt {
        // A reference arm touches nothing: the force is that of the arm that follows it.
        force_n: if has_sensor || state.targets.presses {
            -e.dot(&linear(&wrist))
        } else {
            unexplained(now.terms, &row, now.tau_disturbance)?
        },
        speed: row.dot(now.qdot),
        place_m: e.dot(&now.terms.X_BE.p),
    };
    let dt = setup.scenario.dt_s();
    let tuning = Tuning::of(has_sensor, dt);
    let v = (state.force).step(&press, leg, &felt, &tuning, dt)?;
    let along = |x: f64| stack(&(e * x), &Vector3::zeros());
    let a = tuning.acceleration(v, felt.speed);
    let (alpha, turning) = (state.force).twist(&press, &wrist, now, &tuning, dt);
    let r = now.terms.X_BE.R * now.p_EC;
    motion.a += stack(&alpha.cross(&r), &alpha);
    let served;
    (motion.a, served) = serve(now, &(motion.a + along(a)), &e, a);
    // Positions lead the auxiliary coordinates to what is left, which they reach at the rate k_aux.
    let ahead_m = v / setup.scenario.control.k_aux * (1.0 - served);
    let on_path = setup.path.place(&state.progress).moving(0.0, 0.0).p;
    motion.off_path = along(felt.place_m - e.dot(&on_path) + ahead_m);
    motion.error += along(ahead_m);
    motion.desired.V -= along(felt.speed) + stack(&turning.cross(&r), &turning);
    Ok(())
}

/// The acceleration `a` of C where a part of e is lost: the part that is left moves the hand along e by `along`, m/s², whatever path lies across e.
///
/// Also the share in which it does so: none where hardly any of e is left.
fn serve<const N: usize>(now: &Now<'_, N>, a: &Vector6, e: &Vector3, along: f64) -> (Vector6, f64) {
    let left = now.report.listed().iter().fold(*e, |left, s| {
        let axis = linear(&s.zeta_B);
        let lost = 1.0 - s.openness(s.s);
        left - axis * (axis.dot(&left) * lost)
    });
    if left == *e {
        return (*a, 1.0);
    }
    let u = left / left.norm().max(1e-9);
    let share = smoothstep((u.dot(e) - LEFT.0) / (LEFT.1 - LEFT.0));
    if share == 0.0 {
        return (*a, 0.0);
    }
    let (r, omega) = (now.terms.X_BE.R * now.p_EC, now.terms.omega[N - 1]);
    let a_E = linear(a) - angular(a).cross(&r) - omega.cross(&omega.cross(&r));
    let change = u * ((along / u.dot(e) - u.dot(&a_E)) * share);
    (a + stack(&change, &Vector3::zeros()), share)
}

/// The share of an axis of rotation, 0 to 1, that no singularity takes.
fn left<const N: usize>(now: &Now<'_, N>, axis: &Vector3) -> f64 {
    now.report.listed().iter().fold(1.0, |left, s| {
        let along = angular(&s.zeta_B).dot(axis);
        left - left * along * along * (1.0 - s.openness(s.s))
    })
}

/// Of a force of 1 N along e: A⁻¹Jᵀe, the acceleration of the joints, and 1/Λ, that of the hand along e, 1/kg.
fn response<const N: usize>(
    terms: &Terms<N>,
    row: &Joints<N>,
) -> Result<(Joints<N>, f64), Refusal> {
    let A = Cholesky::new(terms.A)?;
    let response = A.solve(row);
    Ok((response, row.dot(&response).max(MOBILITY)))
}

/// The wrench on a steered hand by the disturbance torque of its arm, where no sensor measures it: a force along the axis, base axes; N.
///
/// # Errors
/// [`Refusal::Singular`] of a mass matrix that has no inverse.
pub(crate) fn observed<const N: usize>(
    press: &Press<'_>,
    terms: &Terms<N>,
    tau_disturbance: &Joints<N>,
) -> Result<Vector6, Refusal> {
    let pressed_n = unexplained(terms, &pressing_row(terms, &press.e), tau_disturbance)?;
    Ok(stack(&(press.e * -pressed_n), &Vector3::zeros()))
}

/// The force along e that explains the disturbance torque, −J̄_eᵀτ; N.
fn unexplained<const N: usize>(
    terms: &Terms<N>,
    row: &Joints<N>,
    tau_disturbance: &Joints<N>,
) -> Result<f64, Refusal> {
    let (response, mobility) = response(terms, row)?;
    Ok(-response.dot(tau_disturbance) / mobility)
}

/// A set-point `dt` s later, on its way to so many newtons; the whole way from or to zero takes `ramp_s`. N.
pub(crate) fn ramped(set_n: f64, newtons: f64, ramp_s: f64, dt: f64) -> f64 {
    let change = newtons.max(set_n) / ramp_s * dt;
    set_n + (newtons - set_n).clamp(-change, change)
}

impl Pressing {
    /// Whether the path waits for the force.
    pub(crate) fn waits(&self) -> bool {
        self.leg != 0 && matches!(self.stage, Stage::Seeking | Stage::Rising)
    }

    fn is_touching(&self) -> bool {
        matches!(self.stage, Stage::Rising | Stage::Moving)
    }

    /// The speed along e that the force asks for, that of the surface included; m/s.
    fn step(
        &mut self,
        press: &Press<'_>,
        leg: usize,
        felt: &Felt,
        tuning: &Tuning,
        dt: f64,
    ) -> Result<f64, Refusal> {
        let is_same_axis = press.e.dot(&self.e) > SAME_AXIS;
        if self.leg != leg + 1 || !is_same_axis {
            self.begin(leg, is_same_axis, felt);
        }
        self.e = press.e;
        let (force, newtons) = (&press.wanted.force, press.newtons);
        self.felt_n += (felt.force_n - self.felt_n) * dt / (tuning.felt_s + dt);
        self.change(press, felt, dt);
        let is_touching = self.is_touching();
        if self.stage != Stage::Moving {
            self.waited_s += dt;
        }
        let approach = tuning.approach(press);
        let went_m = felt.place_m - self.from_m;
        let is_far = self.stage != Stage::Moving && went_m > force.reach_m;
        if is_far || self.waited_s > PATIENCE_S.max(PATIENCE * force.reach_m / approach) {
            // Where something was met, there is a set-point.
            return Err(match (is_touching, self.set_n > 0.0) {
                (false, true) => Refusal::Bounce,
                (false, false) if went_m > 0.5 * force.reach_m => Refusal::Contact,
                _ => Refusal::Pressing,
            });
        }
        if !is_touching {
            return Ok(approach);
        }
        self.set_n = ramped(self.set_n, newtons, force.ramp_s, dt);
        let axis = Along {
            set: self.set_n,
            felt: felt.force_n,
            speed: felt.speed,
            stiffness: force.stiffness_n_m,
            fastest: force.approach_m_s,
        };
        Ok(self.along.step(&axis, tuning, dt))
    }

    /// The angular acceleration that answers to the moments, and the hand's rotation about their axes; rad/s², rad/s.
    ///
    /// In the air there is no moment to control: the hand comes to rest about these axes.
    fn twist<const N: usize>(
        &mut self,
        press: &Press<'_>,
        wrist: &Vector6,
        now: &Now<'_, N>,
        tuning: &Tuning,
        dt: f64,
    ) -> (Vector3, Vector3) {
        let is_touching = self.is_touching();
        self.turns = press.twists() && (self.turns || is_touching);
        if !self.turns {
            return Default::default();
        }
        let omega = now.terms.J.fixed_rows::<3>(3) * now.qdot;
        let share = self.set_n / press.newtons;
        let mut largest_nm = 0.0_f64;
        let alpha = (0..MOMENTS).map(|i| {
            let about = press.about[i];
            let axis = Along {
                set: press.wanted.moments[i].1 * share * about.norm(),
                felt: -about.dot(&angular(wrist)),
                speed: about.dot(&omega),
                stiffness: press.turning_stiffness(),
                fastest: TURNING * tuning.approach(press) / press.wanted.face_m,
            };
            largest_nm = largest_nm.max((axis.set - axis.felt).abs());
            let speed = match is_touching {
                // Fewer points than stated touch a tilted face: the observer would take that for a surface that turns away.
                true => (self.about[i].step(&axis, tuning, dt)).clamp(-axis.fastest, axis.fastest),
                false => 0.0,
            };
            about * tuning.acceleration(speed, axis.speed)
        });
        let alpha = alpha.sum();
        self.is_off = largest_nm > REACHED.0 * press.newtons * press.wanted.face_m;
        (alpha, press.turn(&omega))
    }

    /// −JᵀF: what bears the contact that the wrist's sensor measures; N·m. `None`: there is none.
    pub(crate) fn bearing<const N: usize>(&self, terms: &Terms<N>) -> Option<Joints<N>> {
        let is_felt = self.wrist != Vector6::zeros();
        is_felt.then(|| -terms.J.tr_mul(&self.wrist))
    }

    /// The state of a hand on which the wrench `wrist` acts about E, base axes, N, N·m, and that presses on nothing.
    pub(crate) fn touching(wrist: Vector6) -> Self {
        Self {
            wrist,
            ..Self::default()
        }
    }

    /// A segment begins, or a force along another axis; a contact along the same one goes on into it.
    fn begin(&mut self, leg: usize, is_same_axis: bool, felt: &Felt) {
        let (stage, set_n) = match self.stage {
            Stage::Moving if is_same_axis => (Stage::Rising, self.set_n),
            _ => (Stage::Seeking, 0.0),
        };
        *self = Self {
            leg: leg + 1,
            stage,
            set_n,
            from_m: felt.place_m,
            waited_s: 0.0,
            lasted_s: 0.0,
            ..*self
        };
    }

    /// The stage after this tick.
    fn change(&mut self, press: &Press<'_>, felt: &Felt, dt: f64) {
        let (force, newtons) = (&press.wanted.force, press.newtons);
        let touch = (TOUCH.0 * newtons).max(TOUCH.1).min(0.5 * newtons);
        let is_reached = match force.until_newtons {
            Some(until) => self.felt_n >= until,
            None => (self.felt_n - newtons).abs() <= REACHED.0 * newtons && !self.is_off,
        };
        let (lasts, long_s, next) = match self.stage {
            Stage::Seeking => (self.felt_n > touch, 0.0, Stage::Rising),
            Stage::Lost => (self.felt_n > touch, 0.0, Stage::Moving),
            Stage::Rising if self.felt_n < 0.5 * touch => (true, LOST_S, Stage::Seeking),
            Stage::Rising => {
                let long_s = force.until_newtons.map_or(REACHED.1, |_| 0.0);
                (is_reached, long_s, Stage::Moving)
            }
            Stage::Moving => (self.felt_n < 0.5 * touch, LOST_S, Stage::Lost),
        };
        self.lasted_s = if lasts { self.lasted_s + dt } else { 0.0 };
        if lasts && self.lasted_s > long_s {
            let meets = matches!(self.stage, Stage::Seeking | Stage::Lost);
            (self.stage, self.lasted_s, self.from_m) = (next, 0.0, felt.place_m);
            if meets {
                self.set_n = self.felt_n.min(newtons);
                self.along = Compliance {
                    depth: felt.force_n / force.stiffness_n_m,
                    ..Compliance::default()
                };
                self.about = Default::default();
            }
        }
    }

    pub(crate) fn checkpoint(&self) -> ForceCheckpoint {
        ForceCheckpoint {
            set_n: self.set_n,
            felt_n: self.felt_n,
            e: self.e.into(),
            wrist: self.wrist.into(),
            along: [
                self.along.depth,
                self.along.surface_speed,
                self.along.integral,
            ],
            about: (self.about).map(|one| [one.depth, one.surface_speed, one.integral]),
            from_m: self.from_m,
            waited_s: self.waited_s,
            lasted_s: self.lasted_s,
            leg: self.leg as u32,
            stage: self.stage as u32,
            turns: u32::from(self.turns),
            is_off: u32::from(self.is_off),
        }
    }

    pub(crate) fn restored(from: &ForceCheckpoint) -> Self {
        let compliance = |[depth, surface_speed, integral]: [f64; 3]| Compliance {
            depth,
            surface_speed,
            integral,
        };
        Self {
            leg: from.leg as usize,
            stage: STAGES.get(from.stage as usize).copied().unwrap_or_default(),
            set_n: from.set_n,
            felt_n: from.felt_n,
            e: from.e.into(),
            wrist: from.wrist.into(),
            along: compliance(from.along),
            about: from.about.map(compliance),
            turns: from.turns != 0,
            is_off: from.is_off != 0,
            from_m: from.from_m,
            waited_s: from.waited_s,
            lasted_s: from.lasted_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::standing;

    fn forces(stiffness_n_m: f64) -> Forces {
        let text = format!(
            "name=\"t\"\nrobot=\"puma560\"\nstart.posture=\"ready\"\n[[segment]]\nduration_s=1.0\nforce={{axis=\"-z\", newtons=10.0, stiffness_n_m={stiffness_n_m:?}}}\n"
        );
        Forces::of(&Scenario::parse("t.toml", &text, &[]).unwrap())
    }

    /// A mass on a spring, soft to very stiff: it is met slowly, and the force comes about without a peak beyond twice its set-point.
    #[test]
    fn a_contact_is_met_slowly_and_its_force_is_reached() {
        for (spring, dt) in [(2e4, 1e-3), (3e5, 1e-3), (1e6, 1e-3), (2e4, 1e-2)] {
            let forces = forces(spring);
            let press = forces.at(0, &Matrix3::identity()).unwrap();
            let (mut pressing, mut x, mut v, mut peak) =
                (Pressing::default(), -0.005_f64, 0.0, 0.0_f64);
            for _ in 0..(10.0 / dt) as u32 {
                let felt = Felt {
                    force_n: spring * x.max(0.0),
                    speed: v,
                    place_m: x,
                };
                peak = peak.max(felt.force_n);
                let tuning = Tuning::of(true, dt);
                let wanted = pressing.step(&press, 0, &felt, &tuning, dt).unwrap();
                v += tuning.acceleration(wanted, v) * dt;
                x += v * dt;
                assert!(v <= 0.0201, "{v}");
            }
            let pressed = spring * x;
            assert!(
                !pressing.waits() && peak < 20.0 && (pressed - 10.0).abs() < 0.05,
                "{spring}: {peak} {pressed}"
            );
            let again = Pressing::restored(&pressing.checkpoint());
            assert_eq!(again, pressing);
        }
    }

    /// A PUMA in elbow lock that presses askew to ζ, and beside the lock.
    #[test]
    fn in_a_lock_what_is_left_of_the_axis_serves_the_force() {
        let at = |q3: f64| {
            standing("puma560", [0.4, -0.7, q3, 0.3, 0.6, 0.1], |now| {
                let zeta = linear(&now.report.singularities[0].zeta_B);
                let n = zeta.cross(&Vector3::new(0.2, 0.9, 0.4)).normalize();
                let e = (zeta * 0.6 + n * 0.8).normalize();
                let a = stack(&(Vector3::new(1.0, -2.0, 0.5) + e), &Vector3::zeros());
                let (served, share) = serve(now, &a, &e, 3.0);
                let moved = linear(&served) - zeta * zeta.dot(&linear(&served));
                let across = zeta.cross(&n).dot(&linear(&(served - a)));
                (served - a, share, moved.dot(&e), across)
            })
        };
        let stretched = libm::atan2(0.4318, -0.0203);
        let (_, share, along, across) = at(stretched);
        assert!(
            share == 1.0 && (along - 3.0).abs() < 1e-9 && across.abs() < 1e-12,
            "{share} {along} {across}"
        );
        assert_eq!((at(0.8).0, at(0.8).1), (Vector6::zeros(), 1.0));
    }

    #[test]
    fn a_direction_in_which_nothing_is_met_is_refused() {
        let (forces, mut pressing, mut ticks) = (forces(2e4), Pressing::default(), 0);
        let press = forces.at(0, &Matrix3::identity()).unwrap();
        let refusal = loop {
            let felt = Felt {
                force_n: 0.0,
                speed: 0.02,
                place_m: 2e-5 * f64::from(ticks),
            };
            ticks += 1;
            match pressing.step(&press, 0, &felt, &BY_SENSOR, 1e-3) {
                Ok(_) => assert!(ticks < 3000),
                other => break other,
            }
        };
        assert_eq!(refusal, Err(Refusal::Contact));
        // 50 mm at 20 mm/s.
        assert!((2500..=2503).contains(&ticks), "{ticks}");
    }
}
