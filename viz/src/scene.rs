//! The scene at a tick, and the trail of null-space motion. PURE.

use glam::{Mat3, Quat, Vec3};
use nalgebra::{Matrix3, Vector3, Vector6};
use shared_types::MAX_DOF;
use shared_types::codes::{
    KIND_ELBOW, KIND_OVERHEAD, KIND_SHOULDER, KIND_WRIST, MODE_TRACK, TYPE_1,
};
use shared_types::messages::SingularityState;

use crate::body::{Body, Ring};
use crate::pose::{Placement, vec3};
use crate::signals::TickRow;

/// How clearly a singularity is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Presence {
    /// Far: not at all.
    #[default]
    Hidden,
    /// |s| below twice η_out: faint, to be felt coming.
    Near,
    /// Inside its neighbourhood.
    Inside,
}

/// How a singularity's mark looks: it is drawn again when this changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Look {
    pub(crate) presence: Presence,
    pub(crate) angular: bool,
}

/// A singularity's mark: the singular frame S at C with x along ζ, and how large it is drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    pub(crate) look: Look,
    pub(crate) X_BS: Placement,
    /// How large it is drawn: 1 where the arm is singular.
    pub(crate) size: f32,
    /// The size at which the arm enters the neighbourhood.
    pub(crate) edge: f32,
}

impl Mark {
    /// The mark of a singularity whose centre C is at `p_BC`.
    pub(crate) fn new(one: &SingularityState, p_BC: [f64; 3]) -> Self {
        let zeta = if one.angular == 1 {
            &one.zeta_B[3..]
        } else {
            &one.zeta_B[..3]
        };
        let zeta = Vec3::new(zeta[0] as f32, zeta[1] as f32, zeta[2] as f32).normalize_or(Vec3::X);
        let R = one.R_BS.map(|x| x as f32);
        // x exactly along ζ; y as the report has it.
        let y = Vec3::from_slice(&R[3..6])
            .reject_from_normalized(zeta)
            .try_normalize()
            .unwrap_or_else(|| zeta.any_orthonormal_vector());
        let (s, near) = (one.s.abs(), 2.0 * one.eta_out);
        let presence = match one.inside {
            1 => Presence::Inside,
            _ if s < near => Presence::Near,
            _ => Presence::Hidden,
        };
        let size = |s: f64| 0.25 + 0.75 * ((near - s) / near.max(1e-9)).clamp(0.0, 1.0) as f32;
        Self {
            look: Look {
                presence,
                angular: one.angular == 1,
            },
            X_BS: Placement {
                R: Mat3::from_cols(zeta, y, zeta.cross(y)),
                p: vec3(&Vector3::from(p_BC)),
            },
            size: size(s),
            edge: size(one.eta_in),
        }
    }

    pub(crate) fn is_inside(&self) -> bool {
        self.look.presence == Presence::Inside
    }

    /// ζ, base axes.
    pub(crate) fn zeta(&self) -> Vec3 {
        self.X_BS.R.x_axis
    }
}

/// A dashed line: every other piece of `dashes`, which begin with `phase` 0 or 1.
pub(crate) fn dashed(from: Vec3, to: Vec3, dashes: usize, phase: usize) -> Vec<[Vec3; 2]> {
    let at = |k: usize| from.lerp(to, k as f32 / dashes.max(1) as f32);
    (phase..dashes)
        .step_by(2)
        .map(|k| [at(k), at(k + 1)])
        .collect()
}

/// Lines on a link: the link, their ends in its frame, and whether they are the second of two axes that become one.
type Reason = (usize, Vec<[Vec3; 2]>, bool);

/// Lines that show why the arm is singular.
pub(crate) fn reasons(kind: u32, body: &Body, dependent: &[usize]) -> Vec<Reason> {
    let n = body.links;
    let half = 0.2 * body.reach;
    let axis = |(phase, link): (usize, usize)| {
        let axis = body.rings.get(link).copied().flatten()?.axis;
        let dashes = dashed(-half * axis, half * axis, 21, phase);
        Some((link, dashes, phase == 1))
    };
    let axes = |links: &[usize]| -> Vec<Reason> {
        let links = links.iter().enumerate();
        links.filter_map(|(k, link)| axis((k % 2, *link))).collect()
    };
    match kind {
        KIND_WRIST if n >= 6 => axes(&[n - 3, n - 1]),
        KIND_SHOULDER if n >= 3 => axes(&[0, 2]),
        KIND_OVERHEAD => {
            let ring = body.rings.first().copied().flatten();
            let axis = body.reach * ring.map_or(Vec3::Z, |ring| ring.axis);
            vec![(0, dashed(-0.3 * axis, 1.15 * axis, 31, 0), false)]
        }
        KIND_ELBOW => bones(body).unwrap_or_default(),
        _ => axes(dependent),
    }
}

