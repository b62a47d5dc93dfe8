//! A signed singular value decomposition that is carried from posture to posture.
#![allow(
    clippy::needless_range_loop,
    reason = "indices name rows and directions of several arrays at once"
)]

use super::tracker::unscaled;
use crate::linear::{Basis, Jacobian, Joints, Vector6, one_sided_jacobi, unit};
use model::{joints, padded};
use nalgebra::SMatrix;
use shared_types::checkpoints::BlockCheckpoint;

/// Damping of squared singular values, unit-scaled, where two of them cross: σ = 0.01 is far below any in the arm's regular postures.
pub(super) const SQUARED_GAP: f64 = 1e-4;

/// Length below which a row is noise and v comes from its companions.
const TINY: f64 = 1e-7;

/// Some rows and columns of the unit-scaled J, decomposed: B = Σ u_i σ_i v_iᵀ, continuous in sign and order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrackedSvd<const N: usize> {
    /// Rows of J, `count` of them.
    rows: [usize; 6],
    pub(super) count: usize,
    /// Columns of J that count.
    columns: (usize, usize),
    /// u_i, on this block's rows.
    pub(super) U: [[f64; 6]; 6],
    pub(super) v: [Joints<N>; 6],
    pub(super) sigma: [f64; 6],
    pub(super) begun: bool,
}

