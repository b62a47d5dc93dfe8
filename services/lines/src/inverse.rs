//! A PUMA's lengths, and its closed-form inverse kinematics.

use control::linear::{Joints, Matrix3, Vector3, rotation_exp, rotation_log, wrap_angle};
use model::{Model, Pose};

/// The lengths that the factors need, modified DH with Craig's zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PumaLengths {
    /// Upper arm, m.
    pub(crate) a2: f64,
    /// Forearm from elbow axis to wrist centre, √(a3² + d4²), m.
    pub(crate) L3: f64,
    /// q3 at full stretch, atan2(d4, a3), rad.
    pub(crate) q3_stretched: f64,
}

impl PumaLengths {
    /// From the DH lengths, m.
    pub(crate) fn new(a2: f64, a3: f64, d4: f64) -> Self {
        Self {
            a2,
            L3: (a3 * a3 + d4 * d4).sqrt(),
            q3_stretched: libm::atan2(d4, a3),
        }
    }

    /// Elbow angle from full stretch, (−π, π].
    pub(crate) fn theta(&self, q3: f64) -> f64 {
        wrap_angle(q3 - self.q3_stretched)
    }
}

/// Closed-form inverse kinematics of a PUMA at its wrist centre. Frame base axes; m, rad.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PumaInverse<'a> {
    /// The arm.
    pub(crate) model: &'a Model<6>,
    /// Its lengths.
    pub(crate) lengths: PumaLengths,
    /// Base axes with the arm's plane in the posture q = 0 as x, z2 as y and the waist axis as z: rows.
    axes: Matrix3,
    shoulder: Vector3,
    /// Distance of the arm's plane from the waist axis, m.
    offset: f64,
}

impl<'a> PumaInverse<'a> {
    /// The inverse kinematics of `model`, whose frame E is at the wrist centre.
    pub(crate) fn new(model: &'a Model<6>, lengths: PumaLengths) -> Self {
        let terms = model.evaluate(&Joints::zeros(), &Joints::zeros());
        let (z1, z2) = (terms.z[0], terms.z[1]);
        let x = z2.cross(&z1);
        // The point at which the waist axis meets the shoulder axis.
        let S = terms.p[0] + z1 * (terms.p[1] - terms.p[0]).dot(&z1);
        Self {
            model,
            lengths,
            axes: Matrix3::from_rows(&[x.transpose(), z2.transpose(), z1.transpose()]),
            shoulder: S,
            offset: (terms.p[4] - S).dot(&z2),
        }
    }

    /// The first three joints, rad, that put the wrist centre at `p`, m, on these sides of shoulder and elbow, ±1; `None` beyond reach.
    fn forearm(&self, p: &Vector3, [shoulder, elbow]: [f64; 2]) -> Option<[f64; 3]> {
        let [a2, L3, d] = [self.lengths.a2, self.lengths.L3, self.offset];
        let p = self.axes * (p - self.shoulder);
        let r2 = p.x * p.x + p.y * p.y;
        let R = shoulder * (r2 - d * d).max(0.0).sqrt();
        let q1 = wrap_angle(libm::atan2(p.y, p.x) - libm::atan2(d, R));
        let needed = (R * R + p.z * p.z - a2 * a2 - L3 * L3) / (2.0 * a2 * L3);
        let cos = needed.clamp(-1.0, 1.0);
        let (K, M) = (a2 + L3 * cos, -L3 * elbow * (1.0 - cos * cos).sqrt());
        let q2 = libm::atan2(R * M - p.z * K, R * K + p.z * M);
        let q3 = self.lengths.q3_stretched + elbow * libm::acos(cos);
        // A place exactly on the boundary is within reach: rounding is not a distance.
        let is_within = r2 >= d * d - 1e-12 && needed.abs() <= 1.0 + 1e-12;
        is_within.then_some([q1, q2, q3])
    }

    /// q2 that puts the wrist centre at in-plane radius `R`, from the elbow's angle, on the side where `q2` is; `None` beyond reach.
    pub(crate) fn shoulder_for(&self, q2: f64, q3: f64, R: f64) -> Option<f64> {
        let (sin, cos) = libm::sincos(self.lengths.theta(q3));
        let (K, M) = (
            self.lengths.a2 + self.lengths.L3 * cos,
            -self.lengths.L3 * sin,
        );
        // R = c2·K + s2·M.
        let (size, phase) = ((K * K + M * M).sqrt(), libm::atan2(M, K));
        let angle = (R.abs() < size).then(|| libm::acos(R / size))?;
        let candidates = [wrap_angle(phase + angle), wrap_angle(phase - angle)];
        let within = |x: f64| {
            [x, x - std::f64::consts::TAU]
                .into_iter()
                .find(|x| *x > self.model.lower()[1] && *x < self.model.upper()[1])
        };
        candidates
            .into_iter()
            .filter_map(within)
            .min_by(|a, b| (a - q2).abs().total_cmp(&(b - q2).abs()))
    }