/// Upper arm and forearm; the first goes on dashed beyond its end: whether the second lies on it is seen.
fn bones(body: &Body) -> Option<Vec<Reason>> {
    let origin = |joint: usize| body.joints.get(joint).map(|X_PJ| X_PJ.p);
    // The parent's origin, in the link's frame, where it lies on the joint's axis.
    let back = |joint: usize| {
        let X_PJ = body.joints.get(joint)?;
        Some(X_PJ.R.transpose() * -X_PJ.p)
    };
    let (upper, [shoulder, elbow], fore, [from, wrist]) = match body.links {
        7 => (2, [back(2)?, origin(3)?], 4, [back(4)?, origin(5)?]),
        n => {
            let upper = usize::from(n >= 6);
            let wrist = origin(upper + 2).or(body.tip)?;
            let upper_arm = [Vec3::ZERO, origin(upper + 1)?];
            (upper, upper_arm, upper + 1, [Vec3::ZERO, wrist])
        }
    };
    let mut strips = vec![[shoulder, elbow]];
    strips.extend(dashed(elbow, elbow + (elbow - shoulder), 14, 1));
    let forearm = vec![[from, wrist]];
    Some(vec![(upper, strips, false), (fore, forearm, false)])
}

/// The joints whose motions together do not move the hand: those with a share in the null vector of J, of which `columns` are the joints'.
pub(crate) fn dependent_joints(
    J: &nalgebra::SMatrix<f64, 6, MAX_DOF>,
    columns: usize,
    length_m: f64,
) -> Vec<usize> {
    // Columns that are no joint's keep out of the way.
    let gram = nalgebra::SMatrix::<f64, MAX_DOF, MAX_DOF>::from_fn(|i, k| {
        let product =
            |rows: std::ops::Range<usize>| rows.map(|row| J[(row, i)] * J[(row, k)]).sum::<f64>();
        let absent = if i == k && i >= columns { 1e6 } else { 0.0 };
        product(0..3) / (length_m * length_m) + product(3..6) + absent
    });
    let eigen = nalgebra::SymmetricEigen::new(gram);
    let least = eigen.eigenvalues.imin();
    let vector = eigen.eigenvectors.column(least);
    let most = vector.amax();
    (0..columns)
        .filter(|joint| vector[*joint].abs() > 0.3 * most)
        .collect()
}

/// Follows null-space motion: joints that move while the hand stays, or while they take it along a direction it has lost.
#[derive(Clone, Debug)]
pub(crate) struct NullMotion {
    /// Makes metres and radians comparable; m.
    length_m: f64,
    /// Postures gone through, oldest first, at even steps.
    pub(crate) postures: Vec<[f64; MAX_DOF]>,
    /// Where it began: the hand's position and rotation in the base, and the joints.
    start: Option<(Vector3<f64>, Matrix3<f64>, [f64; MAX_DOF])>,
    /// How far the joints have moved since.
    pub(crate) turned: [f64; MAX_DOF],
}

/// Joint-space distance between two ghosts; rad.
const GHOST_STEP: f64 = 0.2;
/// Most ghosts at once.
const GHOSTS: usize = 8;
/// Joint motion that is worth drawing anew; rad.
const TURN_STEP: f64 = 0.06;

impl NullMotion {
    pub(crate) fn new(length_m: f64) -> Self {
        let still = [0.0; MAX_DOF];
        Self {
            length_m,
            postures: Vec::with_capacity(GHOSTS),
            start: None,
            turned: still,
        }
    }

