//! How far each joint will move when ζ is turned by null-space motion, before anything moves: in closed form where the arm has one.

use super::Charts;
use super::planar::PlanarArm;
use crate::linear::{rotation_exp, wrap_angle};
use crate::singular::Geometry;
use crate::singular::geometric::turned;
use crate::types::{Kind, Singularity};
use model::Terms;
use nalgebra::{SVector, Vector2, Vector3};

/// Turning rate of ζ below which the null motion does not turn it.
const TURNS: f64 = 0.05;

impl Charts {
    /// Joint motion that turns ζ by `angle` while the end-effector stands still, rad; `None` where there is none.
    ///
    /// Wrists and waist: inverse kinematics of the same pose at the turned ζ. By number: along the null motion, which is straight where C is held by
    /// joints that rest (any spherical wrist).
    #[must_use]
    pub fn turning<const N: usize>(
        &self,
        singularity: &Singularity<N>,
        terms: &Terms<N>,
        p_BC: &Vector3<f64>,
        angle: f64,
    ) -> Option<SVector<f64, N>> {
        match (self, singularity.kind) {
            (Self::Geometric(Geometry::ParallelAxes), Kind::Wrist | Kind::Overhead) => parallel_axes(terms, p_BC, singularity.kind, angle),
            (Self::Puma(_), Kind::Overhead) => {
                let turn = rotation_exp(&(terms.z[0] * angle));
                let mut by = spherical_wrist(terms, &(turn * terms.z[N - 3]), &(turn * terms.z[N - 2]));
                by[0] = angle;
                Some(by)
            }
            (Self::Puma(_), Kind::Wrist) => {
                let along = if terms.z[N - 3].dot(&terms.z[N - 1]) < 0.0 { -1.0 } else { 1.0 };
                Some(SVector::from_fn(|i, _| {
                    if i == N - 3 {
                        angle
                    } else if i == N - 1 {
                        -angle * along
                    } else {
                        0.0
                    }
                }))
            }
            (Self::Numeric, _) | (_, Kind::Numeric) if singularity.kappa_2.abs() > TURNS => {
                Some(singularity.aux_row * (angle / singularity.kappa_2))
            }
            _ => None,
        }
    }
}

/// The last three joints' motion that keeps the hand where it is while the forearm turns so that its axis and axis 5 would be `z4` and `z5`.
fn spherical_wrist<const N: usize>(terms: &Terms<N>, z4: &Vector3<f64>, z5: &Vector3<f64>) -> SVector<f64, N> {
    let (old_4, old_5, z6) = (terms.z[N - 3], terms.z[N - 2], terms.z[N - 1]);
    // sin q5 = −(z4×z5)·z6 keeps its sign.
    let bend = |z4: &Vector3<f64>, z5: &Vector3<f64>| libm::atan2(-z4.cross(z5).dot(&z6), z4.dot(&z6));
    let side = if bend(&old_4, &old_5) < 0.0 { -1.0 } else { 1.0 };
    let w = z4.cross(&z6) * side;
    let new_5 = if w.norm() > 1e-6 { w.normalize() } else { *z5 };
    let about = |axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>| libm::atan2(axis.dot(&from.cross(to)), from.dot(to));
    let (q4, q5, q6) = (about(z4, z5, &new_5), wrap_angle(bend(z4, &new_5) - bend(&old_4, &old_5)), -about(&z6, &old_5, &new_5));
    let mut by = SVector::zeros();
    (by[N - 3], by[N - 2], by[N - 1]) = (q4, q5, q6);
    by
}

