//! The control law: which one, its gains, and the parameters of the baselines.

use serde::{Deserialize, Serialize};

use super::analysis::BySingularity;
use crate::file::{Complaint, positive, require};

/// The control law and its gains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Control {
    /// Which law.
    pub strategy: Strategy,
    /// Task stiffness; 1/s².
    pub k_p: f64,
    /// Task damping; 1/s.
    pub k_v: f64,
    /// Damping of the null space, k_vq of Eq. 5 (k_v where absent); 1/s. With 0 a posture's potential is without dissipation, and the null space swings in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub k_vq: Option<f64>,
    /// Auxiliary (null-space) position gain; 1/s.
    pub k_aux: f64,
    /// Largest auxiliary rates; rad/s.
    #[serde(deserialize_with = "BySingularity::rate_max")]
    pub aux_rate_max: BySingularity,
    /// Largest changes of the auxiliary rates; rad/s².
    #[serde(deserialize_with = "BySingularity::slew")]
    pub aux_slew: BySingularity,
    /// Whether the governor may stretch time to respect limits.
    pub governor: bool,
    /// Whether the disturbance estimate is compensated, up to a share of each torque limit.
    pub compensate_disturbance: bool,
    /// The tuning of the baselines.
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

/// Parameters of the baselines, each at the best found: `armplane compare sweep --tune` searches them again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Baseline {
    /// Of damped least squares.
    pub damped_least_squares: Damping,
    /// Of the inverse kinematics that joint-space PD follows.
    pub joint_pd: Damping,
    /// Truncated SVD drops directions with a smaller singular value (unit-scaled).
    pub truncated_svd_floor: f64,
    /// Of hold-and-blend.
    pub hold_and_blend: HoldAndBlend,
}

/// λ² = largest²·(1 − w/onset)² where the manipulability w (unit-scaled) is below the onset, else 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Damping {
    /// Manipulability below which damping begins.
    pub onset: f64,
    /// Largest λ.
    pub largest: f64,
}

/// See [`Baseline::hold_and_blend`]. Published defaults: blend = [0.006, 0.06], hold_k_p = 50, hold_k_v = 14, push = 0.01, push_k_v = 5.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HoldAndBlend {
    /// Singular value over the largest: below the first the joint strategy alone, above the second the task alone.
    pub blend: [f64; 2],
    /// Stiffness of holding the joints (Type 1); 1/s².
    pub hold_k_p: f64,
    /// Damping of holding the joints (Type 1); 1/s.
    pub hold_k_v: f64,
    /// Open-loop torque (Type 2), as a share of the joint's limit.
    pub push: f64,
    /// Damping of the open-loop torque's motion; 1/s.
    pub push_k_v: f64,
}

impl Default for Baseline {
    fn default() -> Self {
        Self {
            damped_least_squares: Damping {
                onset: 0.02,
                largest: 0.005,
            },
            joint_pd: Damping {
                onset: 0.16,
                largest: 0.01,
            },
            truncated_svd_floor: 0.005,
            hold_and_blend: HoldAndBlend::default(),
        }
    }
}

impl Default for HoldAndBlend {
    fn default() -> Self {
        Self {
            blend: [0.001, 0.004],
            hold_k_p: 50.0,
            hold_k_v: 14.0,
            push: 0.01,
            push_k_v: 5.0,
        }
    }
}

/// The control laws that can be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategy {
    /// The paper's law as one continuous solve (the default).
    #[default]
    Blended,
    /// The paper's own hard switching at η.
    ChangKhatib,
    /// Operational space control that ignores singularities.
    OperationalSpace,
    /// Damped least squares (Nakamura & Hanafusa 1986).
    DampedLeastSquares,
    /// Truncated singular value decomposition.
    TruncatedSvd,
    /// Hold-and-blend, as published for Stanford's SAI.
    HoldAndBlend,
    /// Joint-space PD on inverse kinematics.
    JointPd,
    /// Posture control in the null space of the pseudo-inverse (Fig. 1).
    PseudoInverse,
    /// The same in the dynamically consistent null space (Fig. 2).
    DynamicallyConsistent,
}

impl Strategy {
    /// Every law, the default first.
    pub const ALL: [Self; 9] = [
        Self::Blended,
        Self::ChangKhatib,
        Self::OperationalSpace,
        Self::DampedLeastSquares,
        Self::TruncatedSvd,
        Self::HoldAndBlend,
        Self::JointPd,
        Self::PseudoInverse,
        Self::DynamicallyConsistent,
    ];

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

    /// Its name in scenario files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Blended => "blended",
            Self::ChangKhatib => "chang-khatib",
            Self::OperationalSpace => "operational-space",
            Self::DampedLeastSquares => "damped-least-squares",
            Self::TruncatedSvd => "truncated-svd",
            Self::HoldAndBlend => "hold-and-blend",
            Self::JointPd => "joint-pd",
            Self::PseudoInverse => "pseudo-inverse",
            Self::DynamicallyConsistent => "dynamically-consistent",
        }
    }
}

impl Control {
    /// Whether one of our laws runs with its governor.
    #[must_use]
    pub fn governs(&self) -> bool {
        self.strategy.is_ours() && self.governor
    }

    pub(super) fn check(&self) -> Result<(), Complaint> {
        let Baseline {
            damped_least_squares: damping,
            joint_pd,
            truncated_svd_floor,
            hold_and_blend: hold,
        } = &self.baseline;
        let [low, high] = hold.blend;
        for (name, value) in [
            ("k_p", self.k_p),
            ("k_v", self.k_v),
            ("k_aux", self.k_aux),
            ("baseline.damped_least_squares.onset", damping.onset),
            ("baseline.damped_least_squares.largest", damping.largest),
            ("baseline.joint_pd.onset", joint_pd.onset),
            ("baseline.joint_pd.largest", joint_pd.largest),
            ("baseline.truncated_svd_floor", *truncated_svd_floor),
            ("baseline.hold_and_blend.blend.0", low),
            ("baseline.hold_and_blend.blend.1", high - low),
            ("baseline.hold_and_blend.hold_k_p", hold.hold_k_p),
            ("baseline.hold_and_blend.hold_k_v", hold.hold_k_v),
            ("baseline.hold_and_blend.push", hold.push),
            ("baseline.hold_and_blend.push_k_v", hold.push_k_v),
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
