//! The arm's own motion over a short time, where nothing but its joint torques acts on it.

use crate::arm::Model;
use crate::lanes::{Row, widest};
use nalgebra::SVector;

/// Postures of a step, each with so many velocities.
const POSTURES: usize = 3;
const VELOCITIES: usize = 2;
/// Accelerations of a step, the first of which is known.
const STAGES: usize = 1 + POSTURES * VELOCITIES;

/// When each posture is taken, over h.
const TIME: [f64; POSTURES] = [0.1532833606974714, 0.6442099810974817, 1.0];
/// Weights of the accelerations so far in each posture and in the last row in the result, over h².
const POSITION: [&[f64]; POSTURES + 1] = [
    &[0.011747894333355558],
    &[
        -0.09003605075680987,
        -0.10750807959905966,
        0.4050473802286784,
    ],
    &[
        0.3659804902237086,
        0.08144203738071257,
        -0.2393555338094394,
        -0.1642352953803759,
        0.456168301585395,
    ],
    &[
        -0.002115394694883465,
        0.055276783399148786,
        0.2641214234667087,
        0.09456970763438208,
        0.08814748019464388,
        0.0,
        0.0,
    ],
];
/// Their weights in the velocity of each stage, and in the last row in the result, over h.
const VELOCITY: [&[f64]; STAGES] = [
    &[0.1532833606974714],
    &[0.060601688180066476, 0.09268167251740492],
    &[-0.7980783331115917, 0.5184220889357056, 0.9238662252733677],
    &[
        0.5665178618766498,
        -0.2160427010616005,
        -0.07501622948072538,
        0.36875104976315787,
    ],
    &[
        1.0723430360790442,
        -0.18064337213464343,
        0.9143726833980058,
        -0.13309561379327178,
        -0.6729767335491338,
    ],
    &[
        0.3668479369940846,
        -0.519661826476447,
        0.3342909171746247,
        0.028641166032066432,
        0.7898818062756721,
        0.0,
    ],
    &[
        -0.0021153946948832755,
        0.06528368622197238,
        0.31193602582828006,
        0.26580202538029335,
        0.24775141378767906,
        -0.00013690168739019396,
        0.11147914516404867,
    ],
];

/// Position and velocity; rad, rad/s.
type Motion<const N: usize> = [SVector<f64, N>; 2];

/// Σ wᵢ·aᵢ over the accelerations that have weights.
#[inline(always)]
fn weighted<R: Row<N>, const N: usize>(weights: &[f64], accelerations: &[R; STAGES]) -> R {
    let mut sum = accelerations[0] * R::splat(weights[0]);
    for k in 1..weights.len() {
        sum = sum + accelerations[k] * R::splat(weights[k]);
    }
    sum
}

impl<const N: usize> Model<N> {
    widest! {
        /// The state `h` s after `[q, q̇]`, whose acceleration is `qddot`, under the joint torques `tau` − `viscous`∘q̇, `tau` constant: one step of order 5.
        ///
        /// q̈ = A(q)⁻¹(τ − C(q, q̇)·q̇ − g(q)), of which most work depends on q alone. So the step is one of Nyström's methods for y″ = f(y, y′) whose six
        /// stages share three postures [Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, §II.14]. Its weights solve the equations of
        /// order of the special trees there up to order 5, of velocity and position, within 1e-16; they were found by Gauss–Newton iteration from random
        /// ones.
        ///
        /// Local error O(h⁶). Cost that of about four forward dynamics, no allocation.
        pub fn advance(
            &self,
            state: &Motion<N>,
            qddot: &SVector<f64, N>,
            tau: &SVector<f64, N>,
            viscous: &SVector<f64, N>,
            h: f64
        ) -> Motion<N> {
            advance_anywhere
        }
    }

    #[inline(always)]
    pub(crate) fn advance_anywhere<R: Row<N>>(
        &self,
        [q, qdot]: &Motion<N>,
        qddot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
        viscous: &SVector<f64, N>,
        h: f64,
    ) -> Motion<N> {
        let (q, qdot, tau, viscous) = (R::of(q), R::of(qdot), R::of(tau), R::of(viscous));
        let (h1, h2) = (R::splat(h), R::splat(h * h));
        let mut accelerations = [R::splat(0.0); STAGES];
        accelerations[0] = R::of(qddot);
        let mut known = 1;
        for (time, weights) in TIME.iter().zip(POSITION) {
            let posed =
                self.posed(q + qdot * R::splat(time * h) + weighted(weights, &accelerations) * h2);
            let A = self.factored(&posed);
            for _ in 0..VELOCITIES {
                let qdot = qdot + weighted(VELOCITY[known - 1], &accelerations) * h1;
                let tau = tau - viscous * qdot;
                accelerations[known] = R::of(&self.qddot_in(&posed, &A, qdot, tau));
                known += 1;
            }
        }
        let next = q + qdot * h1 + weighted(POSITION[POSTURES], &accelerations) * h2;
        let qdot = qdot + weighted(VELOCITY[STAGES - 1], &accelerations) * h1;
        [next.store().first(), qdot.store().first()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Robot;

    /// Halving the step makes the error of a fixed time 2⁵ times as small, for arms of other shapes and under friction too.
    #[test]
    fn a_step_is_of_order_five() {
        for name in ["puma560", "ur5"] {
            let arm = Model::<6>::new(&Robot::builtin(name).unwrap(), None).unwrap();
            let start: Motion<6> = [
                SVector::from_fn(|i, _| 0.4 + 0.5 * i as f64),
                SVector::from_fn(|i, _| 2.0 - 0.7 * i as f64),
            ];
            let viscous = SVector::<f64, 6>::from_fn(|i, _| 0.5 / (1.0 + i as f64));
            let tau = arm.gravity(&start[0]) * 0.5;
            let after = |steps: u32| {
                let h = 0.2 / f64::from(steps);
                (0..steps).fold(start, |x, _| {
                    let qddot =
                        arm.forward_dynamics(&x[0], &x[1], &(tau - viscous.component_mul(&x[1])));
                    arm.advance(&x, &qddot, &tau, &viscous, h)
                })
            };
            let exact = after(256);
            let error = |steps: u32| {
                let [q, qdot] = after(steps);
                [(q - exact[0]).amax(), (qdot - exact[1]).amax()]
            };
            let (coarse, fine) = (error(8), error(16));
            for (coarse, fine) in coarse.into_iter().zip(fine) {
                assert!(
                    fine > 1e-13 && (20.0..50.0).contains(&(coarse / fine)),
                    "{name}: {coarse:e} and {fine:e}"
                );
            }
        }
    }
}
