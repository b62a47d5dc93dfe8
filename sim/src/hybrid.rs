//! The hybrid plant: an exact integrator carries the state, rapier3d computes the effect of contact and joint stops.

use crate::dry_friction::velocity_change;
use crate::error::PlantError;
use crate::smooth::{Smooth, State};
use crate::solids::reach;
use crate::world::{PREDICTION, Response, World};
use model::{ArmMotion, Robot, joints, padded};
use nalgebra::{SVector, Vector3};
use shared_types::checkpoints::PlantCheckpoint;

/// rapier3d is asked about contact where solids may be nearer than this; m. Above [`PREDICTION`], so that it makes no
/// contact anywhere that it is not asked.
const NEAR: f64 = 2.0 * PREDICTION;

/// How far beyond a stop a joint rests on it; rad. Position correction leaves this much, so that the stop stays engaged
/// instead of being left and hit again every other sub-step.
pub(crate) const STOP_DEPTH: f64 = 1e-6;

/// Contact is steady where its effect changes by less than this part of it from one sub-step to the next.
const STEADY: f64 = 0.02;

/// The effect of constraints over the last tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Touch {
    /// Mean force from floor and links on the arm over the tick, and force of the surfaces at its end, base axes; N.
    pub force: Vector3<f64>,
    /// Contact points that carry force at the end of the tick.
    pub contacts: u32,
    /// Bit i: joint i was at a stop during the tick.
    pub limits: u32,
}

/// The state of the constraints between two sub-steps.
#[derive(Clone, Copy)]
struct Constraints<const N: usize> {
    /// Lower bound on the distance between any two solids that may touch; m.
    clearance: f64,
    /// Whether the last step saw contact points, so that rapier still has to see them gone.
    touching: bool,
    /// Constraints that pushed in the last sub-step.
    pushing: u32,
    /// Acceleration by what rapier3d knows of, in the last sub-step; rad/s².
    effect: SVector<f64, N>,
}

/// Runge–Kutta for the smooth dynamics, rapier3d for contact and joint stops, and for dry friction beside them.
///
/// A tick in which no constraint can act is one call of [`Smooth::advance`]. Any other has sub-steps of h s, `substeps` of them where dry friction acts
/// alone. Nearly all the error of contact comes from the ticks in which it sets in or changes. So a tick near contact has half as many sub-steps, and where
/// the effect of constraints is not [`STEADY`] over it and the tick before, it is done again with twice as many. Of a sub-step let v_f = v + h·a be rapier's
/// velocities without constraints and v_r, q_r its state with them. Then dv = v_r − v_f is the constraint impulse alone, and c = q_r − q − h·v_r
/// its position correction, and
///
/// (q, v) ← RK4(q, v) + (h·dv/2 + c, dv)
///
/// as for a force constant over the sub-step. Where a constraint sets in, its impulse comes at once, and rapier's own
/// position q + h·v_r + c is kept.
///
/// Where neither contact nor a stop can act, dv is exactly 0 and rapier3d is not asked: no two solids that may touch are nearer than the contact
/// margin, and no joint is beyond its limits. Dry friction alone is [`velocity_change`], which takes a tenth of rapier's time and leaves no
/// remainder of an iteration.
///
/// Of a whole tick of T s all this is known when it is over: the clearance has not run out, and no joint is near a limit at either end. A joint
/// that turns back in between goes beyond both ends by |Δq̇|·T/8 at constant acceleration; eight times that is kept free.
pub(crate) struct Hybrid<const N: usize> {
    world: World,
    /// Coulomb friction; N·m. `None`: there is none.
    dry_friction: Option<SVector<f64, N>>,
    /// How far any point can move per joint motion; m/rad.
    reach: SVector<f64, N>,
    constraints: Constraints<N>,
    /// Whether the effect of constraints was steady over the last tick.
    is_steady: bool,
    /// rapier3d has been asked since [`forget`](Self::forget): it may remember contacts.
    has_asked: bool,
    substeps: u32,
    /// Length of a tick; s.
    tick_s: f64,
    /// Ask rapier3d at every sub-step, needed or not.
    #[cfg(test)]
    pub(crate) always: bool,
    /// All ticks in which a constraint may act have `substeps` sub-steps.
    #[cfg(test)]
    pub(crate) equal: bool,
    /// Sub-steps in which rapier3d has been asked.
    #[cfg(test)]
    pub(crate) asked: u32,
}

