//! The analyzer's report and the controller's command, sized by the arm; `wire` turns both into messages.

use crate::limits::torque::Limited;
use crate::linear::{Joints, Matrix3, Vector3, Vector6};
use crate::paper::neighborhood::Neighborhood;
use model::Pose;
use shared_types::{MAX_SINGULARITIES, ServoState, codes};

/// An enum with its integers on the wire; the first variant is the default.
macro_rules! coded {
    ($(#[$meta:meta])* $name:ident { $(#[$first_doc:meta])* $first:ident = $first_code:ident, $( $(#[$doc:meta])* $variant:ident = $code:ident ),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub enum $name { $(#[$first_doc])* #[default] $first, $( $(#[$doc])* $variant ),* }

        impl $name {
            /// The named integer on the wire.
            pub fn code(self) -> u32 {
                match self { Self::$first => codes::$first_code, $( Self::$variant => codes::$code ),* }
            }
            /// From the wire; `None` for a code that has no name.
            pub fn from_code(code: u32) -> Option<Self> {
                match code { codes::$first_code => Some(Self::$first), $( codes::$code => Some(Self::$variant), )* _ => None }
            }
        }
    };
}

coded! {
    /// The name of a singularity.
    Kind {
        /// Found numerically.
        Numeric = KIND_NUMERIC,
        /// The arm is stretched or folded.
        Elbow = KIND_ELBOW,
        /// Axes 4 and 6 are parallel.
        Wrist = KIND_WRIST,
        /// The wrist centre is on the waist axis.
        Overhead = KIND_OVERHEAD,
        /// Axes 1 and 3 are parallel.
        Shoulder = KIND_SHOULDER,
    }
}

coded! {
    /// The paper's two types, and what lies between.
    Class {
        /// Not classified (yet).
        Unknown = TYPE_UNKNOWN,
        /// Null-space motion moves the end-effector along ζ.
        Type1 = TYPE_1,
        /// Null-space motion only turns ζ.
        Type2 = TYPE_2,
        /// Both.
        Mixed = TYPE_MIXED,
    }
}

coded! {
    /// The mode of the law at one singularity.
    Mode {
        /// Outside the neighbourhood.
        Regular = MODE_REGULAR,
        /// Between η_in and η_out, on the way in.
        Blend = MODE_BLEND,
        /// Inside, following the auxiliary reference.
        Track = MODE_TRACK,
        /// Inside, passing through with ζ off the direction of travel.
        Pass = MODE_PASS,
        /// Inside, ζ held.
        Hold = MODE_HOLD,
        /// Inside, ζ being turned to ζ_d.
        Reorient = MODE_REORIENT,
        /// Inside, goal beyond reach.
        Slide = MODE_SLIDE,
        /// Outside again, auxiliary error being removed.
        Recover = MODE_RECOVER,
    }
}

coded! {
    /// Where the task is.
    Phase {
        /// Following the path.
        Running = PHASE_RUNNING,
        /// Holding the last pose.
        Settling = PHASE_SETTLING,
        /// Finished.
        Done = PHASE_DONE,
        /// The law refused to go on; the torque brings the arm to rest.
        Refused = PHASE_REFUSED,
    }
}

coded! {
    /// Why the controller refuses to go on.
    Refusal {
        /// It goes on.
        None = REFUSAL_NONE,
        /// The state is not finite.
        State = REFUSAL_STATE,
        /// The report cannot be read.
        Report = REFUSAL_REPORT,
        /// The law's system of equations is singular.
        Singular = REFUSAL_SINGULAR,
        /// No clock is slow enough.
        Speed = REFUSAL_SPEED,
        /// The joint limits leave no room to turn ζ.
        Room = REFUSAL_ROOM,
        /// The torque is not finite.
        Torque = REFUSAL_TORQUE,
        /// No route follows the path within the joint limits.
        Route = REFUSAL_ROUTE,
        /// A joint is about to reach its limit.
        Limit = REFUSAL_LIMIT,
        /// A direction is lost that no listed singularity explains.
        Unlisted = REFUSAL_UNLISTED,
        /// The estimate moves as no arm can.
        Estimate = REFUSAL_ESTIMATE,
        /// The arm was held back or thrown: far from the reference arm.
        Parted = REFUSAL_PARTED,
        /// The checkpoint that it was restored from is damaged.
        Checkpoint = REFUSAL_CHECKPOINT,
        /// In the direction of a force nothing was met.
        Contact = REFUSAL_CONTACT,
        /// The hand met a surface and left it again and again.
        Bounce = REFUSAL_BOUNCE,
        /// The force did not come about.
        Pressing = REFUSAL_PRESSING,
    }
}

/// One singularity at one posture: a factor s_i of det J, its direction ζ_i, and the regular coordinate that replaces it.
///
/// Ensures, by formula or by number: inside the neighbourhood, the Jacobian without ζ's row and with `aux_row`
/// in its place is regular, and modulo the other rows `ζᵀJ = gain·aux_row`, `gain` vanishing with `s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Singularity<const N: usize> {
    /// Its name.
    pub kind: Kind,
    /// Its type, latched while inside.
    pub class: Class,
    /// Whether q is in D_si, hysteretic.
    pub inside: bool,
    /// Whether ζ is a rotation (its angular half is the unit vector) or a translation.
    pub angular: bool,
    /// s_i(q), signed, dimensionless.
    pub s: f64,
    /// ds_i/dt, 1/s.
    pub s_rate: f64,
    /// Entry threshold on |s_i|.
    pub eta_in: f64,
    /// Exit threshold on |s_i|.
    pub eta_out: f64,
    /// ζ_i at C in base axes, continuous in sign.
    pub zeta_B: Vector6,
    /// The other half of the lost covector, of which ζ_i is one half: in the lock every twist of C has ζ·v + other·ω = 0; m. If `angular`,
    /// ζ·ω + other·v = 0; 1/m. Zero where a formula lists the singularity, and not on the wire.
    pub other: Vector3,
    /// Singular frame: first axis along ζ_i.
    pub R_BS: Matrix3,
    /// Velocity along ζ_i per auxiliary rate, signed; m or 1.
    pub gain: f64,
    /// Share of `gain` that a vector measure lacks, 0 to 1, because `aux_row` has not turned towards it yet. Not on the wire.
    pub askew: f64,
    /// Auxiliary coordinate, rad.
    pub aux: f64,
    /// Its rate, rad/s.
    pub aux_rate: f64,
    /// Its acceleration at q̈ = 0, rad/s².
    pub aux_bias: f64,
    /// Its gradient.
    pub aux_row: Joints<N>,
    /// Second-order motion along ζ per null motion: > 0 is a fold. Of a vector measure of type 2 or mixed: along `aux_row`.
    pub kappa_1: f64,
    /// Turning rate of ζ along the null motion that `aux` counts; positive about the singular frame's second axis.
    pub kappa_2: f64,
}

