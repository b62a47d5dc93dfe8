//! The acceleration that the model does not explain, caused by a wrong mass, friction or a payload.
//! PURE.
//!
//! Two low-pass filters of the residual acceleration a = innovation·h/T² + d_e, d_e the share of d that the prediction already contains:
//!
//! d ← d + ω T (a − d),   d_slow ← d_slow + ω_slow T (a − d_slow)
//!
//! d_slow decides whether there is a disturbance. Within its noise, d_e = 0, so an exact model
//! stays exact, and its runs equal those without an observer. Beyond the noise, d_e → d: then a − d
//! = innovation·h/T², the integral action of a third-order fading-memory filter. After d_slow has
//! returned into the noise, the disturbance stays compensated for [`HELD_S`], so that a small one
//! does not switch on and off.
//!
//! Against white encoder noise of standard deviation σ and the observer's bandwidth b ≫ ω, ∫ of the filter's power gives σ_d = σ ω b^1.5 √T / 2.

use nalgebra::SVector;
use shared_types::scenario::Scenario;
use std::f64::consts::TAU;

/// Bandwidth of d_slow as a share of d's. The threshold is proportional to it, and so is the
/// disturbance that stays unexplained.
const SLOW: f64 = 0.1;

/// Multiples of d_slow's σ_d beyond which there is a disturbance.
const NOISE: f64 = 5.5;

/// The same for ideal encoders, rad/s²: the residual of the prediction's own step.
const EXACT: f64 = 0.01;

/// Times in which the share of d that is explained rises to 1, and falls to 0 again, s: without a step in torque.
const RISE_S: f64 = 0.005;
const FALL_S: f64 = 0.250;

/// A disturbance found within this time, s, has acted since the beginning (a payload, a wrong mass): d has seen the share 1 − exp(−ω(t − lag)) of it, lag
/// the observer's own delay. It is corrected for that, by this factor at most.
const BEGUN: (f64, f64) = (0.2, 3.0);

/// Least share of a torque limit that is a load of an arm at rest. An angle's noise σ, rad, changes gravity by no larger a share of the limit than σ.
const LOAD: f64 = 1e-3;

/// Time for which a disturbance counts after it was last seen, s.
const HELD_S: f64 = 0.5;

/// The filters' constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Disturbance {
    /// Bandwidth of d, rad/s; 0: off.
    bandwidth: f64,
    /// |d_slow| beyond which there is a disturbance, rad/s².
    threshold: f64,
    /// Delay of the observer's double pole, s.
    lag_s: f64,
    /// Share of a torque limit from which on the torque of an arm at rest tells of a load; infinite: the observer is off.
    pub(crate) seen_at_rest: f64,
}

/// The filters' state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unexplained<const N: usize> {
    /// d, noise included, rad/s².
    pub(crate) d: SVector<f64, N>,
    /// d_slow, rad/s².
    pub(crate) slow: SVector<f64, N>,
    /// The share of d that is explained, beyond 1 for as long as it is held.
    pub(crate) presence: SVector<f64, N>,
}

impl<const N: usize> Unexplained<N> {
    /// Nothing is known.
    pub(crate) fn none() -> Self {
        Self {
            d: SVector::zeros(),
            slow: SVector::zeros(),
            presence: SVector::zeros(),
        }
    }

    /// Known from the beginning, rad/s².
    pub(crate) fn since_ever(d: SVector<f64, N>) -> Self {
        Self {
            d,
            slow: d,
            presence: SVector::repeat(1.0 + HELD_S / FALL_S),
        }
    }

    /// Nothing is known of a joint any more.
    pub(crate) fn forget(&mut self, joint: usize) {
        (self.d[joint], self.slow[joint], self.presence[joint]) = (0.0, 0.0, 0.0);
    }

    /// The acceleration that the prediction contains and the controller compensates, rad/s².
    pub(crate) fn explained(&self) -> SVector<f64, N> {
        self.d
            .zip_map(&self.presence, |d, presence| d * presence.clamp(0.0, 1.0))
    }

    pub(crate) fn is_finite(&self) -> bool {
        [&self.d, &self.slow, &self.presence]
            .into_iter()
            .all(|values| values.iter().all(|x| x.is_finite()))
    }
}