impl<const N: usize> Hybrid<N> {
    /// The world around `robot` at `q`. `smooth` is the same robot's.
    pub(crate) fn new(
        robot: &Robot,
        smooth: &Smooth<N>,
        q: &SVector<f64, N>,
        options: &shared_types::scenario::Plant,
        tick_s: f64,
    ) -> Result<Self, PlantError> {
        let model = &smooth.model;
        let coulomb = *model.coulomb_friction();
        let dry_friction =
            (options.friction && coulomb.iter().any(|c| *c > 0.0)).then_some(coulomb);
        let X_BL = model.link_poses(q);
        let world = World::new(robot, q, &X_BL, options, tick_s)?;
        let clearance = world.clearance(&X_BL);
        Ok(Self {
            reach: reach(robot, world.solids()),
            constraints: Constraints {
                clearance,
                touching: false,
                pushing: 0,
                effect: SVector::zeros(),
            },
            is_steady: true,
            has_asked: false,
            world,
            dry_friction,
            substeps: options.substeps,
            tick_s,
            #[cfg(test)]
            always: false,
            #[cfg(test)]
            equal: false,
            #[cfg(test)]
            asked: 0,
        })
    }

    /// Writes all that a tick changes; see [`Plant::save`](crate::Plant::save).
    pub(crate) fn save(&self, out: &mut PlantCheckpoint) {
        let Constraints {
            clearance,
            touching,
            pushing,
            effect,
        } = &self.constraints;
        (out.clearance, out.effect) = (*clearance, padded(effect));
        (out.touching, out.pushing) = (u32::from(*touching), *pushing);
        out.is_steady = self.is_steady.into();
    }

    /// Forgets what rapier3d remembers of contacts, which nothing saves.
    pub(crate) fn forget(&mut self) {
        if std::mem::take(&mut self.has_asked) {
            self.world.forget();
        }
    }

    /// Goes on from what [`save`](Self::save) has written.
    pub(crate) fn restore(&mut self, from: &PlantCheckpoint) {
        self.constraints = Constraints {
            clearance: from.clearance,
            touching: from.touching == 1,
            pushing: from.pushing,
            effect: joints(&from.effect),
        };
        self.is_steady = from.is_steady == 1;
    }

    /// The state a tick after `x`, whose motion is `now`, and what constraints did meanwhile. A motion that leaves the finite numbers ends there.
    pub(crate) fn tick(
        &mut self,
        smooth: &Smooth<N>,
        x: &State<N>,
        now: &ArmMotion<N>,
        tau: &SVector<f64, N>,
    ) -> (State<N>, Touch) {
        if !self.may_touch(smooth, x) {
            let free = self.free_tick(smooth, x, now, tau);
            return free.map_or_else(
                || self.tick_in(self.substeps, smooth, x, tau),
                |next| (next, Touch::default()),
            );
        }
        #[cfg(test)]
        if self.equal {
            return self.tick_in(self.substeps, smooth, x, tau);
        }
        let before = self.constraints;
        if self.is_steady {
            let done = self.tick_in(self.substeps.div_ceil(2), smooth, x, tau);
            if self.is_steady {
                return done;
            }
            self.constraints = before;
        }
        self.tick_in(2 * self.substeps, smooth, x, tau)
    }

    /// The tick after `x` in so many sub-steps.
    fn tick_in(
        &mut self,
        substeps: u32,
        smooth: &Smooth<N>,
        x: &State<N>,
        tau: &SVector<f64, N>,
    ) -> (State<N>, Touch) {
        let (mut state, mut touch, h) = (*x, Touch::default(), self.tick_s / f64::from(substeps));
        self.is_steady = true;
        for _ in 0..substeps {
            let before = self.constraints.effect;
            state = self.step(smooth, &state, tau, h, &mut touch);
            if !state.is_finite() {
                self.is_steady = false;
                break;
            }
            let effect = self.constraints.effect;
            self.is_steady &= (effect - before).amax() <= STEADY * effect.amax();
        }
        touch.force /= self.tick_s;
        (state, touch)
    }

    /// The state a tick after `x`, where none may touch; `None` where a constraint may act meanwhile.
    fn free_tick(
        &mut self,
        smooth: &Smooth<N>,
        x: &State<N>,
        now: &ArmMotion<N>,
        tau: &SVector<f64, N>,
    ) -> Option<State<N>> {
        if self.dry_friction.is_some() {
            return None;
        }
        let next = smooth.advance(x, now, tau, self.tick_s);
        let spare = (next.qdot - x.qdot).abs() * self.tick_s;
        let moved = self.reach.dot(&((next.q - x.q).abs() + spare));
        if self.constraints.clearance - moved <= NEAR {
            self.constraints.clearance = self.world.clearance(&smooth.model.link_poses(&x.q));
        }
        let within = |x: &State<N>| (0..N).all(|i| smooth.beyond(x, i).0 + spare[i] <= 0.0);
        // Written so that a NaN is no free motion.
        if !(within(x) && within(&next) && self.constraints.clearance - moved > NEAR) {
            return None;
        }
        #[cfg(test)]
        if self.always {
            self.assert_idle(smooth, x, tau);
        }
        self.constraints.clearance -= moved;
        self.set_idle();
        self.is_steady = true;
        Some(next)
    }

