//! The singularities of any arm, by number: a singular value decomposition that is carried from tick to tick.
//!
//! # Blocks
//! Where the last three axes meet, J at that point is block triangular, and det J = det T·det W with T the wrist centre's translation by the joints
//! before the wrist and W the wrist's own three axes: each block is decomposed by itself, so a metre never meets a radian. A redundant arm with such
//! a wrist is singular only where T or W is; its wrist is reported singular even where the arm before it could stand in. Any other arm is one block:
//! all task rows, lengths divided by the stated length, at the point where the last two axes meet, else at E.
//!
//! # Measures
//! s_i = σ_i/σ_ref, signed: σ_i = u_iᵀ·J·v_i with u_i and v_i carried from the tick before, so that it crosses zero in a straight line where the smallest
//! singular value itself has a kink. σ_ref is what the smallest one of the block is in the most regular of a fixed set of postures: s is about ±1 in the
//! arm's best posture, as sin θ is at an elbow. For square blocks Π s_i changes sign where det does; for redundant ones Π s_i² is det JJᵀ up to a factor.
//!
//! # Directions
//! A singular vector of the whole block is part translation, part rotation. ζ is the larger half, made a unit vector: eliminating the rotation's row, not
//! the singular vector's, keeps translation exact. At a fold the vector is first made orthogonal to every motion that leaves s alone. With a =
//! [u_v/L; u_ω], aᵀJ = σ vᵀ, so modulo the kept rows ζᵀJ = σ/|u_ω|·vᵀ (or σL/|u_v|·vᵀ).
#![allow(
    clippy::needless_range_loop,
    reason = "indices name rows and directions of several arrays at once"
)]

use super::axes::{frame, meeting};
use super::block::Block;
use super::classify::{Verdict, classify};
use super::family::{ArmFamily, Posture, Situation};
use super::lost::SMALLEST;
use super::screws::Screws;
use super::thresholds::{LATCH, fold};
use crate::centre::AtCentre;
use crate::linear::stack;
use crate::paper::type_1::Fold;
use crate::paper::type_2::TURNS;
use crate::types::{Class, Kind, Singularity};
use model::{Model, Robot, Terms};
use nalgebra::{SMatrix, SVector, Vector3};
use shared_types::checkpoints::PlaceCheckpoint;
use shared_types::random::Uniform;
use shared_types::scenario::{Analysis, BySingularity};
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// Share of rotation in u² above which ζ becomes a rotation, below one minus it a translation: far from the neighbourhood, and in it, where it
/// is changed only before the half that is left vanishes (at a double singularity).
const ANGULAR: [f64; 2] = [0.6, 0.95];

/// |σ| over σ_ref above which a direction is regular, so that its place may pass to another direction.
const FAR: f64 = 0.5;

/// Share of ∇s along v above which s is a coordinate of the fold.
const SLOPE: f64 = 0.1;

/// Postures sampled for σ_ref.
const SAMPLES: usize = 256;

/// A place of the report: which direction of which block it follows, and what is latched about it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    block: usize,
    index: usize,
    angular: bool,
    latched: bool,
    /// ζ is −u: outwards at a fold.
    flipped: bool,
    verdict: Verdict,
}

/// Where the analysis takes place.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Centre {
    /// On the last axis, so far from its origin, m.
    OnLastAxis(f64),
    /// At E.
    EndEffector,
}

/// Singularities of an arm without formulas.
#[derive(Clone, Debug)]
pub struct Numeric<const N: usize> {
    centre: Centre,
    length_m: f64,
    task: [bool; 6],
    eta_out: BySingularity,
    blocks: [Block<N>; 2],
    /// σ_ref of each block.
    reference: [f64; 2],
    block_count: usize,
    places: [Place; MAX_SINGULARITIES],
    count: usize,
}

