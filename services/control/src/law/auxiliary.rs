//! One rate loop per singularity (+): the weight β of operational control along ζ_i, and the acceleration of the auxiliary coordinate.
//!
//! Reduces to the paper's law inside D_si: there β = 0, and the unsaturated loop is the damped potential of the null-space torque, V₀ = ½ k_v K e² with damping
//! k_v (proof: `inside_a_neighbourhood_the_loop_is_a_damped_potential`). Outside, β = 1 and the loop is not used.

use crate::controller::Setup;
use crate::limits::range::Room;
use crate::linear::smoothstep;
use crate::paper::reference::{Memory, Target};
use crate::paper::switching::{self, Condition};
use crate::paper::type_1::SIDE_CHANGE;
use crate::types::{Class, Kind, Mode, Singularity};
use shared_types::checkpoints::LoopCheckpoint;

/// Time constant of the feed-forward's low-pass, s: without it encoder noise becomes torque.
const FEED_FORWARD_LAG: f64 = 0.008;

/// Fastest change of the error's share in β, 1/s: what an error can take back from operational control in one tick.
const TRUST_RATE: f64 = 30.0;

/// Beyond η_out by this factor the singularity is left, once the error it caused is gone.
pub const LEFT: f64 = 1.05;

/// Beyond η_out by this factor it is left whatever the error: another cause must have made it.
const FAR: f64 = 1.5;

/// A measured rate beyond the largest one by this factor is an outlier: a loop that begins there returns from it at its own slew only.
const FASTEST: f64 = 4.0;

/// Error along ζ that counts as gone, m or rad.
const GONE: f64 = 5e-6;

/// Share of a joint's speed that the self-motion at a singularity may take.
const JOINT_SHARE: f64 = 0.5;

/// Gains and bounds of one auxiliary loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gains {
    /// Position gain, 1/s.
    pub k: f64,
    /// Rate gain, 1/s.
    pub k_v: f64,
    /// Largest rate, rad/s.
    pub rate_max: f64,
    /// Largest change of rate, rad/s².
    pub slew: f64,
    /// The rates that the joints' limits leave.
    pub room: Room,
}

impl Gains {
    /// Those of the singularity `s` at a place of the report.
    ///
    /// Rates are stated for the joint that moves most, whatever the coordinate counts. The self-motion of an arm with spare joints has a share of the speed
    /// of its joints at most, as fast as a joint may be where only it moves.
    #[inline]
    pub(crate) fn of<const N: usize>(setup: &Setup<N>, place: usize, s: &Singularity<N>) -> Self {
        let (family, control) = (&setup.family, &setup.scenario.control);
        // A rotation that is lost turns like a wrist, whatever its name.
        let is_wrist = s.kind == Kind::Numeric && s.angular && !family.measures_vectors();
        let kind = if is_wrist { Kind::Wrist } else { s.kind }.code();
        let (rate, slew) = (control.aux_rate_max.of(kind), control.aux_slew.of(kind));
        let (rate_max, slew) = if family.has_higher_codimension(place) {
            let most = JOINT_SHARE * setup.model.velocity();
            let size = s.aux_row.norm_squared().max(1e-12);
            let of = |i: usize| most[i] * size / s.aux_row[i].abs().max(1e-9);
            ((0..N).fold(rate, |least, i| least.min(of(i))), slew)
        } else if family.is_tracked() {
            let share = s.aux_row.amax().clamp(1e-3, 1.0);
            (rate / share, slew / share)
        } else {
            (rate, slew)
        };
        Self {
            k: control.k_aux,
            k_v: control.k_v,
            rate_max,
            slew,
            room: Room::FREE,
        }
    }
}

/// The state of the loop at one singularity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loop {
    /// Its mode.
    pub mode: Mode,
    /// Rate commanded, rad/s.
    pub rate: f64,
    /// Low-passed change of it, rad/s².
    pub feed_forward: f64,
    /// The error's share in β, 0 to 1.
    pub trust: f64,
    /// The strategy's state.
    pub memory: Memory,
}

/// The loop's output, which enters the solve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demand {
    /// 1: operational control along ζ; 0: auxiliary control instead.
    pub beta: f64,
    /// Auxiliary acceleration, rad/s².
    pub acceleration: f64,
    /// Auxiliary rate at which the path would be followed at full clock speed, rad/s.
    pub nominal: f64,
    /// The same, over what the largest rate leaves beside the correction of the error.
    pub load: f64,
}

impl Demand {
    /// Operational control alone.
    pub fn none() -> Self {
        Self {
            beta: 1.0,
            ..Self::default()
        }
    }
}

impl Default for Loop {
    fn default() -> Self {
        Self {
            mode: Mode::Regular,
            rate: 0.0,
            feed_forward: 0.0,
            trust: 1.0,
            memory: Memory::default(),
        }
    }
}