    /// No constraint of rapier3d's acts.
    fn set_idle(&mut self) {
        (self.constraints.pushing, self.constraints.effect) = (0, SVector::zeros());
    }

    /// One sub-step of `h` s. Adds what constraints did to `touch`, whose force is an impulse here; N·s.
    fn step(
        &mut self,
        smooth: &Smooth<N>,
        x: &State<N>,
        tau: &SVector<f64, N>,
        h: f64,
        touch: &mut Touch,
    ) -> State<N> {
        let mut next = smooth.rk4(x, tau, h);
        touch.contacts = 0;
        let asks = self.may_touch(smooth, x);
        #[cfg(test)]
        let asks = asks || self.always;
        if asks {
            let response = self.ask(x, &smooth.driving(&x.q, &x.qdot, tau), h);
            let dv = response.state.qdot - response.free;
            self.constraints.effect = dv / h;
            #[cfg(test)]
            {
                self.asked += 1;
            }
            let mut pushing = response.contacts;
            if dv.iter().any(|d| *d != 0.0) {
                let moved = response.state.qdot * h;
                let mut correction = response.state.q - x.q - moved;
                for i in 0..N {
                    let (depth, inwards) = smooth.beyond(x, i);
                    if depth > 0.0 && dv[i] * inwards > 0.0 {
                        pushing += 1;
                        touch.limits |= 1 << i;
                        correction *= kept(depth - STOP_DEPTH, correction[i] * inwards);
                    }
                }
                next = kicked(next, &dv, h);
                next.q += correction;
                if pushing > self.constraints.pushing {
                    next.q = x.q + moved + correction;
                    next.qdot = response.state.qdot;
                }
            }
            self.constraints.pushing = pushing;
            self.constraints.touching = response.candidates > 0;
            touch.contacts = response.contacts;
            touch.force += response.impulse;
        } else {
            self.set_idle();
            if let Some(coulomb) = &self.dry_friction {
                let A = smooth.model.mass_matrix(&x.q);
                let dv = velocity_change(&A, &next.qdot, &(coulomb * h));
                next = kicked(next, &dv, h);
            }
        }
        let moved = next.q - x.q;
        let swept = self.reach.iter().zip(&moved).map(|(r, d)| r * d.abs());
        self.constraints.clearance -= swept.sum::<f64>();
        next
    }

    /// rapier3d's step. Its solver begins with the impulses of the step before, which a world that has forgotten them finds by a step in vain.
    fn ask(&mut self, x: &State<N>, tau: &SVector<f64, N>, h: f64) -> Response<N> {
        if !std::mem::replace(&mut self.has_asked, true) && self.constraints.touching {
            self.world.step(x, tau, h);
        }
        self.world.step(x, tau, h)
    }

    /// Whether contact or a stop can act in the sub-step from `x`: false only if none can.
    ///
    /// Distances are computed only where nothing else decides: the bound on the clearance stays one without them.
    fn may_touch(&mut self, smooth: &Smooth<N>, x: &State<N>) -> bool {
        if self.constraints.touching || (0..N).any(|i| smooth.beyond(x, i).0 > 0.0) {
            return true;
        }
        // An arm of unbounded reach makes the bound −∞ or NaN, and is looked at every time.
        let is_clear = |clearance: f64| clearance > NEAR;
        if !is_clear(self.constraints.clearance) {
            self.constraints.clearance = self.world.clearance(&smooth.model.link_poses(&x.q));
        }
        !is_clear(self.constraints.clearance)
    }

    /// Asks rapier3d about a tick that counts as free.
    #[cfg(test)]
    fn assert_idle(&mut self, smooth: &Smooth<N>, x: &State<N>, tau: &SVector<f64, N>) {
        let (mut x, h) = (*x, self.tick_s / f64::from(self.substeps));
        for _ in 0..self.substeps {
            let response = self.world.step(&x, &smooth.driving(&x.q, &x.qdot, tau), h);
            assert!(
                response.contacts == 0 && response.state.qdot == response.free,
                "a constraint acts in free motion"
            );
            x = smooth.rk4(&x, tau, h);
        }
    }
}

/// The fraction of a correction that may be made where at most `room` is to be corrected.
fn kept(room: f64, correction: f64) -> f64 {
    if correction > room.max(0.0) {
        room.max(0.0) / correction
    } else {
        1.0
    }
}

/// The state after a step of `h` in which contact or dry friction has changed the velocity by `dv`, in the middle of the step.
fn kicked<const N: usize>(x: State<N>, dv: &SVector<f64, N>, h: f64) -> State<N> {
    State {
        q: x.q + dv * (h / 2.0),
        qdot: x.qdot + dv,
    }
}