    /// All postures of a pose within the joint limits.
    pub(crate) fn all(&self, X: &Pose, near: &Joints<6>) -> impl Iterator<Item = Joints<6>> {
        let (near, X, inverse) = (*near, *X, *self);
        [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]
            .into_iter()
            .filter_map(move |sides| inverse.forearm(&X.p, sides))
            .flat_map(move |[q1, q2, q3]| {
                let q = Joints::from([q1, q2, q3, 0.0, 0.0, 0.0]);
                [1.0, -1.0]
                    .into_iter()
                    .filter_map(move |flip| inverse.wrist(q, &X, flip, &near))
            })
    }

    /// The wrist's three angles, each brought within its limits near `near`.
    fn wrist(&self, mut q: Joints<6>, X: &Pose, flip: f64, near: &Joints<6>) -> Option<Joints<6>> {
        let terms = self.model.evaluate(&q, &Joints::zeros());
        let (z4, z5, z6) = (
            terms.z[3],
            terms.z[4],
            X.R * (terms.X_BE.R.transpose() * terms.z[5]),
        );
        let w = z4.cross(&z6);
        let axis = if w.norm() > 1e-9 {
            w.normalize() * flip
        } else {
            rotation_exp(&(z4 * near[3])) * z5
        };
        q[3] = libm::atan2(z4.dot(&z5.cross(&axis)), z5.dot(&axis));
        q[4] = libm::atan2(w.dot(&axis), z4.dot(&z6));
        let rest = self.model.evaluate(&q, &Joints::zeros());
        let roll = rotation_log(&(rest.X_BE.R.transpose() * X.R));
        q[5] = (rest.X_BE.R * roll).dot(&rest.z[5]);
        for i in 0..6 {
            q[i] = near[i] + wrap_angle(q[i] - near[i]);
            let turn = std::f64::consts::TAU;
            let fits =
                |x: f64| x > self.model.lower()[i] + 0.05 && x < self.model.upper()[i] - 0.05;
            q[i] = [q[i], q[i] - turn, q[i] + turn]
                .into_iter()
                .find(|x| fits(*x))?;
        }
        Some(q)
    }

    /// The posture nearest to `near`.
    pub(crate) fn nearest(&self, X: &Pose, near: &Joints<6>) -> Option<Joints<6>> {
        let distance = |q: &Joints<6>| (q - near).norm_squared();
        self.all(X, near)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::{Factors, Robot};
    use shared_types::random::Uniform;

    #[test]
    fn a_pumas_inverse_kinematics_undoes_forward_kinematics() {
        let robot = Robot::builtin("puma560").unwrap();
        let Factors::Puma { a2, a3, d4 } = robot.factors else {
            panic!("a PUMA has its factors")
        };
        let (model, mut random) = (Model::<6>::new(&robot, None).unwrap(), Uniform(9));
        let (lower, upper) = (model.lower(), model.upper());
        let inverse = PumaInverse::new(&model, PumaLengths::new(a2, a3, d4));
        for _ in 0..100 {
            let q =
                Joints::<6>::from_fn(|i, _| random.within(lower[i].max(-3.1), upper[i].min(3.1)));
            let X = model.forward_kinematics(&q);
            for found in inverse.all(&X, &q) {
                let Y = model.forward_kinematics(&found);
                assert!((Y.p - X.p).norm() < 1e-9);
                assert!(rotation_log(&(Y.R * X.R.transpose())).norm() < 1e-6);
            }
            // Joints 4 to 6 keep 0.05 rad from their limits, which a random posture does not.
            let inner = (0..6).all(|i| q[i] > lower[i] + 0.05 && q[i] < upper[i] - 0.05);
            if inner && libm::sin(q[4]).abs() > 1e-3 {
                let nearest = inverse.nearest(&X, &q).unwrap();
                assert!((nearest - q).amax() < 1e-5, "q itself is among them");
            }
        }
    }
}