impl<const N: usize> Numeric<N> {
    /// The source for `robot`, from its geometry; `None` where it has more task axes than joints (it is singular everywhere).
    #[must_use]
    pub fn new(robot: &Robot, analysis: &Analysis) -> Option<Self> {
        let model = Model::<N>::new(robot, None).ok()?;
        let task = robot.task.0;
        let rows = task.iter().filter(|counts| **counts).count();
        if rows > robot.dof() || rows == 0 {
            return None;
        }
        // Any posture without parallel axes.
        let q = SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64);
        let terms = model.evaluate(&q, &SVector::zeros());
        let (meeting, spherical) = meeting(&terms);
        let spherical = spherical && robot.task.is_full();
        let (blocks, block_count) = if spherical {
            (
                [Block::new(0..3, (0, N - 3)), Block::new(3..6, (N - 3, N))],
                2,
            )
        } else {
            let all = Block::new((0..6).filter(|k| task[*k]), (0, robot.dof()));
            ([all, all], 1)
        };
        let place = |block, index| Place {
            block,
            index,
            angular: block == 1,
            latched: false,
            flipped: false,
            verdict: Verdict::default(),
        };
        let mut places = [place(0, 0); MAX_SINGULARITIES];
        let mut count = 0;
        for index in 0..blocks[0].count.min(MAX_SINGULARITIES) {
            places[count] = place(0, index);
            count += 1;
        }
        if spherical {
            // A wrist's axes follow each other at an angle: no more than one of its directions is ever lost.
            places[count] = place(1, 0);
            count += 1;
        }
        // C's position must not depend on a rotation that the task does not serve.
        let centre = meeting
            .filter(|_| task[3..].iter().all(|served| *served))
            .map_or(Centre::EndEffector, Centre::OnLastAxis);
        let mut source = Self {
            centre,
            length_m: robot.length_m,
            task,
            eta_out: analysis.eta_out,
            blocks,
            reference: [1.0; 2],
            block_count,
            places,
            count,
        };
        let at = AtCentre::new(&terms, &source.centre(&terms), &Vector3::zeros());
        source.reference = source.most_regular(&Screws(at.J), robot.dof());
        Some(source)
    }

    /// Largest smallest singular value of each block over a fixed set of postures.
    fn most_regular(&self, screws: &Screws<N>, dof: usize) -> [f64; 2] {
        let mut random = Uniform(1);
        let mut best = [1e-6_f64; 2];
        for _ in 0..SAMPLES {
            let delta = SVector::from_fn(|i, _| {
                if i < dof {
                    random.within(-std::f64::consts::PI, std::f64::consts::PI)
                } else {
                    0.0
                }
            });
            let scaled = screws.moved(&delta).0.scaled(self.length_m);
            for k in 0..self.block_count {
                let mut block = self.blocks[k];
                block.track(&scaled);
                best[k] = best[k].max(block.smallest());
            }
        }
        best
    }

    /// Gives a place to a smaller value that has none, where both are regular.
    fn reassign(&mut self) {
        for k in 0..self.block_count {
            for p in 0..self.count {
                let place = self.places[p];
                if place.block != k || place.latched {
                    continue;
                }
                for index in 0..self.blocks[k].count {
                    let block = &self.blocks[k];
                    let taken = self.places[..self.count]
                        .iter()
                        .any(|other| other.block == k && other.index == index);
                    let (new, old) = (
                        block.sigma[index].abs(),
                        block.sigma[self.places[p].index].abs(),
                    );
                    if !taken && new < old && new > FAR * self.reference[k] {
                        // On the side where the other one was, so that s goes on without a step.
                        if block.sigma[index] * block.sigma[self.places[p].index] < 0.0 {
                            let block = &mut self.blocks[k];
                            (block.v[index], block.sigma[index]) =
                                (-block.v[index], -block.sigma[index]);
                        }
                        self.places[p].index = index;
                    }
                }
            }
        }
    }

    fn singularity(
        &mut self,
        p: usize,
        at: &Posture<'_, N>,
        screws: &Screws<N>,
        motion: &[Motion<N>; 2],
    ) -> Singularity<N> {
        let place = self.places[p];
        let (block, reference, L) = (
            &self.blocks[place.block],
            self.reference[place.block],
            self.length_m,
        );
        let (i, motion) = (place.index, &motion[place.block]);
        let sigma = block.sigma[i];
        let s = if sigma.abs() < SMALLEST * reference {
            SMALLEST.copysign(sigma)
        } else {
            sigma / reference
        };

        let kind = if place.block == 1 {
            Kind::Wrist
        } else {
            Kind::Numeric
        };
        let eta_out = self.eta_out.of(kind.code());
        let u = block.covector(i);
        let threshold = ANGULAR[usize::from(place.latched)];
        let angular = crate::linear::angular(&u).norm_squared()
            > if place.angular {
                1.0 - threshold
            } else {
                threshold
            };
        let mut latched = place.latched;
        let mut verdict = place.verdict;
        if !latched && s.abs() <= LATCH.0 * eta_out {
            latched = true;
            verdict = classify(screws, block, i, L, &self.task);
        } else if latched && s.abs() > LATCH.1 * eta_out {
            (latched, verdict) = (false, Verdict::default());
        }

        let v = block.v[i];
        let gradient = block.gradient(screws, i, L) / reference;
        let s_rate = gradient.dot(at.qdot);
        let slope = gradient.dot(&v);
        let fold = verdict.class == Class::Type1 && slope.abs() > SLOPE * gradient.norm();
        let u = if fold {
            block.along_fold(i, &gradient, slope)
        } else {
            u
        };
        let (u_v, u_w) = (crate::linear::linear(&u), crate::linear::angular(&u));
        let (mut axis, size) = if angular { unit(&u_w) } else { unit(&u_v) };
        let per_aux = if angular { 1.0 / size } else { L / size };

        let mut gain = s * reference * per_aux;
        // A fold is left against ζ: x = h·s²/2 along it with h < 0. Settled when the type is, so that it never flips inside.
        let flipped = if latched && !place.latched {
            fold && slope > 0.0
        } else {
            latched && place.flipped
        };
        if flipped {
            (axis, gain) = (-axis, -gain);
        }
        let (zeta_B, R_BS) = if angular {
            (
                stack(&Vector3::zeros(), &axis),
                frame(&axis, &self.towards(at, &axis)),
            )
        } else {
            (
                stack(&axis, &Vector3::zeros()),
                frame(&axis, &self.towards(at, &axis)),
            )
        };
        let (aux, aux_rate, aux_bias, aux_row, gain) = if fold {
            // A fold: s itself is the task coordinate, x = h·s²/2 along ζ with h = gain/s.
            (s, s_rate, 0.0, gradient, gain / slope)
        } else {
            let bias = block.v_bias(&motion.Jdot, &motion.M, i, at.qdot, L);
            (0.0, v.dot(at.qdot), bias, v, gain)
        };
        self.places[p] = Place {
            angular,
            latched,
            flipped,
            verdict,
            ..place
        };
        Singularity {
            kind,
            class: verdict.class,
            angular,
            s,
            s_rate,
            zeta_B,
            R_BS,
            gain,
            aux,
            aux_rate,
            aux_bias,
            aux_row,
            kappa_1: verdict.kappa_1,
            kappa_2: verdict.kappa_2,
            ..Singularity::none()
        }
    }

    /// The target of a singular frame's second axis: the last joint's axis, or the one before it where ζ lies along that.
    fn towards(&self, at: &Posture<'_, N>, axis: &Vector3<f64>) -> Vector3<f64> {
        let z = at.terms.z[N - 1];
        if N < 2 || z.dot(axis).abs() < 0.9 {
            z
        } else {
            at.terms.z[N - 2]
        }
    }
}

