//! The acceleration that the model does not explain: a wrong mass, friction, a payload.
//!
//! A low-pass filter of the residual acceleration a = innovation·h/T² + d_e, d_e the share that the prediction already contains:
//!
//! d ← d + ω T (a − d)
//!
//! While d is within the encoders' noise, d_e = 0: a model that is exact stays exact, and its runs are those without a disturbance observer. Beyond it
//! d_e = d: then a − d = innovation·h/T², the integral action of a third-order fading-memory filter. Between the two ω grows with the share.
//!
//! Against white encoder noise of standard deviation σ and the observer's bandwidth b ≫ ω, ∫ of the filter's power gives σ_d = σ ω b^1.5 √T / 2.

use nalgebra::SVector;
use shared_types::scenario::Scenario;
use std::f64::consts::TAU;

/// Share of the bandwidth while nothing is explained: the thresholds go with it, and what stays unexplained below them.
const QUIET: f64 = 0.1;

/// Multiples of σ_d at which d begins to count, and at which it counts in full.
const NOISE: (f64, f64) = (6.0, 12.0);

/// The same where encoders are ideal, rad/s²: what the prediction's own step leaves.
const EXACT: f64 = 0.01;

/// The filter's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Disturbance {
    /// Bandwidth while d counts in full, rad/s; 0: off.
    bandwidth: f64,
    /// |d| at which it begins to count, rad/s².
    begins: f64,
    /// |d| from which on it counts in full, rad/s².
    full: f64,
}

impl Disturbance {
    /// As `scenario` tunes it, with thresholds from the encoders' resolution and noise.
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let (bandwidth, plant, T) = (scenario.estimator.disturbance_bandwidth, &scenario.plant, scenario.dt_s());
        // Rounding adds the variance 1/12 of a count squared.
        let counts = (1.0 / 12.0 + plant.encoder_noise_counts * plant.encoder_noise_counts).sqrt();
        let sigma = if plant.encoder_bits == 0 { 0.0 } else { counts * TAU / libm::pow(2.0, f64::from(plant.encoder_bits)) };
        let sigma_d = 0.5 * sigma * QUIET * bandwidth * libm::pow(scenario.estimator.bandwidth, 1.5) * T.sqrt();
        Self { bandwidth, begins: (NOISE.0 * sigma_d).max(EXACT), full: (NOISE.1 * sigma_d).max(2.0 * EXACT) }
    }

    /// Share of a joint's d that counts, 0 to 1, continuous with its slope.
    fn share(&self, d: f64) -> f64 {
        let x = ((d.abs() - self.begins) / (self.full - self.begins)).clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    }

    /// The share of d that the prediction contains and the controller compensates, rad/s².
    pub(crate) fn explained<const N: usize>(&self, d: &SVector<f64, N>) -> SVector<f64, N> {
        d.map(|d| d * self.share(d))
    }

    /// d after a tick of `T` seconds that left `residual` unexplained, rad/s².
    pub(crate) fn learned<const N: usize>(&self, d: &SVector<f64, N>, residual: &SVector<f64, N>, T: f64) -> SVector<f64, N> {
        d.zip_map(residual, |d, residual| {
            let share = self.share(d);
            let rate = (self.bandwidth * T * (QUIET + (1.0 - QUIET) * share)).min(1.0);
            d + rate * (residual + d * share - d)
        })
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
        assert!((coarse.begins / fine.begins - 4.0).abs() < 1e-9, "σ_d goes with the resolution: {coarse:?} {fine:?}");
        assert!(coarse.begins > 0.02 && coarse.begins < 0.1 && ideal.begins == EXACT, "{coarse:?} {ideal:?}");
    }

    #[test]
    fn within_the_noise_nothing_is_explained_and_beyond_it_everything() {
        let filter = scenario(16);
        let small = Vector1::new(0.99 * filter.begins);
        assert_eq!(filter.explained(&small)[0], 0.0);
        let large = Vector1::new(-1.01 * filter.full);
        assert_eq!(filter.explained(&large), large);
        // A constant residual is learned, and what is explained stays without one.
        let mut d = Vector1::zeros();
        (0..2000).for_each(|_| d = filter.learned(&d, &small, 1e-3));
        assert!((d - small).amax() < 1e-3 * small.amax(), "{d}");
        assert_eq!(filter.learned(&large, &Vector1::zeros(), 1e-3), large);
    }
}
