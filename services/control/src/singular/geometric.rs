//! Singularities by the geometry of two widespread kinds of arm. No length is declared: the axes say what the arm is.
//!
//! * **Parallel axes** (Universal Robots and its kin, six joints): axes 2, 3, 4 are parallel along n, axis 1 meets axis 2 at a right angle, axis 5 is
//!   normal to n and meets axis 6 at a right angle in C. Joints 2 to 6 cannot move C along n, and joints 2 to 4 cannot turn the hand but about n, so
//!   det J = ±R·(L2 L3 sin θ)·(n×z5·z6)     [CK95 Eq. 1, factorised]
//!   with R the in-plane distance of C from the waist axis, L2 and L3 the lengths of upper arm and forearm, θ the elbow angle from full stretch.
//! * **Spherical shoulder** (seven joints): axes 1, 2, 3 meet in S, axes 5, 6, 7 in C. Joints 1 to 3 move C on a sphere about S, so that
//!   pᵀJ = −L2 L3 sin θ·e4 exactly, with p = C − S. Where axes 5 and 7 are parallel the spare joint stands in, by turning the arm about p: the wrist is
//!   singular only where that does not turn the hand about n = z5×z6 either, two conditions at once, and its measure is the length of both.
//!   Where axes 1 to 3 all move C in one direction (two conditions, too) nothing is reported: there the law refuses.

use super::numeric::meeting;
use super::puma::{PumaFactors, frame, unit, wrist};
use super::{Measures, Posture};
use crate::MAX_SINGULARITIES;
use crate::linear::stack;
use crate::types::{Class, Kind, Singularity};
use model::{JointKind, Model, Robot, Terms};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

/// Sine of an angle, or distance in m, that counts as none.
const EXACT: f64 = 1e-6;

/// What an arm's axes say it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// Waist, three parallel axes, two that meet at a right angle.
    ParallelAxes,
    /// Three axes that meet in `S` (base axes, m), an elbow, three axes that meet.
    SphericalShoulder {
        /// The shoulder's centre.
        S: Vector3<f64>,
    },
}

/// Factors of det J, or of det JJᵀ, that follow from where the axes meet and which are parallel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometricFactors {
    /// What kind of arm it is.
    pub geometry: Geometry,
    /// C on the last axis, from its origin, m.
    offset: f64,
}

impl GeometricFactors {
    /// The factors of `robot`; `None` where its axes are neither kind's.
    #[must_use]
    pub fn of<const N: usize>(robot: &Robot) -> Option<Self> {
        let turns = robot.joints.iter().all(|joint| joint.kind != JointKind::Prismatic);
        if !turns || !robot.task.is_full() || !(6..=7).contains(&N) {
            return None;
        }
        let model = Model::<N>::new(robot, None).ok()?;
        // What holds in three postures in general position holds in all.
        let mut found = None;
        for k in 0..3 {
            let q = SVector::from_fn(|i, _| 0.3 + (0.37 + 0.21 * f64::from(k)) * i as f64);
            let one = Self::at(&model.evaluate(&q, &SVector::zeros()))?;
            if *found.get_or_insert(one) != one && !one.close_to(&found?) {
                return None;
            }
        }
        found
    }

    fn close_to(&self, other: &Self) -> bool {
        let same = match (self.geometry, other.geometry) {
            (Geometry::SphericalShoulder { S: one }, Geometry::SphericalShoulder { S: two }) => (one - two).norm() < EXACT,
            (one, two) => one == two,
        };
        same && (self.offset - other.offset).abs() < EXACT
    }

    fn at<const N: usize>(terms: &Terms<N>) -> Option<Self> {
        let (offset, spherical) = meeting(terms);
        let (offset, z, p) = (offset?, &terms.z, &terms.p);
        let parallel = |i: usize, j: usize| z[i].cross(&z[j]).norm() < EXACT;
        let normal = |i: usize, j: usize| z[i].dot(&z[j]).abs() < EXACT;
        let passes = |i: usize, point: &Vector3<f64>| (point - p[i]).cross(&z[i]).norm() < EXACT;
        match N {
            6 => {
                let wrist = normal(4, 1) && normal(5, 4);
                let shoulder = normal(0, 1) && passes(1, &PumaFactors::shoulder(terms));
                (parallel(1, 2) && parallel(1, 3) && shoulder && wrist).then_some(Self { geometry: Geometry::ParallelAxes, offset })
            }
            7 if spherical => {
                let across = z[0].cross(&z[1]);
                let along = (p[1] - p[0]).cross(&z[1]).dot(&across) / across.norm_squared().max(EXACT);
                let S = p[0] + z[0] * along;
                (passes(1, &S) && passes(2, &S)).then_some(Self { geometry: Geometry::SphericalShoulder { S }, offset })
            }
            _ => None,
        }
    }
}