/// How a block changes at a tick.
#[derive(Clone, Copy, Debug)]
struct Motion<const N: usize> {
    Jdot: SMatrix<f64, 6, N>,
    M: [[f64; 6]; 6],
}

impl<const N: usize> ArmFamily<N> for Numeric<N> {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        match self.centre {
            Centre::OnLastAxis(offset) => terms.p[N - 1] + terms.z[N - 1] * offset,
            Centre::EndEffector => terms.X_BE.p,
        }
    }

    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let screws = Screws(posture.at.J);
        let scaled = screws.scaled(self.length_m);
        let Jdot = screws.rate(posture.qdot);
        let mut motion = [Motion {
            Jdot,
            M: [[0.0; 6]; 6],
        }; 2];
        for k in 0..self.block_count {
            self.blocks[k].track(&scaled);
            motion[k].M = self.blocks[k].coupling(&Jdot, self.length_m);
        }
        self.reassign();
        for p in 0..self.count {
            out[p] = self.singularity(p, posture, &screws, &motion);
        }
        self.count
    }

    /// s itself is the fold's coordinate: the second-order motion along ζ is h·s²/2 with h = gain/s.
    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        // s is never exactly zero; gain vanishes with it.
        let inverse_curvature = s.s / s.gain;
        if !inverse_curvature.is_finite() {
            return None;
        }
        Some(fold(s.s, inverse_curvature, s, at))
    }

    /// Along the null motion, which is straight where C is held by joints that rest (any spherical wrist).
    fn turning(
        &self,
        s: &Singularity<N>,
        _terms: &Terms<N>,
        _p_BC: &Vector3<f64>,
        angle: f64,
    ) -> Option<SVector<f64, N>> {
        (s.kappa_2.abs() > TURNS).then(|| s.aux_row * (angle / s.kappa_2))
    }

    fn save(&self, out: &mut AnalyzerCheckpoint) {
        for (out, block) in out.blocks.iter_mut().zip(&self.blocks) {
            *out = block.checkpoint();
        }
        for (out, place) in out.places.iter_mut().zip(&self.places) {
            *out = PlaceCheckpoint {
                index: place.index as u32,
                class: place.verdict.class.code(),
                angular: u32::from(place.angular),
                latched: u32::from(place.latched),
                flipped: u32::from(place.flipped),
                kappa_1: place.verdict.kappa_1,
                kappa_2: place.verdict.kappa_2,
                ..PlaceCheckpoint::default()
            };
        }
    }

    fn restore(&mut self, from: &AnalyzerCheckpoint) {
        for (block, from) in self.blocks.iter_mut().zip(&from.blocks) {
            block.restore(from);
        }
        for (place, from) in self.places.iter_mut().zip(&from.places) {
            let class = Class::from_code(from.class);
            let verdict = Verdict {
                class: class.unwrap_or(Class::Unknown),
                kappa_1: from.kappa_1,
                kappa_2: from.kappa_2,
                distance: 0.0,
            };
            let index = (from.index as usize).min(self.blocks[place.block].count.saturating_sub(1));
            // Without a type that exists it is classified again.
            let (angular, latched, flipped) = (
                from.angular != 0,
                from.latched != 0 && class.is_some(),
                from.flipped != 0,
            );
            *place = Place {
                angular,
                latched,
                flipped,
                verdict,
                index,
                block: place.block,
            };
        }
    }
}

fn unit(v: &Vector3<f64>) -> (Vector3<f64>, f64) {
    let size = v.norm().max(1e-9);
    (v / size, size)
}