impl<const N: usize> Singularity<N> {
    /// The unit vector of ζ_i: an axis of rotation if `angular`, else a direction of translation.
    pub fn axis(&self) -> Vector3 {
        self.R_BS.column(0).into_owned()
    }

    /// The coordinate whose sign is the side of a lock. An elbow's s_i has the same sign on both sides of some arms' folds; its own coordinate has not.
    #[inline]
    pub fn across(&self) -> f64 {
        match self.class {
            Class::Type1 => self.aux,
            _ => self.s,
        }
    }

    /// Velocity along ζ per rate of the coordinate, whatever direction that has; m or 1.
    pub(crate) fn slope(&self) -> f64 {
        self.gain * (1.0 - self.askew)
    }

    /// Weight of operational control along ζ_i in its neighbourhood, were its measure `s`.
    #[inline]
    pub(crate) fn openness(&self, s: f64) -> f64 {
        let Self {
            eta_in, eta_out, ..
        } = *self;
        Neighborhood { eta_in, eta_out }.openness(s)
    }

    /// Nothing: what unused places of a report hold.
    #[inline]
    pub fn none() -> Self {
        Self {
            kind: Kind::Numeric,
            class: Class::Unknown,
            inside: false,
            angular: false,
            s: 0.0,
            s_rate: 0.0,
            eta_in: 0.0,
            eta_out: 0.0,
            zeta_B: Vector6::zeros(),
            other: Vector3::zeros(),
            R_BS: Matrix3::zeros(),
            gain: 0.0,
            askew: 0.0,
            aux: 0.0,
            aux_rate: 0.0,
            aux_bias: 0.0,
            aux_row: Joints::zeros(),
            kappa_1: 0.0,
            kappa_2: 0.0,
        }
    }
}