impl Loop {
    /// Writes all of it.
    pub(crate) fn checkpoint(&self) -> LoopCheckpoint {
        let Memory {
            side,
            passing,
            holding,
            passage,
        } = self.memory;
        LoopCheckpoint {
            mode: self.mode.code(),
            passing: u32::from(passing),
            holding: u32::from(holding),
            reserved: 0,
            side,
            rate: self.rate,
            feed_forward: self.feed_forward,
            trust: self.trust,
            passage,
        }
    }

    /// The state that [`checkpoint`](Self::checkpoint) has written.
    pub(crate) fn restored(from: &LoopCheckpoint) -> Self {
        Self {
            mode: Mode::from_code(from.mode).unwrap_or(Mode::Regular),
            rate: from.rate,
            feed_forward: from.feed_forward,
            trust: from.trust,
            memory: Memory {
                passing: from.passing != 0,
                holding: from.holding != 0,
                side: from.side,
                passage: from.passage,
            },
        }
    }

    /// At rest, with the strategy's memory.
    pub(crate) fn at_rest(self) -> Self {
        Self {
            rate: 0.0,
            feed_forward: 0.0,
            ..self
        }
    }

    /// Whether this singularity takes part in the solve.
    #[inline]
    pub fn engaged(&self) -> bool {
        self.mode != Mode::Regular
    }

    /// One tick.
    ///
    /// β = smoothstep((|s| − η_in)/(η_out − η_in)) · (1 − smoothstep((|e| − 0.02)/0.08)), the second factor limited in rate so that β never jumps.
    /// rate_cmd = slew(sat(rate + K·e)); acceleration = k_v(rate_cmd − rate) + low-passed change of rate_cmd. With `is_hard` the paper's switching: β = 0
    /// inside |s| ≤ η_in, and [`Demand::none`] outside. The schedule of a plan keeps the joints' limits, so that only the correction beside it is
    /// bounded: rate_cmd = rate + sat(K·e), and its change is the plan's and K·ė.
    ///
    /// Units rad, rad/s, `dt` s · Requires `clock` > 0, the speed of the path's clock, in which `target.rate` already is · Ensures 0 ≤ β ≤ 1, β = 0 for
    /// |s| ≤ η_in, and [`Demand::none`] outside · Errors none · Cost O(1), no allocation
    pub fn step<const N: usize>(
        &mut self,
        s: &Singularity<N>,
        target: &Target,
        gains: &Gains,
        is_hard: bool,
        (clock, dt): (f64, f64),
    ) -> Demand {
        let error = target.error * target.weight;
        let gone = 1.0 - smoothstep((error.abs() - 0.02) / 0.08);
        let condition = if is_hard {
            Condition::hard(s.s.abs() <= s.eta_in)
        } else {
            self.condition(s, target)
        };
        self.mode = switching::next(self.mode, condition, target.mode);
        if !self.engaged() {
            let fastest = FASTEST * gains.rate_max;
            *self = Self {
                memory: self.memory_outside(s),
                rate: s.aux_rate.clamp(-fastest, fastest),
                ..Self::default()
            };
            return Demand::none();
        }
        self.trust += (gone - self.trust).clamp(-TRUST_RATE * dt, TRUST_RATE * dt);
        let (correction, nominal) = (gains.k * error, target.rate / clock);
        let [down, up] = gains.room.rates;
        let most = gains.rate_max;
        let bounded = |rate: f64| rate.clamp(-most, most).max(down).min(up);
        if let Some(change) = target.change {
            self.rate = target.rate + bounded(correction);
            self.feed_forward = change + gains.k * (target.rate - s.aux_rate);
        } else {
            let slew = gains.slew * dt;
            let change = (bounded(target.rate + correction) - self.rate).clamp(-slew, slew);
            self.rate += change;
            self.feed_forward += (change / dt - self.feed_forward) * dt / (FEED_FORWARD_LAG + dt);
        }
        let beta = if is_hard {
            0.0
        } else {
            s.openness(s.s) * self.trust
        };
        Demand {
            beta,
            acceleration: gains.k_v * (self.rate - s.aux_rate) + self.feed_forward,
            nominal,
            load: (1.0 - beta) * nominal.abs()
                / (gains.rate_max - (correction * nominal.signum()).max(0.0))
                    .max(0.05 * gains.rate_max),
        }
    }

    /// The memory of a singularity that does not take part in the solve: the arm will come to a fold on the side of its coordinate. The memory of
    /// another type's strategy does not apply to it, and the sign of a coordinate without formula is drawn anew at each approach.
    fn memory_outside<const N: usize>(&self, s: &Singularity<N>) -> Memory {
        let is_beside_fold = s.class == Class::Type1 && s.aux.abs() > SIDE_CHANGE;
        Memory {
            side: if is_beside_fold {
                s.aux.signum()
            } else {
                self.memory.side
            },
            ..self.memory
        }
    }

