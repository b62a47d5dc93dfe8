//! The scene at a tick, and the trail of null-space motion. PURE.

use glam::{Affine3, Mat3, Quat, Vec3};
use nalgebra::{Matrix3, Vector3};
use shared_types::MAX_DOF;
use shared_types::codes::{
    KIND_ELBOW, KIND_OVERHEAD, KIND_SHOULDER, KIND_WRIST, MODE_TRACK, TYPE_1,
};
use shared_types::messages::SingularityState;

use crate::body::{Body, Ring};
use crate::manipulability::Jacobian;
use crate::pose::{rotation, vec3};
use crate::run::Tick;
use crate::signals::halves;

/// A singularity's mark: the singular frame S at C with x along ζ, and how large it is drawn.
#[derive(Clone, Copy)]
pub(crate) struct Mark {
    pub(crate) is_inside: bool,
    /// Inside its neighbourhood, or |s| below twice η_out: faint, to be felt coming.
    pub(crate) is_seen: bool,
    pub(crate) is_angular: bool,
    pub(crate) X_BS: Affine3,
    /// How large it is drawn: 1 where the arm is singular.
    pub(crate) size: f32,
    /// The size at which the arm enters the neighbourhood.
    pub(crate) edge: f32,
}

impl Mark {
    /// The mark of a singularity whose centre C is at `p_BC`.
    pub(crate) fn new(one: &SingularityState, p_BC: [f64; 3]) -> Self {
        let is_angular = one.angular == 1;
        let [linear, angular] = halves(&one.zeta_B);
        let zeta = if is_angular { angular } else { linear };
        let zeta = vec3(&zeta.into()).normalize_or(Vec3::X);
        let R = one.R_BS.map(|x| x as f32);
        // x exactly along ζ; y as the report has it.
        let y = Vec3::from_slice(&R[3..6])
            .reject_from_normalized(zeta)
            .try_normalize()
            .unwrap_or_else(|| zeta.any_orthonormal_vector());
        let (s, near) = (one.s.abs(), 2.0 * one.eta_out);
        let is_inside = one.inside == 1;
        let size = |s: f64| 0.25 + 0.75 * ((near - s) / near.max(1e-9)).clamp(0.0, 1.0) as f32;
        Self {
            is_inside,
            is_seen: is_inside || s < near,
            is_angular,
            X_BS: Affine3 {
                matrix3: Mat3::from_cols(zeta, y, zeta.cross(y)),
                translation: vec3(&p_BC.into()),
            },
            size: size(s),
            edge: size(one.eta_in),
        }
    }

    /// ζ, base axes.
    pub(crate) fn zeta(&self) -> Vec3 {
        self.X_BS.matrix3.x_axis
    }
}

/// A dashed line: every other piece of `dashes`, which begin with `phase` 0 or 1.
pub(crate) fn dashed(from: Vec3, to: Vec3, dashes: usize, phase: usize) -> Vec<Vec<Vec3>> {
    let at = |k: usize| from.lerp(to, k as f32 / dashes as f32);
    let all = (phase..dashes).step_by(2);
    all.map(|k| vec![at(k), at(k + 1)]).collect()
}

/// Lines on a link: the link, their ends in its frame, and whether they are the second of two axes that become one.
type Reason = (usize, Vec<Vec<Vec3>>, bool);

/// Lines that show why the arm is singular.
pub(crate) fn reasons(kind: u32, body: &Body, dependent: &[usize]) -> Vec<Reason> {
    let n = body.joints.len();
    let half = 0.2 * body.reach;
    let axis = |(k, link): (usize, &usize)| {
        let axis = body.rings.get(*link)?.as_ref()?.axis;
        let dashes = dashed(-half * axis, half * axis, 21, k % 2);
        Some((*link, dashes, k % 2 == 1))
    };
    let axes = |links: &[usize]| links.iter().enumerate().filter_map(axis).collect();
    match kind {
        KIND_WRIST if n >= 6 => axes(&[n - 3, n - 1]),
        KIND_SHOULDER if n >= 3 => axes(&[0, 2]),
        KIND_OVERHEAD => {
            let ring = body.rings.first().and_then(Option::as_ref);
            let axis = body.reach * ring.map_or(Vec3::Z, |ring| ring.axis);
            vec![(0, dashed(-0.3 * axis, 1.15 * axis, 31, 0), false)]
        }
        KIND_ELBOW => bones(body).unwrap_or_default(),
        _ => axes(dependent),
    }
}

