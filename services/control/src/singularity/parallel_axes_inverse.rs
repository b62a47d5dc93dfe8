//! Where an arm of parallel axes will have to be: closed-form inverse kinematics of its waist, its wrist's middle axis and its elbow.

use super::axes::shoulder;
use super::family::Situation;
use super::wrist::MU;
use crate::linear::{angular, linear, rotation_exp, sign, wrap_angle};
use model::Terms;
use nalgebra::{Vector2, Vector3};

/// Step of the difference quotient for rates, s: rounding (1e-16/h) and curvature (h²) both far below encoder noise.
const STEP_S: f64 = 1e-5;

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
        let (x, S) = (n.cross(&z1), shoulder(terms));
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
            signs: [1, 2, 3].map(|i| sign(terms.z[i].dot(&n) >= 0.0)),
        }
    }

    /// Elbow angle from full stretch, (−π, π].
    #[must_use]
    pub fn theta(&self) -> f64 {
        libm::atan2(self.upper.perp(&self.lower), self.upper.dot(&self.lower))
    }
}

/// A quarter turn, counter-clockwise.
pub fn quarter(v: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// Turned by `angle`, counter-clockwise.
pub fn turned(v: &Vector2<f64>, angle: f64) -> Vector2<f64> {
    let (sin, cos) = libm::sincos(angle);
    v * cos + quarter(v) * sin
}

/// The arm as it stands, from which its inverse kinematics goes on: on the sides of waist, elbow and wrist where it is.
#[derive(Clone, Copy, Debug)]
pub struct PlanarArm {
    pub(super) plane: Plane,
    /// Side of the waist axis, ±1.
    side: f64,
}

/// The arm's plane at one place of C.
#[derive(Clone, Copy, Debug)]
pub struct PlacedPlane {
    /// C in the plane, m.
    pub(super) C: Vector2<f64>,
    z1: Vector3<f64>,
    x: Vector3<f64>,
}

impl PlacedPlane {
    /// The wrist's bend w = n×z6_d in the arm's plane, |w| the sine of the wrist angle and its direction φ but for a constant.
    ///
    /// Requires `z6_d`, the desired last axis, a unit vector in base axes.
    pub fn wrist_bend(&self, z6_d: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(-z6_d.dot(&self.x), z6_d.dot(&self.z1))
    }
}

impl PlanarArm {
    /// The arm in the posture of `terms`, C at `p_BC`.
    #[must_use]
    pub fn new<const N: usize>(terms: &Terms<N>, p_BC: &Vector3<f64>) -> Self {
        let plane = Plane::new(terms, p_BC);
        Self {
            plane,
            side: sign(plane.C.y >= 0.0),
        }
    }

    /// The plane for a place of C: d from the waist axis.
    ///
    /// Units m · Frame `p` in base axes, from the base's origin · Ensures finite numbers: a place nearer to the waist axis than d is moved to the
    /// boundary · Errors none · Cost O(1), no allocation
    pub fn at(&self, p: &Vector3<f64>) -> PlacedPlane {
        let Plane { n, z1, x, S, d, .. } = self.plane;
        let p = p - S;
        let (along, across) = (p.dot(&x), p.dot(&n));
        let R = self.side * (along * along + across * across - d * d).max(0.0).sqrt();
        let turn = wrap_angle(libm::atan2(across, along) - libm::atan2(d, R));
        let (sin, cos) = libm::sincos(turn);
        PlacedPlane {
            C: Vector2::new(p.dot(&z1), R),
            z1,
            x: x * cos + n * sin,
        }
    }

    /// Where axis 4 has to be for C there and axis 5 along `z5`, m.
    fn axis_4(&self, C: &Vector2<f64>, z5: &Vector2<f64>) -> Vector2<f64> {
        C - z5 * self.plane.hand.x - quarter(z5) * self.plane.hand.y
    }

    /// Axis 5 for this w, nearest to `z5`; near the singularity, where w is short, as it is.
    fn axis_5(w: &Vector2<f64>, z5: &Vector2<f64>) -> Vector2<f64> {
        let size = w.norm_squared();
        let line = w * (sign(w.dot(z5) >= 0.0) / size.sqrt().max(1e-12));
        let towards = line * size + z5 * (MU * MU);
        towards / towards.norm().max(1e-12)
    }

    /// cos θ that puts axis 4 there.
    fn cosine(&self, axis_4: &Vector2<f64>) -> f64 {
        let (L2, L3) = (self.plane.upper.norm(), self.plane.lower.norm());
        (axis_4.norm_squared() - L2 * L2 - L3 * L3) / (2.0 * L2 * L3)
    }

    /// cos θ for the desired pose, and its rate by a central difference along the desired motion, axis 5 turning as it does.
    pub fn elbow_cosine<const N: usize>(&self, at: &Situation<'_, N>) -> [f64; 2] {
        let z6_E = at.terms.X_BE.R.transpose() * at.terms.z[N - 1];
        let turning = at.terms.z[1].dot(&(at.terms.omega[3] - at.terms.omega[0]));
        let cosine = |t: f64| {
            let placed = self.at(&(at.desired.p + linear(&at.desired.V) * t));
            let w = placed
                .wrist_bend(&(rotation_exp(&(angular(&at.desired.V) * t)) * (at.desired.R * z6_E)));
            let now = turned(&self.plane.z5, turning * t);
            self.cosine(&self.axis_4(&placed.C, &Self::axis_5(&w, &now)))
        };
        [
            cosine(0.0),
            (cosine(STEP_S) - cosine(-STEP_S)) / (2.0 * STEP_S),
        ]
    }
}
