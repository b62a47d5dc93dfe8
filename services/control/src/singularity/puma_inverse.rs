//! A PUMA's lengths, and its closed-form inverse kinematics along the path: where the first three joints and the wrist will have to be.

use super::axes::shoulder;
use crate::linear::{rotation_exp, rotation_log, sign, wrap_angle};
use model::{Model, Pose, Terms};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

/// The lengths that the factors need, modified DH with Craig's zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PumaLengths {
    /// Upper arm, m.
    pub a2: f64,
    /// Forearm from elbow axis to wrist centre, √(a3² + d4²), m.
    pub L3: f64,
    /// q3 at full stretch, atan2(d4, a3), rad.
    pub q3_stretched: f64,
}

impl PumaLengths {
    /// From the DH lengths, m.
    #[must_use]
    pub fn new(a2: f64, a3: f64, d4: f64) -> Self {
        Self {
            a2,
            L3: (a3 * a3 + d4 * d4).sqrt(),
            q3_stretched: libm::atan2(d4, a3),
        }
    }

    /// Elbow angle from full stretch, (−π, π].
    #[must_use]
    pub fn theta(&self, q3: f64) -> f64 {
        wrap_angle(q3 - self.q3_stretched)
    }
}

/// The first three joints' inverse kinematics, on the sides of shoulder and elbow where the arm is. Frame base axes; m, rad.
#[derive(Clone, Copy, Debug)]
pub struct Forearm {
    puma: PumaLengths,
    /// Base axes with the arm's plane as x, z2 as y and the waist axis as z: rows.
    axes: Matrix3<f64>,
    shoulder: Vector3<f64>,
    /// Distance of the arm's plane from the waist axis, m.
    offset: f64,
    /// Sides of shoulder and elbow, ±1.
    sides: [f64; 2],
}

/// The forearm at one place of the wrist centre.
#[derive(Clone, Copy, Debug)]
pub struct PlacedForearm {
    /// Turn of the waist from where it is now, q2 and θ, rad.
    pub angles: [f64; 3],
    /// In-plane radius, m.
    pub R: f64,
    /// Whether the place is within reach.
    pub within_reach: bool,
    /// z4 and z2, base axes.
    axes: [Vector3<f64>; 2],
}

impl Forearm {
    /// The forearm of the posture in `terms`, wrist centre at `p_C`, base axes, m.
    #[must_use]
    pub fn new<const N: usize>(
        puma: &PumaLengths,
        q: &SVector<f64, N>,
        terms: &Terms<N>,
        p_C: &Vector3<f64>,
    ) -> Self {
        let (z1, z2) = (terms.z[0], terms.z[1]);
        let x = z2.cross(&z1);
        let S = shoulder(terms);
        let p = p_C - S;
        let sides = [sign(p.dot(&x) >= 0.0), sign(puma.theta(q[2]) >= 0.0)];
        Self {
            puma: *puma,
            axes: Matrix3::from_rows(&[x.transpose(), z2.transpose(), z1.transpose()]),
            shoulder: S,
            offset: p.dot(&z2),
            sides,
        }
    }

    /// The forearm for a place of the wrist centre.
    ///
    /// Units m · Frame `p` in base axes, from the base's origin · Ensures finite angles: a place beyond reach is moved to the boundary, which
    /// `within_reach` of the result tells · Errors none · Cost O(1), no allocation
    #[must_use]
    pub fn at(&self, p: &Vector3<f64>) -> PlacedForearm {
        let [a2, L3, d] = [self.puma.a2, self.puma.L3, self.offset];
        let p = self.axes * (p - self.shoulder);
        let r2 = p.x * p.x + p.y * p.y;
        let R = self.sides[0] * (r2 - d * d).max(0.0).sqrt();
        let turn = wrap_angle(libm::atan2(p.y, p.x) - libm::atan2(d, R));
        let needed = (R * R + p.z * p.z - a2 * a2 - L3 * L3) / (2.0 * a2 * L3);
        let cos = needed.clamp(-1.0, 1.0);
        let theta = self.sides[1] * libm::acos(cos);
        let (K, M) = (
            a2 + L3 * cos,
            -L3 * self.sides[1] * (1.0 - cos * cos).sqrt(),
        );
        let q2 = libm::atan2(R * M - p.z * K, R * K + p.z * M);
        let (s23, c23) = libm::sincos(q2 + theta + self.puma.q3_stretched);
        let (s1, c1) = libm::sincos(turn);
        let to_base = self.axes.transpose();
        let axes = [
            to_base * Vector3::new(s23 * c1, s23 * s1, c23),
            to_base * Vector3::new(-s1, c1, 0.0),
        ];
        // A place exactly on the boundary is within reach: rounding is not a distance.
        let within_reach = r2 >= d * d - 1e-12 && needed.abs() <= 1.0 + 1e-12;
        PlacedForearm {
            angles: [turn, q2, theta],
            R,
            within_reach,
            axes,
        }
    }