impl<const N: usize> TrackedSvd<N> {
    pub(super) fn new(rows: impl Iterator<Item = usize>, columns: (usize, usize)) -> Self {
        let mut block = Self {
            rows: [0; 6],
            count: 0,
            columns,
            U: std::array::from_fn(|i| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 })),
            v: [Joints::zeros(); 6],
            sigma: [0.0; 6],
            begun: false,
        };
        for row in rows {
            block.rows[block.count] = row;
            block.count += 1;
        }
        block
    }

    /// Whether there are as many rows as joints: σ is then signed, and a singularity has codimension one.
    pub(super) fn is_square(&self) -> bool {
        self.count == self.columns.1 - self.columns.0
    }

    /// Whether joint `k` is one of this block's.
    pub(super) fn has_column(&self, k: usize) -> bool {
        (self.columns.0..self.columns.1).contains(&k)
    }

    /// The joints that the arm does not have: their columns of J are zero, and no motion of theirs counts.
    pub(super) fn absent(&self) -> Basis<N> {
        let mut absent = Basis::empty();
        for k in (0..N).filter(|k| !self.has_column(*k)) {
            absent.push(unit(k));
        }
        absent
    }

    /// The directions orthogonal to Π of direction `i`.
    pub(super) fn others(&self, i: usize) -> Basis<N> {
        let mut others = self.absent();
        for j in (0..self.count).filter(|j| *j != i) {
            others.push(self.v[j]);
        }
        others
    }

    /// u_i on all six rows, scaled.
    pub(super) fn covector(&self, i: usize) -> Vector6 {
        let mut u = Vector6::zeros();
        for k in 0..self.count {
            u[self.rows[k]] = self.U[i][k];
        }
        u
    }

    /// The left vector a with aᵀB = (σ_i/slope)·∇sᵀ: at a fold, what is orthogonal to every motion that leaves s alone, where u_i is so at s = 0 only.
    ///
    /// a = u_i + Σ_j u_j (σ_i/σ_j)(v_jᵀ∇s)/(v_iᵀ∇s), bounded where σ_j vanishes too. On scaled rows.
    pub(super) fn along_fold(&self, i: usize, gradient: &Joints<N>, slope: f64) -> Vector6 {
        let mut a = self.covector(i);
        for j in (0..self.count).filter(|j| *j != i) {
            let sigma = self.sigma[j];
            let share = self.sigma[i] * sigma / (sigma * sigma + SQUARED_GAP)
                * self.v[j].dot(gradient)
                / slope;
            a += self.covector(j) * share;
        }
        a
    }

    /// How fast u_i turns while J changes by `Jdot`: u̇_i = Σ_j u_j (σ_j M_ij + σ_i M_ji)/(σ_i² − σ_j²), M = UᵀḂV, bounded where two values cross.
    pub(super) fn turning(&self, Jdot: &Jacobian<N>, i: usize, length_m: f64) -> Vector6 {
        let pushed = |i: usize| Jdot.tr_mul(&unscaled(&self.covector(i), length_m));
        let (own, mut rate) = (pushed(i), Vector6::zeros());
        for j in (0..self.count).filter(|j| *j != i) {
            let gap = self.sigma[i] * self.sigma[i] - self.sigma[j] * self.sigma[j];
            let over = gap / (gap * gap + SQUARED_GAP * SQUARED_GAP);
            let (M_ij, M_ji) = (own.dot(&self.v[j]), pushed(j).dot(&self.v[i]));
            rate += self.covector(j) * ((self.sigma[j] * M_ij + self.sigma[i] * M_ji) * over);
        }
        rate
    }

    /// Decomposes the block of another posture near by.
    ///
    /// One-sided Jacobi rotations of the rows UᵀB, begun with the U of before: each at most a quarter turn, so every u_i stays the one it was, and
    /// values that cross keep their directions. One or two sweeps near by.
    pub(super) fn track(&mut self, scaled: &Jacobian<N>) {
        let n = self.count;
        self.orthonormalise();
        let B: [Joints<N>; 6] = std::array::from_fn(|k| {
            Joints::from_fn(|c, _| match k < n && self.has_column(c) {
                true => scaled[(self.rows[k], c)],
                false => 0.0,
            })
        });
        let mut X = [Joints::<N>::zeros(); 6];
        let mut scale = 0.0_f64;
        for i in 0..n {
            for k in 0..n {
                X[i] += B[k] * self.U[i][k];
            }
            scale = scale.max(X[i].norm_squared());
        }
        let U = &mut self.U;
        one_sided_jacobi(
            &mut X[..n],
            |a, b| 1e-15 * (a * b).sqrt() + 1e-17 * scale,
            |i, j, rotation| {
                for k in 0..n {
                    (U[i][k], U[j][k]) = rotation.of(U[i][k], U[j][k]);
                }
            },
        );
        self.signed(&X, scaled);
    }

    /// v and σ from the rows X_i = σ_i v_iᵀ.
    fn signed(&mut self, X: &[Joints<N>; 6], scaled: &Jacobian<N>) {
        let n = self.count;
        let mut tiny = [false; 6];
        for i in 0..n {
            let size = X[i].norm();
            tiny[i] = size < TINY;
            if !tiny[i] {
                let v = X[i] / size;
                let other_side = self.begun && v.dot(&self.v[i]) < 0.0;
                self.v[i] = if other_side { -v } else { v };
            }
        }
        for i in 0..n {
            if tiny[i] {
                self.v[i] = self.companion(i, &tiny);
                tiny[i] = false;
            }
        }
        for i in 0..n {
            self.sigma[i] = self.v[i].dot(&X[i]);
        }
        if !self.begun {
            self.begun = true;
            self.order();
            // The smallest value takes the sign of det.
            if self.is_square() && self.determinant(scaled) < -f64::EPSILON {
                (self.v[0], self.sigma[0]) = (-self.v[0], -self.sigma[0]);
            }
        }
    }

    /// The unit vector nearest to the old v_i that is orthogonal to all others that are known.
    fn companion(&self, i: usize, unknown: &[bool; 6]) -> Joints<N> {
        let project = |mut v: Joints<N>| {
            for _ in 0..2 {
                for j in (0..self.count).filter(|j| *j != i && !unknown[*j]) {
                    v -= self.v[j] * self.v[j].dot(&v);
                }
            }
            v
        };
        let mut best = project(self.v[i]);
        if best.norm_squared() < 0.25 {
            for k in self.columns.0..self.columns.1 {
                let axis = project(unit(k));
                if axis.norm_squared() > best.norm_squared() + 1e-9 {
                    best = axis;
                }
            }
        }
        best / best.norm().max(1e-12)
    }

    /// Smallest first; each u with its largest component positive.
    fn order(&mut self) {
        for i in 0..self.count {
            for j in i + 1..self.count {
                if self.sigma[j].abs() < self.sigma[i].abs() {
                    self.U.swap(i, j);
                    self.v.swap(i, j);
                    self.sigma.swap(i, j);
                }
            }
            let largest = self.U[i]
                .iter()
                .fold(0.0_f64, |max, x| if x.abs() > max.abs() { *x } else { max });
            if largest < 0.0 {
                self.U[i] = self.U[i].map(|x| -x);
                self.v[i] = -self.v[i];
            }
        }
    }

    /// det B for a square block.
    fn determinant(&self, scaled: &Jacobian<N>) -> f64 {
        let mut M = SMatrix::<f64, 6, 6>::identity();
        for i in 0..self.count {
            for k in 0..self.count {
                M[(i, k)] = scaled[(self.rows[i], self.columns.0 + k)];
            }
        }
        M.determinant()
    }

    /// All that the next decomposition begins with.
    pub(super) fn checkpoint(&self) -> BlockCheckpoint {
        BlockCheckpoint {
            U: self.U,
            v: self.v.map(|v| padded(&v)),
            sigma: self.sigma,
            begun: u32::from(self.begun),
            reserved: 0,
        }
    }

    pub(super) fn restore(&mut self, from: &BlockCheckpoint) {
        self.U = from.U;
        self.v = from.v.map(|v| joints(&v));
        self.sigma = from.sigma;
        self.begun = from.begun != 0;
    }

    /// Removes what rounding has done to U.
    fn orthonormalise(&mut self) {
        for i in 0..self.count {
            for j in 0..i {
                let overlap: f64 = (0..self.count).map(|k| self.U[i][k] * self.U[j][k]).sum();
                for k in 0..self.count {
                    self.U[i][k] -= overlap * self.U[j][k];
                }
            }
            let size = (0..self.count)
                .map(|k| self.U[i][k] * self.U[i][k])
                .sum::<f64>()
                .sqrt()
                .max(1e-12);
            for k in 0..self.count {
                self.U[i][k] /= size;
            }
        }
    }

    /// Smallest |σ|.
    pub(super) fn smallest(&self) -> f64 {
        self.sigma[..self.count]
            .iter()
            .fold(f64::INFINITY, |min, x| min.min(x.abs()))
    }
}
