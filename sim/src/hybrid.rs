//! The hybrid plant: an exact integrator carries the state, rapier3d computes the effect of constraints.

use crate::error::PlantError;
use crate::smooth::{Smooth, State};
use crate::solids::reach;
use crate::world::{PREDICTION, World};
use model::Robot;
use nalgebra::{SVector, Vector3};

/// rapier3d is asked about contact where solids may be nearer than this; m. Above [`PREDICTION`], so that it makes no
/// contact anywhere that it is not asked.
const NEAR: f64 = 2.0 * PREDICTION;

/// How far beyond a stop a joint rests on it; rad. Position correction leaves this much, so that the stop stays engaged
/// instead of being left and hit again every other sub-step.
pub(crate) const STOP_DEPTH: f64 = 1e-6;

/// The effect of constraints over the last tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Mean force from the world on the arm over the tick, base axes; N.
    pub force: Vector3<f64>,
    /// Contact points that carry force at the end of the tick.
    pub contacts: u32,
    /// Bit i: joint i was at a stop during the tick.
    pub limits: u32,
}

impl Default for Touch {
    fn default() -> Self {
        Self { force: Vector3::zeros(), contacts: 0, limits: 0 }
    }
}

/// RK4 for the smooth dynamics, rapier3d for contact, joint stops and dry friction.
///
/// Per sub-step of h s: let v_f = v + h·a be rapier's velocities without constraints and v_r, q_r its state with them. Then
/// dv = v_r − v_f is the constraint impulse alone, and c = q_r − q − h·v_r its position correction, and
///
/// (q, v) ← RK4(q, v) + (h·dv/2 + c, dv)
///
/// as for a force constant over the sub-step. Where a constraint sets in, its impulse comes at once, and rapier's own
/// position q + h·v_r + c is kept.
///
/// Where no constraint can act, dv is exactly 0 and rapier3d is not asked: no two solids that may touch are
/// nearer than the contact margin, no joint is beyond its limits, and there is no dry friction.
pub(crate) struct Hybrid<const N: usize> {
    world: World<N>,
    dry_friction: bool,
    lower: SVector<f64, N>,
    upper: SVector<f64, N>,
    /// How far any point can move per joint motion; m/rad.
    reach: SVector<f64, N>,
    /// Lower bound on the distance between any two solids that may touch; m.
    clearance: f64,
    /// Whether the last step saw contact points, so that rapier still has to see them gone.
    touching: bool,
    /// Constraints that pushed in the last sub-step.
    pushing: u32,
    /// Ask rapier3d at every sub-step, needed or not.
    #[cfg(test)]
    pub(crate) always: bool,
}

impl<const N: usize> Hybrid<N> {
    /// The world around `robot` at `q`. `smooth` is the same robot's.
    pub(crate) fn new(
        robot: &Robot,
        smooth: &Smooth<N>,
        q: &SVector<f64, N>,
        options: &shared_types::scenario::Plant,
        h: f64,
    ) -> Result<Self, PlantError> {
        let model = &smooth.model;
        let dry_friction = options.friction && model.coulomb_friction().iter().any(|c| *c > 0.0);
        let X_BL = model.link_poses(q);
        let world = World::new(robot, q, &X_BL, options.floor_m, options.self_collision, dry_friction, h)?;
        Ok(Self {
            reach: reach(robot, world.solids()),
            clearance: world.clearance(&X_BL),
            world,
            dry_friction,
            lower: *model.lower(),
            upper: *model.upper(),
            touching: false,
            pushing: 0,
            #[cfg(test)]
            always: false,
        })
    }

    /// One sub-step of `h` s. Adds what constraints did to `touch`, whose force is an impulse here; N·s.
    pub(crate) fn step(&mut self, smooth: &Smooth<N>, x: &State<N>, tau: &SVector<f64, N>, h: f64, touch: &mut Touch) -> State<N> {
        let mut next = smooth.rk4(x, tau, h);
        touch.contacts = 0;
        if self.may_constrain(smooth, x) {
            let response = self.world.step(x, &smooth.driving(&x.qdot, tau));
            let dv = response.state.qdot - response.free;
            let mut pushing = response.contacts;
            if dv.iter().any(|d| *d != 0.0) {
                let moved = response.state.qdot * h;
                let mut correction = response.state.q - x.q - moved;
                for i in 0..N {
                    let (depth, inwards) = self.beyond(x, i);
                    if depth > 0.0 && dv[i] * inwards > 0.0 {
                        pushing += 1;
                        touch.limits |= 1 << i;
                        correction *= kept(depth - STOP_DEPTH, correction[i] * inwards);
                    }
                }
                next = if pushing > self.pushing {
                    State { q: x.q + moved + correction, qdot: response.state.qdot }
                } else {
                    State { q: next.q + dv * (h / 2.0) + correction, qdot: next.qdot + dv }
                };
            }
            self.pushing = pushing;
            self.touching = response.candidates > 0;
            touch.contacts = response.contacts;
            touch.force += response.impulse;
        } else {
            self.pushing = 0;
        }
        self.clearance -= self.reach.iter().zip((next.q - x.q).iter()).map(|(r, d)| r * d.abs()).sum::<f64>();
        next
    }

    /// Whether a constraint can act in the sub-step from `x`: false only if none can.
    fn may_constrain(&mut self, smooth: &Smooth<N>, x: &State<N>) -> bool {
        // An arm of unbounded reach makes the bound −∞ or NaN, and is looked at every time.
        let mut clear = self.clearance > NEAR;
        if !clear {
            self.clearance = self.world.clearance(&smooth.model.link_poses(&x.q));
            clear = self.clearance > NEAR;
        }
        let beyond = (0..N).any(|i| self.beyond(x, i).0 > 0.0);
        #[cfg(test)]
        if self.always {
            return true;
        }
        self.dry_friction || self.touching || !clear || beyond
    }

    /// How far joint i is beyond a limit (rad, negative inside), and the sign of the way back.
    fn beyond(&self, x: &State<N>, i: usize) -> (f64, f64) {
        let (low, high) = (self.lower[i] - x.q[i], x.q[i] - self.upper[i]);
        if low > high { (low, 1.0) } else { (high, -1.0) }
    }
}

/// The fraction of a correction that may be made where at most `room` is to be corrected.
fn kept(room: f64, correction: f64) -> f64 {
    if correction > room.max(0.0) { room.max(0.0) / correction } else { 1.0 }
}
