//! Surfaces that the hand touches with a point, or with the rim of a flat face: springs with dampers and friction, a smooth function of the arm's state.

use crate::error::PlantError;
use model::{Model, Pose, stack};
use nalgebra::{SVector, Vector3, Vector6};
use shared_types::scenario;
use std::f64::consts::TAU;

/// Sliding speed at which friction has its full force; m/s. Below it friction is proportional to the speed, so that it is smooth.
const SLIDING: f64 = 5e-3;

/// Distance within which a tick is integrated in short steps; m.
const NEAR: f64 = 1e-3;

/// Depth up to which a hand that starts on a surface touches it; m.
const TOUCHES: f64 = 1e-5;

/// A surface.
#[derive(Clone, Copy, Debug)]
struct Surface {
    /// A point of the plane, or the sphere's centre; m.
    point: Vector3<f64>,
    /// Unit normal of the plane.
    normal: Vector3<f64>,
    /// The sphere's radius; m.
    radius: Option<f64>,
    stiffness: f64,
    damping: f64,
    friction: f64,
}

/// Points of a face's rim.
const RIM: u8 = 8;

/// The surfaces around an arm, and what touches them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surfaces {
    all: Vec<Surface>,
    /// The points of the hand that touch, in its axes, m: E alone, or the rim of a face, each of which then has its share of the stiffness.
    touching: Vec<Vector3<f64>>,
}

impl Surface {
    /// Depth of a point in the material, m, negative outside, and the unit normal there.
    fn depth(&self, p: &Vector3<f64>) -> (f64, Vector3<f64>) {
        let way = p - self.point;
        match self.radius {
            None => (-self.normal.dot(&way), self.normal),
            Some(radius) => {
                let distance = way.norm();
                let normal = if distance > 0.0 {
                    way / distance
                } else {
                    self.normal
                };
                (radius - distance, normal)
            }
        }
    }

    /// Force on a point at `p` that moves with `v`: kδ(1 + cδ̇) ≥ 0 along the normal, and friction μ times that against the sliding.
    fn force(&self, p: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let (depth, normal) = self.depth(p);
        if depth <= 0.0 {
            return Vector3::zeros();
        }
        let inwards = -normal.dot(v);
        let pressing = self.stiffness * depth * (1.0 + self.damping * inwards).max(0.0);
        let sliding = v + normal * inwards;
        let speed = sliding.norm().max(SLIDING);
        (normal - sliding * (self.friction / speed)) * pressing
    }
}

impl Surfaces {
    pub(crate) fn new(options: &scenario::Plant) -> Self {
        let surface = |one: &scenario::Surface| Surface {
            point: one.point_m.into(),
            normal: Vector3::from(one.normal).normalize(),
            radius: one.radius_m,
            stiffness: one.stiffness_n_m,
            damping: one.damping_s_m,
            friction: one.friction,
        };
        let radius = options.face_radius_m;
        let on_rim = |i: u8| {
            let (sin, cos) = libm::sincos(TAU * f64::from(i) / f64::from(RIM));
            Vector3::new(cos, sin, 0.0) * radius
        };
        let points = if radius > 0.0 { RIM } else { 1 };
        Self {
            all: options.surface.iter().map(surface).collect(),
            touching: (0..points).map(on_rim).collect(),
        }
    }

    /// The wrench on the hand in the pose `X`, which moves with the twist `V`, about E, base axes, N and N·m; and the number of surfaces that it touches.
    pub(crate) fn wrench(&self, X: &Pose, V: &Vector6<f64>) -> (Vector6<f64>, u32) {
        let share = 1.0 / self.touching.len() as f64;
        let (v, omega) = (V.fixed_rows::<3>(0), V.fixed_rows::<3>(3));
        self.all.iter().fold((Vector6::zeros(), 0), |sum, surface| {
            let (mut wrench, mut touches) = (sum.0, false);
            for lever in self.touching.iter().map(|point| X.R * point) {
                let p = X.p + lever;
                if surface.depth(&p).0 > 0.0 {
                    let force = surface.force(&p, &(v + omega.cross(&lever))) * share;
                    wrench += stack(&force, &lever.cross(&force));
                    touches = true;
                }
            }
            (wrench, sum.1 + u32::from(touches))
        })
    }

    /// The depth of each point of a hand in the pose `X` in each surface, by the surface's index; m.
    fn depths(&self, X: &Pose) -> impl Iterator<Item = (usize, f64)> {
        let points = self.touching.iter().map(|point| X.R * point + X.p);
        points.flat_map(|p| {
            let depth = move |one: &Surface| one.depth(&p).0;
            self.all.iter().map(depth).enumerate()
        })
    }

    /// Refuses a start with the hand, in the pose `X`, inside a surface.
    ///
    /// # Errors
    /// [`PlantError::StartInSurface`].
    pub(crate) fn check_start(&self, X: &Pose) -> Result<(), PlantError> {
        let deepest = self.depths(X).max_by(|a, b| a.1.total_cmp(&b.1));
        deepest
            .filter(|(_, depth)| *depth > TOUCHES)
            .map_or(Ok(()), |(surface, depth)| {
                Err(PlantError::StartInSurface {
                    surface,
                    depth_mm: depth * 1e3,
                })
            })
    }