fn parallel_axes<const N: usize>(terms: &Terms<N>, p_BC: &Vector3<f64>, kind: Kind, angle: f64) -> Option<SVector<f64, N>> {
    let arm = PlanarArm::new(terms, p_BC);
    let plane = arm.plane;
    let along = if plane.n.dot(&terms.z[5]) < 0.0 { -1.0 } else { 1.0 };
    let mut by = SVector::zeros();
    let z5 = if kind == Kind::Wrist {
        by[5] = -angle * along;
        turned(&plane.z5, angle)
    } else {
        // The arm's plane turns about the waist axis, C on it; axis 5 stays normal to n and z6.
        let turn = rotation_exp(&(plane.z1 * angle));
        let (n, x) = (turn * plane.n, turn * plane.x);
        let m = n.cross(&terms.z[5]);
        let bend = |n: &Vector3<f64>, z5: &Vector3<f64>| libm::atan2(n.cross(z5).dot(&terms.z[5]), n.dot(&terms.z[5]));
        let side = if bend(&plane.n, &terms.z[4]) < 0.0 { 1.0 } else { -1.0 };
        let z5 = if m.norm() > 1e-6 { m.normalize() * side } else { turn * terms.z[4] };
        by[0] = angle;
        by[4] = -wrap_angle(bend(&n, &z5) - bend(&plane.n, &terms.z[4]));
        by[5] = -libm::atan2(terms.z[5].dot(&terms.z[4].cross(&z5)), terms.z[4].dot(&z5));
        Vector2::new(z5.dot(&plane.z1), z5.dot(&x))
    };
    let new = arm.solve(&plane.C, &z5)?;
    let old = [libm::atan2(plane.upper.y, plane.upper.x), plane.theta(), libm::atan2(plane.z5.y, plane.z5.x)];
    let link_4 = if kind == Kind::Wrist { angle } else { wrap_angle(new[2] - old[2]) };
    let (upper, theta) = (wrap_angle(new[0] - old[0]), wrap_angle(new[1] - old[1]));
    by[1] = upper * plane.signs[0];
    by[2] = theta * plane.signs[1];
    by[3] = (link_4 - upper - theta) * plane.signs[2];
    Some(by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::singular::{Analyzer, PumaFactors};
    use crate::testing::robot;
    use model::{Factors, Model};
    use shared_types::scenario::Analysis;

    fn charts<const N: usize>(name: &str) -> Charts {
        let robot = robot(name);
        match robot.factors {
            Factors::Puma { a2, a3, d4 } => Charts::Puma(PumaFactors::new(a2, a3, d4)),
            _ => Charts::Geometric(crate::singular::GeometricFactors::of::<N>(robot).unwrap().geometry),
        }
    }

    /// At a lock, the predicted motion leaves the end-effector where it is, whole, and turns ζ by the angle.
    fn predicted<const N: usize>(name: &str, place: usize, q: SVector<f64, N>, angle: f64) {
        let model = Model::<N>::new(robot(name), None).unwrap();
        let zero = SVector::zeros();
        let analysed = |q: &SVector<f64, N>| Analyzer::new(robot(name), &Analysis::default()).step(q, &zero, &model.evaluate(q, &zero));
        let (terms, report) = (model.evaluate(&q, &zero), analysed(&q));
        let one = report.singularities[place];
        assert!(one.s.abs() < 1e-9, "{name}: {one:?}");
        let by = charts::<N>(name).turning(&one, &terms, &report.p_BC, angle).unwrap();
        let there = model.evaluate(&(q + by), &zero).X_BE;
        assert!((there.p - terms.X_BE.p).norm() < 1e-9 && (there.R - terms.X_BE.R).norm() < 1e-9, "{name}: the hand moves, {by}");
        let zeta = analysed(&(q + by)).singularities[place].axis();
        let about: Vector3<f64> = one.R_BS.column(1).into_owned();
        let turned = libm::atan2(about.dot(&one.axis().cross(&zeta)), one.axis().dot(&zeta));
        assert!(wrap_angle(turned - angle).abs() < 1e-9, "{name}: ζ turned by {turned}");
    }

    #[test]
    fn what_is_predicted_keeps_the_hand_still_and_turns_zeta() {
        for angle in [-1.2, 0.4, 1.5] {
            predicted("puma560", 1, SVector::from([0.3, -1.0, 2.9, 0.2, 0.0, 0.1]), angle);
            predicted("ur5", 1, SVector::from([0.3, -1.2, 1.6, -1.0, 0.0, 0.2]), angle);
        }
        // Straight up with the elbow bent: R = 0 at q2 = atan2(−K, M).
        let (a2, L3, q3) = (0.4318, 0.4331, 2.6_f64);
        let theta = q3 - std::f64::consts::FRAC_PI_2;
        let q2 = libm::atan2(-(a2 + L3 * libm::cos(theta)), -L3 * libm::sin(theta));
        for angle in [-0.6, 0.5] {
            predicted("puma560-ideal", 2, SVector::from([0.3, q2, q3, 0.2, 0.9, 0.1]), angle);
        }
    }
}