    /// The same on chosen sides of shoulder and elbow, ±1.
    #[must_use]
    pub fn on(&self, sides: [f64; 2]) -> Self {
        Self { sides, ..*self }
    }
}

impl PlacedForearm {
    /// The wrist's bend w = z4×z6_d in the forearm's own axes z2 and z4×z2, |w| the sine of the wrist angle and its direction q4 but for a constant.
    ///
    /// Requires `z6_d`, the desired last axis, a unit vector in base axes.
    #[must_use]
    pub fn wrist_bend(&self, z6_d: &Vector3<f64>) -> Vector2<f64> {
        let [z4, z2] = self.axes;
        let w = z4.cross(z6_d);
        Vector2::new(w.dot(&z2), w.dot(&z4.cross(&z2)))
    }
}

/// Closed-form inverse kinematics of a PUMA at its wrist centre.
#[derive(Clone, Copy, Debug)]
pub struct PumaInverse<'a> {
    /// The arm.
    pub model: &'a Model<6>,
    /// Its lengths.
    pub lengths: PumaLengths,
    /// The first three joints, from the posture q = 0.
    forearm: Forearm,
}

impl<'a> PumaInverse<'a> {
    /// The inverse kinematics of `model`, whose frame E is at the wrist centre.
    #[must_use]
    pub fn new(model: &'a Model<6>, lengths: PumaLengths) -> Self {
        let zero = SVector::zeros();
        let terms = model.evaluate(&zero, &zero);
        Self {
            model,
            lengths,
            forearm: Forearm::new(&lengths, &zero, &terms, &terms.p[4]),
        }
    }

    /// q2 that puts the wrist centre at in-plane radius `R`, from the elbow's angle, on the side where `q2` is; `None` beyond reach.
    #[must_use]
    pub fn shoulder_for(&self, q2: f64, q3: f64, R: f64) -> Option<f64> {
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
    pub fn all(&self, X: &Pose, near: &SVector<f64, 6>) -> impl Iterator<Item = SVector<f64, 6>> {
        let (q_near, X, inverse) = (*near, *X, *self);
        [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]
            .into_iter()
            .flat_map(move |sides| {
                let placed = inverse.forearm.on(sides).at(&X.p);
                let mut q = SVector::<f64, 6>::zeros();
                (q[0], q[1], q[2]) = (
                    placed.angles[0],
                    placed.angles[1],
                    inverse.lengths.q3_stretched + placed.angles[2],
                );
                let flips = if placed.within_reach {
                    &[1.0, -1.0][..]
                } else {
                    &[]
                };
                flips
                    .iter()
                    .filter_map(move |flip| inverse.wrist(q, &X, *flip, &q_near))
            })
    }

    /// The wrist's three angles, each brought within its limits near `near`.
    fn wrist(
        &self,
        mut q: SVector<f64, 6>,
        X: &Pose,
        flip: f64,
        near: &SVector<f64, 6>,
    ) -> Option<SVector<f64, 6>> {
        let terms = self.model.evaluate(&q, &SVector::zeros());
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
        let rest = self.model.evaluate(&q, &SVector::zeros());
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
    #[must_use]
    pub fn nearest(&self, X: &Pose, near: &SVector<f64, 6>) -> Option<SVector<f64, 6>> {
        let distance = |q: &SVector<f64, 6>| (q - near).norm_squared();
        self.all(X, near)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}