/// Upper arm and forearm; the first goes on dashed beyond its end: whether the second lies on it is seen.
fn bones(body: &Body) -> Option<Vec<Reason>> {
    let origin = |joint: usize| body.joints.get(joint).map(|X_PJ| X_PJ.translation);
    // The parent's origin, in the link's frame, where it lies on the joint's axis.
    let back = |joint: usize| {
        let X_PJ = body.joints.get(joint)?;
        Some(X_PJ.matrix3.transpose() * -X_PJ.translation)
    };
    let (upper, [shoulder, elbow], fore, [from, wrist]) = match body.joints.len() {
        7 => (2, [back(2)?, origin(3)?], 4, [back(4)?, origin(5)?]),
        n => {
            let upper = usize::from(n >= 6);
            let wrist = origin(upper + 2).or(body.tip)?;
            let upper_arm = [Vec3::ZERO, origin(upper + 1)?];
            (upper, upper_arm, upper + 1, [Vec3::ZERO, wrist])
        }
    };
    let mut strips = vec![vec![shoulder, elbow]];
    strips.extend(dashed(elbow, elbow + (elbow - shoulder), 14, 1));
    let forearm = vec![vec![from, wrist]];
    Some(vec![(upper, strips, false), (fore, forearm, false)])
}

/// The joints whose motions together do not move the hand: those with a share in the null vector of J, of which `columns` are the joints'.
pub(crate) fn dependent_joints(J: &Jacobian, columns: usize, length_m: f64) -> Vec<usize> {
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
#[derive(Default)]
pub(crate) struct NullMotion {
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
    /// Takes a tick in; `length_m` makes metres and radians comparable.
    ///
    /// Motion counts as null-space motion where |V_E|, with lengths over L, is below a twentieth of |q̇|, and where the null space is what
    /// tracks the path along a Type 1 singularity's ζ.
    pub(crate) fn update(&mut self, row: &Tick, length_m: f64) {
        let Some(state) = row.plant_state else { return };
        let norm = |values: [f64; MAX_DOF]| values.iter().map(|x| x * x).sum::<f64>().sqrt();
        let speed = norm(state.qdot);
        let [v, w] = halves(&state.V_BE).map(|half| Vector3::from(half).norm_squared());
        let hand_speed = (v / (length_m * length_m) + w).sqrt();
        let (p, R) = (
            Vector3::from(state.p_BE),
            Matrix3::from_column_slice(&state.R_BE),
        );
        if let Some((p_0, R_0, _)) = self.start {
            let turned = model::rotation_log(&(R * R_0.transpose())).norm();
            if (p - p_0).norm() / length_m + turned > 0.15 {
                *self = Self::default();
                return;
            }
        }
        let tracks = row.control_state.is_some_and(|command| {
            let of = |(one, mode): (&SingularityState, &u32)| {
                one.inside == 1 && one.class == TYPE_1 && *mode == MODE_TRACK
            };
            row.singularities().iter().zip(&command.mode).any(of)
        });
        if speed < 0.03 || (hand_speed > 0.05 * speed && !tracks) {
            return;
        }
        let (_, _, q_0) = self.start.get_or_insert((p, R, state.q));
        let since = |q: &[f64; MAX_DOF]| std::array::from_fn(|i| state.q[i] - q[i]);
        self.turned = since(q_0);
        let is_far = |last| norm(since(last)) > GHOST_STEP;
        if self.postures.last().is_none_or(is_far) {
            if self.postures.len() == GHOSTS {
                self.postures.remove(0);
            }
            self.postures.push(state.q);
        }
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
    most(turned)
        .map(one)
        .collect::<Vec<_>>()
        .join(", ")
        .replace('-', "−")
}

/// How far a joint has turned, as an arc with a barbed end about its axis, on the upper side of the link; `X_BL` is its link now, `angle` in rad.
pub(crate) fn turning(ring: &Ring, X_BL: &Affine3, angle: f32) -> Vec<Vec3> {
    let angle = angle.clamp(-6.0, 6.0);
    let turn = |angle: f32| Quat::from_axis_angle(ring.axis, angle);
    let out = ring.axis.any_orthonormal_vector();
    let is_below = (X_BL.matrix3 * (turn(-angle) * out)).z < 0.0;
    let out = if is_below { -out } else { out };
    let point =
        |angle: f32, radius: f32| X_BL.transform_point3(ring.centre + turn(angle) * out * radius);
    let steps = (angle.abs() / 0.15).ceil().max(1.0);
    let barb = 0.3f32.min(0.6 * angle.abs()).copysign(angle);
    let (tip, r) = (point(0.0, ring.radius), ring.radius);
    (0..=steps as usize)
        .map(|k| point(-angle * (1.0 - k as f32 / steps), r))
        .chain([point(-barb, 0.84 * r), tip, point(-barb, 1.16 * r)])
        .collect()
}

/// A ghost link is drawn only where it does not lie in the real one: further than this, m or rad.
pub(crate) fn differs(a: &Affine3, b: &Affine3) -> bool {
    a.translation.distance(b.translation) > 0.01 || rotation(a).angle_between(rotation(b)) > 0.1
}