/// Where the arm is singular, or nearly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report<const N: usize> {
    /// Rank of J at the stated tolerance.
    pub rank: u32,
    /// det J at E for square J, else √det JJᵀ.
    pub det: f64,
    /// Yoshikawa's √det JJᵀ, unit-scaled.
    pub manipulability: f64,
    /// The length that makes metres and radians comparable, m.
    pub length_m: f64,
    /// Where singularities are analysed, in B, m.
    pub p_BC: Vector3,
    /// How many places of `singularities` are used.
    pub count: usize,
    /// The singularities, in an order that never changes within a run.
    pub singularities: [Singularity<N>; MAX_SINGULARITIES],
}

impl<const N: usize> Report<N> {
    /// A report of no posture: no singularity, and all else zero.
    #[inline]
    pub(crate) fn unexamined(length_m: f64) -> Self {
        Self {
            rank: 0,
            det: 0.0,
            manipulability: 0.0,
            length_m,
            p_BC: Vector3::zeros(),
            count: 0,
            singularities: [Singularity::none(); MAX_SINGULARITIES],
        }
    }

    /// The singularities in use.
    #[inline]
    pub fn listed(&self) -> &[Singularity<N>] {
        &self.singularities[..self.count.min(MAX_SINGULARITIES)]
    }
}

/// The torque, and the reference it follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<const N: usize> {
    /// Γ, N·m.
    pub tau: Joints<N>,
    /// The part that acts at the end-effector, with gravity and Coriolis, N·m.
    pub tau_task: Joints<N>,
    /// The part in the null space, N_T Γ₀, N·m.
    pub tau_null: Joints<N>,
    /// Desired pose of E.
    pub X_BE_d: Pose,
    /// Desired twist of E.
    pub V_BE_d: Vector6,
    /// Pose error of E, `[p_d − p; log(R_d Rᵀ)]`.
    pub error: Vector6,
    /// The path's own clock, s.
    pub path_time_s: f64,
    /// Its speed against real time.
    pub time_scale: f64,
    /// The torque within the drives' limits.
    pub limited: Limited,
    /// β_i per singularity.
    pub beta: [f64; MAX_SINGULARITIES],
    /// Auxiliary reference per singularity, rad.
    pub aux_d: [f64; MAX_SINGULARITIES],
    /// Auxiliary rate commanded per singularity, rad/s.
    pub aux_rate_d: [f64; MAX_SINGULARITIES],
    /// The null-space turn of ζ that is under way, as it was planned.
    pub plan: Option<Plan<N>>,
    /// The law's mode per singularity.
    pub mode: [Mode; MAX_SINGULARITIES],
    /// Index of the task segment.
    pub segment: u32,
    /// Where the task is.
    pub phase: Phase,
    /// Ticks in a row for which the estimate has been set aside.
    pub rejected_ticks: u32,
    /// The goal was beyond reach and has been clipped to the boundary.
    pub clipped: bool,
    /// Why the phase is [`Phase::Refused`].
    pub refusal: Refusal,
    /// The state of a steered run, all but its header.
    pub session: Option<ServoState>,
}

/// A null-space turn of ζ, predicted before it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan<const N: usize> {
    /// Place of the singularity in the report.
    pub place: usize,
    /// How far each joint will move, rad.
    pub by: Joints<N>,
    /// How long it will take, s.
    pub duration_s: f64,
}