    /// The column of the transition table.
    fn condition<const N: usize>(&self, s: &Singularity<N>, target: &Target) -> Condition {
        let size = s.s.abs();
        let (away, far) = (size > LEFT * s.eta_out, size > FAR * s.eta_out);
        let (restored, gone) = (self.trust >= 1.0, (target.error * s.gain).abs() < GONE);
        match (s.inside, size < s.eta_out, away && restored, far || gone) {
            (true, ..) => Condition::Inside,
            (_, true, ..) => Condition::Near,
            (_, _, true, true) => Condition::Clear,
            (_, _, true, false) => Condition::Away,
            (_, _, false, _) => Condition::Boundary,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::neighborhood::Neighborhood;
    use crate::paper::operational_space::null_torque;
    use nalgebra::{Matrix1, Vector1};

    fn singularity(s: f64, inside: bool) -> Singularity<6> {
        Singularity {
            s,
            inside,
            eta_in: 0.1,
            eta_out: 0.2,
            ..Singularity::none()
        }
    }

    const GAINS: Gains = Gains {
        k: 12.0,
        k_v: 40.0,
        rate_max: 3.0,
        slew: 50.0,
        room: Room::FREE,
    };

    /// A tick in which the path is an error of the auxiliary coordinate away.
    fn track(state: &mut Loop, singularity: &Singularity<6>, error: f64) -> Demand {
        let target = Target {
            error,
            weight: 1.0,
            mode: Mode::Track,
            ..Target::default()
        };
        state.step(singularity, &target, &GAINS, false, (1.0, 1e-3))
    }

    #[test]
    fn in_and_out_visits_every_state_in_order() {
        let neighborhood = Neighborhood {
            eta_in: 0.1,
            eta_out: 0.2,
        };
        let (mut state, mut inside, mut seen) = (Loop::default(), false, vec![]);
        for k in -400..400 {
            let s = f64::from(k) * 1e-3;
            inside = neighborhood.update(inside, s);
            track(&mut state, &singularity(s, inside), 0.0);
            seen.push(state.mode);
        }
        seen.dedup();
        let [regular, blend] = [Mode::Regular, Mode::Blend];
        let expected = [regular, blend, Mode::Track, Mode::Recover, regular];
        assert_eq!(seen, expected);
    }

    #[test]
    fn inside_a_neighbourhood_the_loop_is_a_damped_potential_and_outside_it_is_not_used() {
        for (s, error, aux_rate) in [(0.0, 0.05, 0.1), (0.03, -0.2, 0.4), (-0.1, 0.01, -1.0)] {
            let still = |s, inside| Singularity {
                aux_rate,
                ..singularity(s, inside)
            };
            let mut state = Loop::default();
            for s in [0.2, -0.25, 0.9] {
                assert_eq!(track(&mut state, &still(s, false), error), Demand::none());
                assert!(!state.engaged(), "at {s}");
            }
            let demands = (0..2000).map(|_| track(&mut state, &still(s, true), error));
            let demand = demands.last().unwrap();
            assert_eq!(demand.beta, 0.0, "the strategy alone acts along ζ");
            // V₀ = ½ k_v K e² in the auxiliary coordinate, of which one is worth one: its gradient is −k_v K e.
            let gradient = Vector1::new(-GAINS.k_v * GAINS.k * error);
            let rate = Vector1::new(aux_rate);
            let Gamma_0 = null_torque(&Matrix1::identity(), &gradient, GAINS.k_v, &rate).x;
            let found = demand.acceleration;
            assert!((found - Gamma_0).abs() < 1e-9, "{found} against {Gamma_0}");
        }
    }

    #[test]
    fn a_fold_is_approached_on_the_side_of_its_coordinate() {
        let side = |class, aux, side| {
            let mut state = Loop::default();
            state.memory.side = side;
            let fold = Singularity {
                class,
                aux,
                ..singularity(0.5, false)
            };
            state.step(&fold, &Target::default(), &GAINS, false, (1.0, 1e-3));
            state.memory.side
        };
        assert_eq!(side(Class::Type1, -0.5, 1.0), -1.0);
        assert_eq!(side(Class::Type1, 0.5, -1.0), 1.0);
        // At the fold itself either side may be meant.
        assert_eq!(side(Class::Type1, 0.01, -1.0), -1.0);
        assert_eq!(side(Class::Type2, -0.5, 1.0), 1.0);
    }

    #[test]
    fn a_rate_that_is_no_arms_is_forgotten() {
        let mut state = Loop::default();
        let wild = Singularity {
            aux_rate: -150_000.0,
            ..singularity(0.5, false)
        };
        track(&mut state, &wild, 0.0);
        let demands = (0..500).map(|_| track(&mut state, &singularity(0.05, true), 0.0));
        let last = demands.last().unwrap().acceleration;
        assert!(last.abs() < 1e-3, "{state:?}");
    }

    #[test]
    fn beta_never_jumps_even_when_the_error_does() {
        let (mut state, mut last) = (Loop::default(), 1.0);
        for k in 0..600 {
            let error = if k % 100 < 50 { 0.5 } else { 0.0 };
            let beta = track(&mut state, &singularity(0.199, false), error).beta;
            assert!((beta - last).abs() < 0.035, "tick {k}: {last} to {beta}");
            last = beta;
        }
    }
}