/// An arm of parallel axes in its own plane: coordinates along (z1, x) with x = n×z1, so that turning about n is counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// The parallel axes' direction.
    pub n: Vector3<f64>,
    /// The waist axis.
    pub z1: Vector3<f64>,
    /// n×z1.
    pub x: Vector3<f64>,
    /// Where the waist axis meets axis 2.
    pub S: Vector3<f64>,
    /// C in the plane, and its distance from it, m.
    pub C: Vector2<f64>,
    /// Along n, m.
    pub d: f64,
    /// Upper arm, from axis 2 to axis 3, m.
    pub upper: Vector2<f64>,
    /// Forearm, from axis 3 to axis 4, m.
    pub lower: Vector2<f64>,
    /// Axis 5.
    pub z5: Vector2<f64>,
    /// From axis 4 to C: along z5 and along n×z5, m.
    pub hand: Vector2<f64>,
    /// Directions of axes 2, 3, 4 along n: ±1.
    pub signs: [f64; 3],
}

impl Plane {
    /// The plane of a posture, C at `p_BC`.
    #[must_use]
    pub fn new<const N: usize>(terms: &Terms<N>, p_BC: &Vector3<f64>) -> Self {
        let (z1, n) = (terms.z[0], terms.z[1]);
        let (x, S) = (n.cross(&z1), PumaFactors::shoulder(terms));
        let flat = |v: &Vector3<f64>| Vector2::new(v.dot(&z1), v.dot(&x));
        let (z5, hand) = (flat(&terms.z[4]), flat(&(p_BC - terms.p[3])));
        Self {
            n,
            z1,
            x,
            S,
            C: flat(&(p_BC - S)),
            d: (p_BC - S).dot(&n),
            upper: flat(&(terms.p[2] - S)),
            lower: flat(&(terms.p[3] - terms.p[2])),
            z5,
            hand: Vector2::new(hand.dot(&z5), hand.dot(&quarter(&z5))),
            signs: [1, 2, 3].map(|i| if terms.z[i].dot(&n) < 0.0 { -1.0 } else { 1.0 }),
        }
    }

    /// Elbow angle from full stretch, (−π, π].
    #[must_use]
    pub fn theta(&self) -> f64 {
        libm::atan2(self.upper.perp(&self.lower), self.upper.dot(&self.lower))
    }
}