    /// Takes a tick in; returns whether the postures changed.
    ///
    /// Motion counts as null-space motion where |V_E|, with lengths over L, is below a twentieth of |q̇|, and where the null space is what
    /// tracks the path along a Type 1 singularity's ζ.
    pub(crate) fn update(&mut self, row: &TickRow) -> bool {
        let Some(state) = row.plant_state else {
            return false;
        };
        let speed = state
            .qdot
            .iter()
            .map(|rate| rate * rate)
            .sum::<f64>()
            .sqrt();
        let V = Vector6::from(state.V_BE);
        let hand_speed = (V.fixed_rows::<3>(0).norm_squared() / (self.length_m * self.length_m)
            + V.fixed_rows::<3>(3).norm_squared())
        .sqrt();
        let (p, R) = (
            Vector3::from(state.p_BE),
            Matrix3::from_column_slice(&state.R_BE),
        );
        if let Some((p_0, R_0, _)) = self.start {
            let turned = model::rotation_log(&(R * R_0.transpose())).norm();
            if (p - p_0).norm() / self.length_m + turned > 0.15 {
                self.start = None;
                self.turned = [0.0; MAX_DOF];
                self.postures.clear();
                return true;
            }
        }
        let tracks = row.control_state.is_some_and(|command| {
            let of = |(one, mode): (&SingularityState, &u32)| {
                one.inside == 1 && one.class == TYPE_1 && *mode == MODE_TRACK
            };
            row.singularities().iter().zip(&command.mode).any(of)
        });
        if speed < 0.03 || (hand_speed > 0.05 * speed && !tracks) {
            return false;
        }
        let (_, _, q_0) = self.start.get_or_insert((p, R, state.q));
        self.turned = std::array::from_fn(|i| state.q[i] - q_0[i]);
        let far = |from: &[f64; MAX_DOF]| {
            from.iter()
                .zip(&state.q)
                .map(|(a, b)| (a - b) * (a - b))
                .sum::<f64>()
                .sqrt()
                > GHOST_STEP
        };
        if self.postures.last().is_none_or(far) {
            if self.postures.len() == GHOSTS {
                self.postures.remove(0);
            }
            self.postures.push(state.q);
            return true;
        }
        false
    }
}

/// The joints that move most in null-space motion, and how far; rad.
pub(crate) fn most(turned: &[f64; MAX_DOF]) -> impl Iterator<Item = (usize, f64)> {
    let most = turned
        .iter()
        .fold(0.0f64, |most, angle| most.max(angle.abs()));
    let all = turned.iter().copied().enumerate();
    all.filter(move |(_, angle)| angle.abs() > (0.5 * most).max(TURN_STEP))
}

/// The same in words.
pub(crate) fn turned_words(turned: &[f64; MAX_DOF]) -> String {
    let one = |(i, angle): (usize, f64)| format!("q{} {:+.0}°", i + 1, angle.to_degrees());
    let words = most(turned).map(one).collect::<Vec<_>>().join(", ");
    words.replace('-', "−")
}

/// How far a joint has turned, as an arc with a barbed end about its axis, on the upper side of the link; `X_BL` is its link now, `angle` in rad.
pub(crate) fn turning(ring: &Ring, X_BL: &Placement, angle: f32) -> Vec<Vec3> {
    let angle = angle.clamp(-6.0, 6.0);
    let turn = |angle: f32| Quat::from_axis_angle(ring.axis, angle);
    let out = ring.axis.any_orthonormal_vector();
    let is_below = (X_BL.R * (turn(-angle) * out)).z < 0.0;
    let out = if is_below { -out } else { out };
    let point = |angle: f32, radius: f32| X_BL.of(ring.centre + turn(angle) * out * radius);
    let steps = (angle.abs() / 0.15).ceil().max(1.0);
    let barb = 0.3f32.min(0.6 * angle.abs()).copysign(angle);
    let (tip, r) = (point(0.0, ring.radius), ring.radius);
    let arc = (0..=steps as usize).map(|k| point(-angle * (1.0 - k as f32 / steps), r));
    arc.chain([point(-barb, 0.84 * r), tip, point(-barb, 1.16 * r)])
        .collect()
}

/// A ghost link is drawn only where it does not lie in the real one: further than this, m or rad.
pub(crate) fn differs(a: &Placement, b: &Placement) -> bool {
    a.p.distance(b.p) > 0.01 || a.rotation().angle_between(b.rotation()) > 0.1
}
