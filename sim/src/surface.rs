//! Surfaces that the hand's point touches: springs with dampers and friction, a smooth function of the arm's state.

use crate::error::PlantError;
use model::Model;
use nalgebra::{SVector, Vector3};
use shared_types::scenario;

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

/// The surfaces around an arm.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surfaces(Vec<Surface>);

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
        Self(options.surface.iter().map(surface).collect())
    }

    /// Sum of the forces on the hand's point at `p` that moves with `v`, N, and the number of surfaces that it touches.
    pub(crate) fn force(&self, p: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, u32) {
        let touched = self.0.iter().filter(|one| one.depth(p).0 > 0.0);
        touched.fold((Vector3::zeros(), 0), |(force, count), one| {
            (force + one.force(p, v), count + 1)
        })
    }

    /// Refuses a start with the hand's point at `p` inside a surface.
    ///
    /// # Errors
    /// [`PlantError::StartInSurface`].
    pub(crate) fn check_start(&self, p: &Vector3<f64>) -> Result<(), PlantError> {
        let depths = self.0.iter().map(|one| one.depth(p).0).enumerate();
        let deepest = depths.max_by(|a, b| a.1.total_cmp(&b.1));
        deepest
            .filter(|(_, depth)| *depth > TOUCHES)
            .map_or(Ok(()), |(surface, depth)| {
                Err(PlantError::StartInSurface {
                    surface,
                    depth_mm: depth * 1e3,
                })
            })
    }

    /// Whether the point may touch a surface before it has moved by `moves` m.
    pub(crate) fn are_near(&self, p: &Vector3<f64>, moves: f64) -> bool {
        self.0.iter().any(|one| one.depth(p).0 > -(NEAR + moves))
    }

    /// Torques of the joints under the force on the hand's point, JᵀF; N·m. `None`: there is no surface.
    pub(crate) fn torque<const N: usize>(
        &self,
        model: &Model<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> Option<SVector<f64, N>> {
        if self.0.is_empty() {
            return None;
        }
        let J = model.jacobian(q).fixed_rows::<3>(0).into_owned();
        let (force, _) = self.force(&model.forward_kinematics(q).p, &(J * qdot));
        Some(J.tr_mul(&force))
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
        let at = |z: f64, v: [f64; 3]| table.force(&Vector3::new(0.3, 0.2, z), &v.into());
        assert_eq!(at(0.11, [0.0; 3]), (Vector3::zeros(), 0));
        let (still, touched) = at(0.099, [0.0; 3]);
        assert!((still - Vector3::new(0.0, 0.0, 10.0)).norm() < 1e-9 && touched == 1);
        assert!((at(0.099, [0.0, 0.0, -0.1]).0.z - 15.0).abs() < 1e-9);
        assert_eq!(at(0.099, [0.0, 0.0, 1.0]).0, Vector3::zeros());
        let (sliding, _) = at(0.099, [0.2, 0.0, 0.0]);
        assert!((sliding - Vector3::new(-5.0, 0.0, 10.0)).norm() < 1e-9);
        assert!(
            table.are_near(&Vector3::new(0.0, 0.0, 0.1005), 0.0)
                && !table.are_near(&Vector3::new(0.0, 0.0, 0.2), 0.01)
        );
    }

    #[test]
    fn a_sphere_presses_outwards() {
        let ball =
            surfaces("[[plant.surface]]\npoint_m=[0,0,0]\nradius_m=0.2\nstiffness_n_m=1e4\n");
        let (force, _) = ball.force(&Vector3::new(0.0, 0.199, 0.0), &Vector3::zeros());
        assert!(
            (force - Vector3::new(0.0, 10.0, 0.0)).norm() < 1e-9,
            "{force}"
        );
    }
}