impl Disturbance {
    /// With the scenario's bandwidth, and the threshold from the encoders' resolution and noise.
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let (bandwidth, plant, T) = (
            scenario.estimator.disturbance_bandwidth,
            &scenario.plant,
            scenario.dt_s(),
        );
        // Rounding adds the variance 1/12 of a count squared.
        let counts = (1.0 / 12.0 + plant.encoder_noise_counts * plant.encoder_noise_counts).sqrt();
        let sigma = if plant.encoder_bits == 0 {
            0.0
        } else {
            counts * TAU / libm::pow(2.0, f64::from(plant.encoder_bits))
        };
        let sigma_d = 0.5
            * sigma
            * SLOW
            * bandwidth
            * libm::pow(scenario.estimator.bandwidth, 1.5)
            * T.sqrt();
        Self {
            bandwidth,
            threshold: (NOISE * sigma_d).max(EXACT),
            lag_s: 2.0 / scenario.estimator.bandwidth.max(1.0),
            seen_at_rest: match bandwidth > 0.0 {
                true => LOAD.max(NOISE * sigma),
                false => f64::INFINITY,
            },
        }
    }

    /// The state after a tick of `T` seconds that left `residual` unexplained, rad/s², `since_s` after the filters began.
    pub(crate) fn learned<const N: usize>(
        &self,
        before: &Unexplained<N>,
        residual: &SVector<f64, N>,
        T: f64,
        since_s: f64,
    ) -> Unexplained<N> {
        let a = residual + before.explained();
        let follow = |x: &SVector<f64, N>, bandwidth: f64| x + (a - x) * (bandwidth * T).min(1.0);
        let (mut d, slow) = (
            follow(&before.d, self.bandwidth),
            follow(&before.slow, SLOW * self.bandwidth),
        );
        let presence = before.presence.zip_map(&slow, |presence, slow| {
            if slow.abs() > self.threshold {
                (presence + T / RISE_S).min(1.0 + HELD_S / FALL_S)
            } else {
                (presence - T / FALL_S).max(0.0)
            }
        });
        if since_s < BEGUN.0 {
            let seen = 1.0 - libm::exp(-self.bandwidth * (since_s - self.lag_s).max(0.0));
            for i in (0..N).filter(|i| before.presence[*i] <= 0.0 && presence[*i] > 0.0) {
                d[i] /= seen.max(1.0 / BEGUN.1);
            }
        }
        Unexplained { d, slow, presence }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    fn scenario(bits: u32) -> Disturbance {
        let text = format!(
            "name='t'\nrobot='puma560'\nstart.posture='ready'\nsegment=[{{duration_s=1.0}}]\n[plant]\nencoder_bits={bits}\n\
             [estimator]\nbandwidth=150.0\ndisturbance_bandwidth=50.0"
        );
        Disturbance::new(&Scenario::parse("test", &text, &[]).unwrap())
    }

    #[test]
    fn finer_encoders_explain_less() {
        let (coarse, fine, ideal) = (scenario(16), scenario(18), scenario(0));
        assert!(
            (coarse.threshold / fine.threshold - 4.0).abs() < 1e-9,
            "σ_d goes with the resolution: {coarse:?} {fine:?}"
        );
        assert!(
            coarse.threshold > 0.02 && coarse.threshold < 0.1 && ideal.threshold == EXACT,
            "{coarse:?} {ideal:?}"
        );
    }

    /// The filters after `ticks` of a plant whose acceleration differs from the model's by `d`.
    fn after(
        filter: &Disturbance,
        mut state: Unexplained<1>,
        d: f64,
        ticks: u32,
    ) -> Unexplained<1> {
        for _ in 0..ticks {
            state = filter.learned(
                &state,
                &(Vector1::new(d) - state.explained()),
                1e-3,
                f64::INFINITY,
            );
        }
        state
    }

    #[test]
    fn within_the_noise_nothing_is_explained_and_beyond_it_everything() {
        let filter = scenario(16);
        let (small, large) = (0.99 * filter.threshold, -1.2 * filter.threshold);
        let quiet = after(&filter, Unexplained::none(), small, 5000);
        assert_eq!(quiet.explained()[0], 0.0);
        assert!((quiet.d[0] - small).abs() < 1e-3 * small, "{quiet:?}");
        let loud = after(&filter, quiet, large, 5000);
        assert!(
            (loud.explained()[0] - large).abs() < 1e-3 * large.abs(),
            "{loud:?}"
        );
    }

    #[test]
    fn a_disturbance_from_the_beginning_is_known_when_it_is_found() {
        let filter = scenario(16);
        let mut state = Unexplained::none();
        let mut tick = 0;
        while state.presence[0] <= 0.0 {
            tick += 1;
            // The observer's double pole delays what the filters see.
            let seen = 1.0 - (1.0 + 0.15 * f64::from(tick)) * (-0.15 * f64::from(tick)).exp();
            state = filter.learned(
                &state,
                &(Vector1::new(0.5 * seen) - state.explained()),
                1e-3,
                f64::from(tick) * 1e-3,
            );
        }
        assert!(
            (20..60).contains(&tick) && (state.d[0] - 0.5).abs() < 0.1,
            "tick {tick}: {state:?}"
        );
    }

    #[test]
    fn a_disturbance_near_the_threshold_is_held_and_let_go_smoothly() {
        let filter = scenario(16);
        let loud = after(&filter, Unexplained::none(), 1.5 * filter.threshold, 2000);
        let held = after(&filter, loud, 0.8 * filter.threshold, 400);
        assert_eq!(
            held.explained(),
            held.d,
            "it counts in full for a while: {held:?}"
        );
        let (mut state, mut largest) = (held, 0.0_f64);
        for _ in 0..2000 {
            let next = after(&filter, state, 0.8 * filter.threshold, 1);
            largest = largest.max((next.explained() - state.explained()).amax());
            state = next;
        }
        assert_eq!(state.explained()[0], 0.0);
        assert!(
            largest < 0.01 * filter.threshold,
            "a step of {largest} rad/s²"
        );
    }
}