/// A quarter turn, counter-clockwise.
pub(crate) fn quarter(v: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// Turned by `angle`, counter-clockwise.
pub(crate) fn turned(v: &Vector2<f64>, angle: f64) -> Vector2<f64> {
    let (sin, cos) = libm::sincos(angle);
    v * cos + quarter(v) * sin
}

fn parallel_axes<const N: usize>(at: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize {
    let plane = Plane::new(at.terms, &at.at.p);
    let Plane { n, z1, x, C, d, upper, lower, signs, .. } = plane;
    let reach = upper.norm() + lower.norm();

    // Elbow: along the line from axis 2 to axis 4, ζᵀJ = −(L2 L3 sin θ/ρ)·θ̇ modulo the turn of link 4 and the motion along n.
    let theta = plane.theta();
    let (sin, cos) = libm::sincos(theta);
    let line = upper + lower;
    let rho = line.norm().max(1e-9);
    let zeta = (z1 * line.x + x * line.y) / rho;
    let fold = upper.norm() * lower.norm() / rho;
    let theta_rate = signs[1] * at.qdot[2];
    out[0] = Singularity {
        kind: Kind::Elbow,
        class: Class::Type1,
        s: sin,
        s_rate: cos * theta_rate,
        zeta_B: stack(&zeta, &Vector3::zeros()),
        R_BS: frame(&zeta, &n),
        gain: -fold * sin,
        aux: theta,
        aux_rate: theta_rate,
        aux_row: unit(2) * signs[1],
        kappa_1: fold,
        ..Singularity::none()
    };

    // Wrist: about m = n×z5 where z6 is parallel to n. With the turn about n kept, mᵀω = −(m·z6)/(n·z6)·φ̇ modulo the other rows.
    let (z5, z6) = (at.terms.z[4], at.terms.z[5]);
    let m = n.cross(&z5);
    let (sin, cos) = (m.dot(&z6), n.dot(&z6));
    let turn = SVector::<f64, N>::from_fn(|i, _| if (1..4).contains(&i) { signs[i - 1] } else { 0.0 });
    out[1] = Singularity {
        kind: Kind::Wrist,
        class: Class::Type2,
        angular: true,
        s: sin,
        s_rate: -cos * at.qdot[4],
        zeta_B: stack(&Vector3::zeros(), &m),
        R_BS: Matrix3::from_columns(&[m, n, z5]),
        gain: -sin / if cos.abs() > 0.1 { cos } else { 0.1_f64.copysign(cos) },
        aux: turn.dot(at.q),
        aux_rate: turn.dot(at.qdot),
        aux_row: turn,
        kappa_2: 1.0,
        ..Singularity::none()
    };

    // Overhead: along n where C is above the waist axis, ζᵀJ = R·e1 exactly.
    let R = C.y;
    let in_plane = |j: usize| x.x * at.at.J[(0, j)] + x.y * at.at.J[(1, j)] + x.z * at.at.J[(2, j)];
    out[2] = Singularity {
        kind: Kind::Overhead,
        class: if d.abs() > EXACT { Class::Mixed } else { Class::Type2 },
        s: R / reach,
        s_rate: (1..4).map(|j| in_plane(j) * at.qdot[j]).sum::<f64>() / reach,
        zeta_B: stack(&n, &Vector3::zeros()),
        R_BS: Matrix3::from_columns(&[n, z1, x]),
        gain: R,
        aux: at.q[0],
        aux_rate: at.qdot[0],
        aux_row: unit(0),
        kappa_1: d.abs(),
        kappa_2: 1.0,
        ..Singularity::none()
    };
    3
}

/// An elbow between two centres, in the plane normal to its axis: upper arm, forearm, and the share of p = C − S along the axis, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elbow {
    /// C − S.
    pub p: Vector3<f64>,
    /// Lengths of upper arm and forearm, m.
    pub lengths: [f64; 2],
    /// Angle from full stretch, (−π, π].
    pub theta: f64,
    /// p along the elbow's axis, m.
    pub offset: f64,
}

impl Elbow {
    /// The elbow whose axis goes through `E` along `n`.
    #[must_use]
    pub fn new(S: &Vector3<f64>, E: &Vector3<f64>, C: &Vector3<f64>, n: &Vector3<f64>) -> Self {
        let across = |v: Vector3<f64>| v - n * n.dot(&v);
        let (u, v) = (across(E - S), across(C - E));
        let theta = libm::atan2(n.dot(&u.cross(&v)), u.dot(&v));
        Self { p: C - S, lengths: [u.norm(), v.norm()], theta, offset: (C - S).dot(n) }
    }
}

fn spherical_shoulder<const N: usize>(S: &Vector3<f64>, at: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize {
    let n = at.terms.z[3];
    let elbow = Elbow::new(S, &at.terms.p[3], &at.at.p, &n);
    let (sin, cos) = libm::sincos(elbow.theta);
    let length = elbow.p.norm();
    let zeta = if length > 1e-9 { elbow.p / length } else { at.terms.z[2] };
    let fold = elbow.lengths[0] * elbow.lengths[1] / length.max(1e-9);
    out[0] = Singularity {
        kind: Kind::Elbow,
        class: Class::Type1,
        s: sin,
        s_rate: cos * at.qdot[3],
        zeta_B: stack(&zeta, &Vector3::zeros()),
        R_BS: frame(&zeta, &n),
        gain: -fold * sin,
        aux: elbow.theta,
        aux_rate: at.qdot[3],
        aux_row: unit(3),
        kappa_1: fold,
        ..Singularity::none()
    };
    out[1] = aided_wrist(at, &elbow.p);
    2
}

/// A wrist whose lock the spare joint can make up for: nᵀω = g_φ·φ̇ + (n·ŝ)·ψ̇ modulo the other rows, ψ the turn of the arm about ŝ = p/|p|.
///
/// s = g = √(g_φ² + (n·ŝ)²) ≥ 0, and the auxiliary rate is the one that is left, (g_φ·φ̇ + (n·ŝ)·ψ̇)/g. Two conditions must meet for s = 0, which a path
/// misses or passes at a distance: nothing is to be followed there, the rate is held.
fn aided_wrist<const N: usize>(at: &Posture<'_, N>, p: &Vector3<f64>) -> Singularity<N> {
    let alone = wrist(at);
    let (axis, length) = (alone.axis(), p.norm().max(1e-9));
    let around = p / length;
    let aid = axis.dot(&around);
    let g = (alone.gain * alone.gain + aid * aid).sqrt().max(1e-12);
    // ψ̇ = ŝ·ω of the upper arm.
    let swivel = SVector::<f64, N>::from_fn(|i, _| if i < 3 { around.dot(&at.terms.z[i]) } else { 0.0 });
    let aux_row = (alone.aux_row * alone.gain + swivel * aid) / g;
    let gain_rate = (1.0 + alone.gain * alone.gain) * at.qdot[N - 2];
    let velocity = crate::linear::linear(&(at.at.J * at.qdot));
    let around_rate = (velocity - around * around.dot(&velocity)) / length;
    let aid_rate = at.terms.omega[N - 3].cross(&axis).dot(&around) + axis.dot(&around_rate);
    Singularity {
        class: Class::Mixed,
        s: g,
        s_rate: (alone.gain * gain_rate + aid * aid_rate) / g,
        gain: g,
        aux: 0.0,
        aux_rate: aux_row.dot(at.qdot),
        aux_bias: 0.0,
        aux_row,
        ..alone
    }
}

impl<const N: usize> Measures<N> for GeometricFactors {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[N - 1] + terms.z[N - 1] * self.offset
    }

    fn measure(&mut self, posture: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize {
        match &self.geometry {
            Geometry::ParallelAxes => parallel_axes(posture, out),
            Geometry::SphericalShoulder { S } => spherical_shoulder(S, posture, out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::centre::AtCentre;
    use crate::law::{Active, kept_rows};
    use crate::linear::singular_values;
    use crate::singular::Analyzer;
    use crate::testing::{posture, robot};
    use crate::types::Report;
    use nalgebra::{SMatrix, Vector6};
    use proptest::prelude::*;
    use shared_types::scenario::Analysis;

    fn model<const N: usize>(name: &str) -> Model<N> {
        Model::new(robot(name), None).unwrap()
    }

    fn analysed<const N: usize>(name: &str, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> (Report<N>, Terms<N>) {
        let terms = model::<N>(name).evaluate(q, qdot);
        (Analyzer::new(robot(name), &Analysis::default()).step(q, qdot, &terms), terms)
    }

    #[test]
    fn axes_say_what_an_arm_is() {
        assert_eq!(GeometricFactors::of::<6>(robot("ur5")).map(|f| f.geometry), Some(Geometry::ParallelAxes));
        assert!(matches!(
            GeometricFactors::of::<7>(robot("iiwa14")).map(|f| f.geometry),
            Some(Geometry::SphericalShoulder { S }) if (S - Vector3::new(0.0, 0.0, 0.36)).norm() < 1e-9
        ));
        assert_eq!(GeometricFactors::of::<6>(robot("puma560")), None);
        assert_eq!(GeometricFactors::of::<3>(robot("planar3r")), None);
    }

    /// J without the reported directions, their auxiliary rows in their place: smallest singular value, unit-scaled.
    fn augmented_sigma<const N: usize>(report: &Report<N>, terms: &Terms<N>, engaged: &[bool]) -> f64 {
        let at = AtCentre::new(terms, &report.p_BC, &terms.omega[N - 1]);
        let actives: Vec<Active<N>> = (report.meant().iter().zip(engaged))
            .filter(|(_, yes)| **yes)
            .map(|(s, _)| Active { zeta_B: s.zeta_B, gain: s.gain, beta: 0.0, aux_row: s.aux_row, aux_acceleration: 0.0, aux_rate: 0.0 })
            .collect();
        let mut M = SMatrix::<f64, 6, N>::zeros();
        let kept = kept_rows(&[true; 6], &actives).unwrap();
        for (i, e) in kept.iter().enumerate() {
            let scale = if e.fixed_rows::<3>(0).norm() > 0.5 { 1.0 / report.length_m } else { 1.0 };
            M.set_row(i, &(at.J.tr_mul(e) * scale).transpose());
        }
        for (i, active) in actives.iter().enumerate() {
            M.set_row(kept.len() + i, &active.aux_row.transpose());
        }
        singular_values(&M).0[5]
    }

    fn a_promise_holds<const N: usize>(name: &str, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> Result<(), TestCaseError> {
        let (report, terms) = analysed(name, q, qdot);
        let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[N - 1]);
        let h = 1e-6;
        let (before, after) = (analysed(name, &(q - qdot * h), qdot).0, analysed(name, &(q + qdot * h), qdot).0);
        for i in 0..report.count {
            let (s, a, b) = (report.singularities[i], before.singularities[i], after.singularities[i]);
            if s.s.abs() > 1e-3 && s.s.abs() < 2.0 {
                prop_assert!(
                    ((b.s - a.s) / (2.0 * h) - s.s_rate).abs() < 1e-5,
                    "{i}: ds/dt is {}, not {}",
                    (b.s - a.s) / (2.0 * h),
                    s.s_rate
                );
            }
            // What two conditions make has no coordinate, only a rate.
            let counted = !(N == 7 && i == 1);
            if (b.aux - a.aux).abs() < 1.0 && counted {
                prop_assert!(((b.aux - a.aux) / (2.0 * h) - s.aux_rate).abs() < 1e-6, "{i}: auxiliary rate");
            }
            prop_assert!((s.aux_row.dot(qdot) - s.aux_rate).abs() < 1e-9, "{i}: the row is the rate's gradient");
            if counted {
                prop_assert!(((b.aux_rate - a.aux_rate) / (2.0 * h) - s.aux_bias).abs() < 1e-5, "{i}: auxiliary bias");
            }
            prop_assert!((s.R_BS.transpose() * s.R_BS - Matrix3::identity()).norm() < 1e-9 && (s.R_BS.column(0) - s.axis()).norm() < 1e-9);
        }
        // ζᵀJ − gain·aux is a combination of the other rows, the spare joint's motion left out.
        for (i, s) in report.meant().iter().enumerate() {
            let regular = report.meant().iter().enumerate().all(|(j, other)| j == i || other.s.abs() > 0.2);
            if !regular || s.s.abs() > 0.3 {
                continue;
            }
            let rest = at.J.tr_mul(&s.zeta_B) - s.aux_row * s.gain;
            let alone = Active { zeta_B: s.zeta_B, gain: s.gain, beta: 0.0, aux_row: s.aux_row, aux_acceleration: 0.0, aux_rate: 0.0 };
            let kept = kept_rows(&[true; 6], &[alone]).unwrap();
            let rows = SMatrix::<f64, 5, N>::from_fn(|r, c| at.J.tr_mul(&kept[r])[c]);
            let Some(gram) = (rows * rows.transpose()).try_inverse() else { continue };
            let residual = rest - rows.transpose() * (gram * (rows * rest));
            prop_assert!(residual.norm() < 1e-6, "{i}: {} beyond the kept rows", residual.norm());
        }
        Ok(())
    }

    proptest! {
        // covers: CK95 Eq. 1
        #[test]
        fn the_determinant_of_parallel_axes_is_the_product_of_the_factors(q in posture(&model::<6>("ur5"))) {
            let (report, _) = analysed("ur5", &q, &Vector6::zeros());
            let [elbow, wrist, overhead] = [0, 1, 2].map(|i| report.singularities[i].s);
            let (L2, L3) = (0.425, 0.39225);
            let product = L2 * L3 * (L2 + L3) * elbow * wrist * overhead;
            prop_assert!((report.det.abs() - product.abs()).abs() < 1e-12, "{} {product}", report.det);
        }

        #[test]
        fn a_ur5_keeps_the_promises_of_a_source(q in posture(&model::<6>("ur5")), qdot in prop::array::uniform6(-1.0..1.0)) {
            a_promise_holds("ur5", &q, &SVector::from(qdot))?;
        }

        #[test]
        fn an_iiwa_keeps_the_promises_of_a_source(q in posture(&model::<7>("iiwa14")), qdot in prop::array::uniform7(-1.0..1.0)) {
            a_promise_holds("iiwa14", &q, &SVector::from(qdot))?;
        }

        #[test]
        fn a_ur5_is_regular_with_the_locked_directions_replaced(q in posture(&model::<6>("ur5")), locks in 0..8_usize, off in prop::array::uniform3(-0.1..0.1)) {
            // Any of the three locks, or several: elbow q3, wrist q5, overhead by q2.
            let mut q = q;
            if locks & 1 != 0 {
                q[2] = off[0];
            }
            if locks & 2 != 0 {
                q[4] = off[1];
            }
            if locks & 4 != 0 {
                let R = |q2: f64| analysed("ur5", &SVector::from([q[0], q2, q[2], q[3], q[4], q[5]]), &Vector6::zeros()).0.singularities[2].gain;
                // R = A sin q2 + B cos q2.
                q[1] = libm::atan2(-R(0.0), R(std::f64::consts::FRAC_PI_2)) + off[2];
            }
            let (report, terms) = analysed("ur5", &q, &Vector6::zeros());
            // Folded back, upper arm and forearm lie on each other: beyond the elbow's own limit.
            prop_assume!(libm::cos(q[2]) > -0.9);
            let engaged: Vec<bool> = report.meant().iter().map(|s| s.s.abs() < 0.2).collect();
            let sigma = augmented_sigma(&report, &terms, &engaged);
            prop_assert!(sigma > 0.01, "{engaged:?}: σ_min {sigma}");
        }
    }
}