    /// Whether a hand in the pose `X` may touch a surface within `t` s of moving with twice the twist `V`.
    pub(crate) fn are_near(&self, X: &Pose, V: &Vector6<f64>, t: f64) -> bool {
        let lever = self.touching.iter().map(Vector3::norm).fold(0.0, f64::max);
        let speed = V.fixed_rows::<3>(0).norm() + lever * V.fixed_rows::<3>(3).norm();
        (self.depths(X)).any(|(_, depth)| depth > -(NEAR + 2.0 * t * speed))
    }

    /// Torques of the joints under the wrench on the hand, JᵀF; N·m. `None`: there is no surface.
    pub(crate) fn torque<const N: usize>(
        &self,
        model: &Model<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> Option<SVector<f64, N>> {
        if self.all.is_empty() {
            return None;
        }
        let J = model.jacobian(q);
        let (wrench, _) = self.wrench(&model.forward_kinematics(q), &(J * qdot));
        Some(J.tr_mul(&wrench))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::scenario::Scenario;

    fn surfaces(text: &str) -> Surfaces {
        let head =
            "name=\"s\"\nrobot=\"puma560\"\nstart.posture=\"ready\"\nsegment=[{duration_s=1.0}]\n";
        let scenario = Scenario::parse("s.toml", &format!("{head}{text}"), &[]).unwrap();
        Surfaces::new(&scenario.plant)
    }

    #[test]
    fn a_plane_presses_back_damps_and_rubs_and_never_pulls() {
        let table = surfaces(
            "[[plant.surface]]\npoint_m=[0,0,0.1]\nnormal=[0,0,2]\nstiffness_n_m=1e4\ndamping_s_m=5\nfriction=0.5\n",
        );
        let pose = |z: f64| Pose {
            p: Vector3::new(0.3, 0.2, z),
            ..Pose::default()
        };
        let at = |z: f64, v: [f64; 3]| {
            let (wrench, touched) = table.wrench(&pose(z), &stack(&v.into(), &Vector3::zeros()));
            assert_eq!(wrench.fixed_rows::<3>(3).norm(), 0.0);
            (wrench.fixed_rows::<3>(0).into_owned(), touched)
        };
        assert_eq!(at(0.11, [0.0; 3]), (Vector3::zeros(), 0));
        let (still, touched) = at(0.099, [0.0; 3]);
        assert!((still - Vector3::new(0.0, 0.0, 10.0)).norm() < 1e-9 && touched == 1);
        assert!((at(0.099, [0.0, 0.0, -0.1]).0.z - 15.0).abs() < 1e-9);
        assert_eq!(at(0.099, [0.0, 0.0, 1.0]).0, Vector3::zeros());
        let (sliding, _) = at(0.099, [0.2, 0.0, 0.0]);
        assert!((sliding - Vector3::new(-5.0, 0.0, 10.0)).norm() < 1e-9);
        assert!(
            table.are_near(&pose(0.1005), &Vector6::zeros(), 1.0)
                && !table.are_near(&pose(0.2), &stack(&Vector3::z(), &Vector3::zeros()), 0.005)
        );
    }

    #[test]
    fn a_sphere_presses_outwards() {
        let ball =
            surfaces("[[plant.surface]]\npoint_m=[0,0,0]\nradius_m=0.2\nstiffness_n_m=1e4\n");
        let pose = Pose {
            p: Vector3::new(0.0, 0.199, 0.0),
            ..Pose::default()
        };
        let force = ball
            .wrench(&pose, &Vector6::zeros())
            .0
            .fixed_rows::<3>(0)
            .into_owned();
        assert!(
            (force - Vector3::new(0.0, 10.0, 0.0)).norm() < 1e-9,
            "{force}"
        );
    }

    /// A face of radius r that lies on a table turns against a spring of k·r²/2; tilted, it touches with one point of the rim.
    #[test]
    fn a_face_resists_a_turn_and_touches_with_its_rim() {
        let table = surfaces(
            "plant.face_radius_m=0.03\n[[plant.surface]]\npoint_m=[0,0,0]\nstiffness_n_m=2e4\n",
        );
        let at = |z: f64, turn: f64| {
            let pose = Pose {
                R: nalgebra::Rotation3::new(Vector3::y() * turn).into_inner(),
                p: Vector3::new(0.4, 0.0, z),
            };
            table.wrench(&pose, &Vector6::zeros()).0
        };
        let flat = at(-5e-4, 0.0);
        assert!((flat - stack(&(Vector3::z() * 10.0), &Vector3::zeros())).norm() < 1e-9);
        let turned = at(-5e-4, 1e-3);
        assert!(
            (turned[4] + 9e-3).abs() < 1e-5 && (turned[2] - 10.0).abs() < 1e-3,
            "{turned}"
        );
        let tilted = at(0.03 * 0.0871557 - 1e-4, 5.0_f64.to_radians());
        assert!((tilted[2] - 2e4 / 8.0 * 1e-4).abs() < 1e-3, "{tilted}");
        assert!(
            (tilted[4] + tilted[2] * 0.03 * 0.9962).abs() < 1e-3,
            "{tilted}"
        );
    }
}
