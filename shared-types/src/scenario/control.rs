//! The control law: which one, its gains, and the parameters of the baselines.

use serde::{Deserialize, Serialize};

use super::analysis::BySingularity;
use crate::file::{Complaint, positive, require};
use crate::words::words;

/// The control law and its gains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// The control law.
    pub strategy: Strategy,
    /// Task stiffness; 1/s².
    pub k_p: f64,
    /// Task damping; 1/s.
    pub k_v: f64,
    /// Null-space damping, k_vq of Eq. 5; 1/s. Default: k_v. At 0, a redundant arm swings in its
    /// null space.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub k_vq: Option<f64>,
    /// Position gain of the null-space motion along or around ζ; 1/s.
    pub k_aux: f64,
    /// Largest speed of that null-space motion, or of its correction where the path is planned: a plan
    /// keeps the joints' own limits; rad/s.
    #[serde(deserialize_with = "BySingularity::rate_max")]
    pub aux_rate_max: BySingularity,
    /// Largest acceleration of that null-space motion where no plan leads it; rad/s².
    #[serde(deserialize_with = "BySingularity::slew")]
    pub aux_slew: BySingularity,
    /// Slow down the path's clock when joints reach their limits.
    pub governor: bool,
    /// Cancel the estimated disturbance torque, up to a share of each torque limit.
    pub compensate_disturbance: bool,
    /// Settings of the baseline laws.
    pub baseline: Baseline,
}

impl Control {
    /// Damping of the null space, k_vq of Eq. 5; 1/s.
    #[must_use]
    pub fn k_vq(&self) -> f64 {
        self.k_vq.unwrap_or(self.k_v)
    }
}

impl Default for Control {
    fn default() -> Self {
        Self {
            strategy: Strategy::Blended,
            k_p: 400.0,
            k_v: 40.0,
            k_vq: None,
            k_aux: 12.0,
            aux_rate_max: BySingularity::RATE_MAX,
            aux_slew: BySingularity::SLEW,
            governor: true,
            compensate_disturbance: true,
            baseline: Baseline::default(),
        }
    }
}

// The defaults were found in grids, with and without the governor, on 27 to 36 lines that no comparison uses; the two leading settings of damped least
// squares were told apart on 126. No baseline does better without the governor.
/// Settings of the baseline laws. The defaults are the best found on lines of `armplane compare sweep`
/// at 0.28 m/s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Baseline {
    /// Damping of `damped-least-squares`.
    pub damped_least_squares: Damping,
}

/// λ² = largest² · (1 − w/onset)² if the manipulability w (J scaled to unit length) is below
/// `onset`, otherwise 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// Manipulability below which damping begins.
    pub onset: f64,
    /// Largest λ.
    pub largest: f64,
}

impl Default for Baseline {
    fn default() -> Self {
        Self {
            damped_least_squares: Damping {
                onset: 0.02,
                largest: 0.005,
            },
        }
    }
}

words! {
    /// The control laws that can be compared.
    Strategy {
        /// The paper's law as one continuous solve (the default).
        Blended "blended",
        /// The paper's law with its own hard switching at η.
        ChangKhatib "chang-khatib",
        /// Operational-space control that ignores singularities.
        OperationalSpace "operational-space",
        /// Damped least squares (Nakamura & Hanafusa 1986).
        DampedLeastSquares "damped-least-squares",
        /// Posture control in the null space of the pseudo-inverse (Fig. 1).
        PseudoInverse "pseudo-inverse",
        /// Posture control in the dynamically consistent null space (Fig. 2).
        DynamicallyConsistent "dynamically-consistent",
    }
}

impl Strategy {
    /// Whether it is the paper's law, in either form: its auxiliary coordinates drive the arm, their demand slows the clock, and foresight comes from
    /// their formulas. Not so under the laws of others.
    #[must_use]
    pub fn is_ours(self) -> bool {
        matches!(self, Self::Blended | Self::ChangKhatib)
    }

    /// Whether it controls an arm along a path past singularities: `compare` puts all of these side by side. The two projectors of the paper's Figures 1
    /// and 2 control the posture of a redundant arm.
    #[must_use]
    pub fn follows_paths(self) -> bool {
        !matches!(self, Self::PseudoInverse | Self::DynamicallyConsistent)
    }
}

impl Control {
    /// Whether one of our laws runs with its governor.
    #[must_use]
    pub fn governs(&self) -> bool {
        self.strategy.is_ours() && self.governor
    }

    pub(super) fn check(&self) -> Result<(), Complaint> {
        let damping = &self.baseline.damped_least_squares;
        for (name, value) in [
            ("k_p", self.k_p),
            ("k_v", self.k_v),
            ("k_aux", self.k_aux),
            ("baseline.damped_least_squares.onset", damping.onset),
            ("baseline.damped_least_squares.largest", damping.largest),
        ] {
            positive(&format!("control.{name}"), value)?;
        }
        let k_vq = self.k_vq();
        require(
            k_vq.is_finite() && k_vq >= 0.0,
            "control.k_vq",
            format!("the damping is {k_vq}"),
            "0 or more, in 1/s",
        )?;
        let limits = [
            ("aux_rate_max", &self.aux_rate_max),
            ("aux_slew", &self.aux_slew),
        ];
        for (key, values) in limits {
            for (name, value) in values.named() {
                positive(&format!("control.{key}.{name}"), value)?;
            }
        }
        Ok(())
    }
}
