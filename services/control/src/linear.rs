//! Small dense algebra of static size, with a bounded number of iterations and the same bits on every machine.

pub use model::{rotation_exp, rotation_log, rotation_twist, stack};
use nalgebra::{Quaternion, SMatrix, SVector, UnitQuaternion};

/// A number for each joint.
pub type Joints<const N: usize> = SVector<f64, N>;
/// 6×N, rows [v; ω]: what a motion of the joints does to a link.
pub type Jacobian<const N: usize> = SMatrix<f64, 6, N>;
/// A vector in space.
pub type Vector3 = nalgebra::Vector3<f64>;
/// A twist, a wrench or a pose error: a linear and an angular half.
pub type Vector6 = nalgebra::Vector6<f64>;
/// A rotation matrix, or a frame.
pub type Matrix3 = nalgebra::Matrix3<f64>;

/// +1 or −1.
#[inline]
pub fn sign(is_positive: bool) -> f64 {
    if is_positive { 1.0 } else { -1.0 }
}

/// The vector with a one in place `i`, and zeros.
pub fn unit<const N: usize>(i: usize) -> Joints<N> {
    Joints::from_fn(|k, _| if k == i { 1.0 } else { 0.0 })
}

/// How many singular values of an `R`×`C` matrix are above `tolerance` of its norm ‖M‖ = √Σσ².
///
/// They are the eigenvalues of MMᵀ − (tolerance·‖M‖)²·1 above zero, and those are as many as the positive pivots of its factors L·D·Lᵀ: Sylvester's
/// law of inertia [Golub & Van Loan, *Matrix Computations*, §8.1.5], pivots taken by size. No root, no iteration: ten times quicker than the singular
/// values, on every tick.
///
/// Shapes R×C → at most min(R, C) for a tolerance above 1e-7, where the squares are rounded · Units none · Ensures that a NaN counts as lost · Errors
/// none · Cost O(R²C + R³), 0.1 µs for 6×6; no allocation
pub fn rank<const R: usize, const C: usize>(M: &SMatrix<f64, R, C>, tolerance: f64) -> u32 {
    // Whole columns of the symmetric matrix: quicker than the half of it.
    let mut S = [[0.0; R]; R];
    for m in &M.data.0 {
        for (S, x) in S.iter_mut().zip(m) {
            for (s, y) in S.iter_mut().zip(m) {
                *s += x * y;
            }
        }
    }
    let floor = tolerance * tolerance * (0..R).map(|i| S[i][i]).sum::<f64>();
    for (i, column) in S.iter_mut().enumerate() {
        column[i] -= floor;
    }
    // In the order of the rows where every pivot is positive, as on all but few ticks.
    let mut full = S;
    let is_full = (0..R).all(|k| {
        let (pivot, inverse) = (full[k], 1.0 / full[k][k]);
        full[k + 1..].iter_mut().for_each(|column| {
            let l = column[k] * inverse;
            column.iter_mut().zip(&pivot).for_each(|(s, p)| *s -= l * p);
        });
        pivot[k] > 0.0
    });
    if is_full {
        R as u32
    } else {
        positive_pivots(S)
    }
}

/// How many of the pivots of a symmetric matrix, taken by size, are positive; a NaN is not.
fn positive_pivots<const R: usize>(mut S: [[f64; R]; R]) -> u32 {
    let (mut left, mut positive) = ([true; R], 0);
    for _ in 0..R {
        let (mut k, mut size) = (R, 0.0);
        for i in 0..R {
            if left[i] && S[i][i].abs() > size {
                (k, size) = (i, S[i][i].abs());
            }
        }
        if k == R {
            break;
        }
        (left[k], positive) = (false, positive + u32::from(S[k][k] > 0.0));
        let (pivot, inverse) = (S[k], 1.0 / S[k][k]);
        for column in &mut S {
            let l = column[k] * inverse;
            column.iter_mut().zip(&pivot).for_each(|(s, p)| *s -= l * p);
        }
    }
    positive
}

/// √det MMᵀ of the matrix whose rows these are: the volume that they span.
///
/// Modified Gram–Schmidt [Golub & Van Loan, *Matrix Computations*, §5.2.8], as accurate as the product of the singular values.
///
/// Shapes rows of length C, at most C of them: more span no volume, and what is left of rounding is returned · Units the product of the rows' · Requires
/// finite entries: any other gives a NaN or zero · Errors none · Cost O(rows²·C), no allocation
pub fn volume<const C: usize>(rows: &mut [SVector<f64, C>]) -> f64 {
    let mut volume = 1.0;
    for i in 0..rows.len() {
        let (done, rest) = rows.split_at_mut(i + 1);
        let (row, square) = (&done[i], done[i].norm_squared());
        volume *= square.sqrt();
        if square > 0.0 {
            rest.iter_mut()
                .for_each(|other| *other -= row * (row.dot(other) / square));
        }
    }
    volume
}

/// Directions, orthonormal where [`add`](Self::add) has added them.
#[derive(Clone, Copy, Debug)]
pub struct Basis<const D: usize> {
    vectors: [SVector<f64, D>; D],
    count: usize,
}

impl<const D: usize> std::ops::Deref for Basis<D> {
    type Target = [SVector<f64, D>];
    fn deref(&self) -> &[SVector<f64, D>] {
        &self.vectors[..self.count]
    }
}

impl<const D: usize> Basis<D> {
    /// The empty set.
    pub fn empty() -> Self {
        Self {
            vectors: [SVector::zeros(); D],
            count: 0,
        }
    }

    /// Adds `v` as it is, where there is room.
    #[inline]
    pub fn push(&mut self, v: SVector<f64, D>) {
        if self.count < D {
            self.vectors[self.count] = v;
            self.count += 1;
        }
    }

    /// The part of `v` that is orthogonal to all, by Gram–Schmidt; twice is orthogonal to rounding.
    #[must_use]
    #[inline]
    pub fn residual(&self, mut v: SVector<f64, D>) -> SVector<f64, D> {
        for b in &**self {
            v -= b * b.dot(&v);
        }
        v
    }

    /// Adds what is new in `v`; false if nothing is (less than 1e-6 of it), or the set is full.
    pub fn add(&mut self, v: SVector<f64, D>) -> bool {
        let (length, residual) = (v.norm(), self.residual(self.residual(v)));
        let new = residual.norm();
        if self.count == D || new <= 1e-6 * length || new == 0.0 {
            return false;
        }
        self.push(residual / new);
        true
    }

    /// Adds the candidate with the largest new part.
    pub fn add_best(&mut self, candidates: impl Iterator<Item = SVector<f64, D>>) -> bool {
        let mut best = SVector::zeros();
        let mut size = 0.0;
        for candidate in candidates {
            let residual = self.residual(self.residual(candidate));
            if residual.norm_squared() > size {
                (best, size) = (residual, residual.norm_squared());
            }
        }
        self.add(best)
    }

    /// The unit vector orthogonal to all that has most of one axis; shorter, down to zeros, where the vectors leave none.
    pub fn any(&self) -> SVector<f64, D> {
        // Of an orthonormal set: what it leaves of axis k has the square 1 − Σ b_k².
        let (mut best, mut most) = (SVector::<f64, D>::zeros(), 0.0);
        for k in 0..D {
            let spanned = self.iter().map(|b| b[k] * b[k]);
            let square = 1.0 - spanned.sum::<f64>();
            if square > most + 1e-9 {
                (best, most) = (unit(k), square);
            }
        }
        let best = self.residual(best);
        let rest = self.residual(best / best.norm().max(1e-12));
        rest / rest.norm().max(1e-9)
    }
}

/// Most rows of [`one_sided_jacobi`].
const MOST_ROWS: usize = 8;

/// Makes `rows` orthogonal by one-sided Jacobi rotations, each at most a quarter turn; at most [`SWEEPS`] sweeps.
///
/// Rows i and j of squared lengths a and b are left alone where their product is at most `negligible(a, b)`. Each rotation is passed to `follow`.
///
/// Shapes up to 8 rows of length C · Requires finite rows: any other stay so, and are rotated in every sweep · Ensures products at most
/// `negligible` for rows of length up to 8, whatever their lengths and angles (`sweeps_suffice`) · Errors none · Cost at most [`SWEEPS`] rotations
/// per pair, one or two near orthogonal rows; no allocation
///
/// A sweep takes the pairs by i + j: pairs of one sum have no row in common, so that the processor computes up to three rotations at once, each of
/// which mostly waits for roots and quotients. Each row meets the others in the same order as when the pairs are taken row by row, so the numbers are
/// the same to the last bit.
pub fn one_sided_jacobi<const C: usize>(
    rows: &mut [SVector<f64, C>],
    negligible: impl Fn(f64, f64) -> f64,
    mut follow: impl FnMut(usize, usize, Rotation),
) {
    for _ in 0..SWEEPS {
        let mut rotated = false;
        // Squared lengths, kept up to date within a sweep.
        let mut squares = [0.0; MOST_ROWS];
        for (square, row) in squares.iter_mut().zip(&*rows) {
            *square = row.norm_squared();
        }
        for sum in 1..(2 * rows.len()).saturating_sub(2) {
            for i in (sum + 1).saturating_sub(rows.len())..sum.div_ceil(2) {
                let j = sum - i;
                let (x, y) = (rows[i].data.0[0], rows[j].data.0[0]);
                let (a, b, c) = (
                    squares[i],
                    squares[j],
                    x.iter().zip(&y).fold(0.0, |sum, (x, y)| sum + x * y),
                );
                if c.abs() <= negligible(a, b) {
                    continue;
                }
                rotated = true;
                let rotation = Rotation::diagonalising(a, b, c);
                (squares[i], squares[j]) = (a - rotation.tan * c, b + rotation.tan * c);
                for k in 0..C {
                    (rows[i][k], rows[j][k]) = rotation.of(x[k], y[k]);
                }
                follow(i, j, rotation);
            }
        }
        if !rotated {
            break;
        }
    }
}

/// A plane rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    cos: f64,
    sin: f64,
    tan: f64,
}

impl Rotation {
    /// The rotation by at most a quarter turn that makes [[a, c], [c, b]] diagonal, c ≠ 0 [Golub & Van Loan, *Matrix Computations*, §8.5].
    #[inline]
    fn diagonalising(a: f64, b: f64, c: f64) -> Self {
        let tau = (b - a) / (2.0 * c);
        let t = if tau < 0.0 { -1.0 } else { 1.0 } / (tau.abs() + (1.0 + tau * tau).sqrt());
        let cos = 1.0 / (1.0 + t * t).sqrt();
        Self {
            cos,
            sin: cos * t,
            tan: t,
        }
    }

    /// The pair (x, y), rotated.
    #[inline]
    pub fn of(&self, x: f64, y: f64) -> (f64, f64) {
        (x * self.cos - y * self.sin, x * self.sin + y * self.cos)
    }
}

/// Eigenvalues and eigenvectors (columns, in the same order) of a symmetric matrix.
///
/// Cyclic Jacobi rotations [Golub & Van Loan, *Matrix Computations*, §8.5], at most [`SWEEPS`] sweeps whatever the matrix.
///
/// Shapes M×M → M and M×M · Units of the values those of S · Requires finite entries, S = Sᵀ: a NaN or an infinity gives no finite values · Ensures VᵀV = 1 and
/// V·diag(values)·Vᵀ = S within 1e-12 of the largest entry up to M = 8 (`sweeps_suffice`) · Errors none · Cost O(M³) per sweep, no allocation
pub fn symmetric_eigen<const M: usize>(
    S: &SMatrix<f64, M, M>,
) -> (SVector<f64, M>, SMatrix<f64, M, M>) {
    let (mut D, mut V) = (*S, SMatrix::<f64, M, M>::identity());
    for _ in 0..SWEEPS {
        let mut rotated = false;
        for i in 0..M {
            for j in i + 1..M {
                let c = D[(i, j)];
                if c.abs() <= 1e-17 * (D[(i, i)] * D[(j, j)]).abs().sqrt() || c == 0.0 {
                    continue;
                }
                rotated = true;
                let rotation = Rotation::diagonalising(D[(i, i)], D[(j, j)], c);
                for k in 0..M {
                    let (a, b) = (D[(k, i)], D[(k, j)]);
                    (D[(k, i)], D[(k, j)]) = rotation.of(a, b);
                }
                for k in 0..M {
                    let (a, b) = (D[(i, k)], D[(j, k)]);
                    (D[(i, k)], D[(j, k)]) = rotation.of(a, b);
                    let (a, b) = (V[(k, i)], V[(k, j)]);
                    (V[(k, i)], V[(k, j)]) = rotation.of(a, b);
                }
            }
        }
        if !rotated {
            break;
        }
    }
    (D.diagonal(), V)
}

/// Most Jacobi sweeps: quadratic convergence needs five or six for 6×6.
pub const SWEEPS: usize = 8;

/// Whether every element is a finite number.
#[inline]
pub fn is_finite<const N: usize>(v: &SVector<f64, N>) -> bool {
    v.iter().all(|x| x.is_finite())
}

/// The Jacobian of the point that lies at `r` from that of `J`, on the same link: v + ω×r.
#[inline]
pub fn displaced<const N: usize>(mut J: Jacobian<N>, r: &Vector3) -> Jacobian<N> {
    for mut column in J.column_iter_mut() {
        let v = Vector3::new(column[3], column[4], column[5]).cross(r);
        (0..3).for_each(|k| column[k] += v[k]);
    }
    J
}

/// The rotation of a quaternion w, x, y, z, which is made a unit.
pub fn rotation_of([w, x, y, z]: [f64; 4]) -> Matrix3 {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
        .to_rotation_matrix()
        .into_inner()
}

/// The linear half of a twist.
#[inline]
pub fn linear(twist: &Vector6) -> Vector3 {
    twist.fixed_rows::<3>(0).into_owned()
}

/// The angular half of a twist.
#[inline]
pub fn angular(twist: &Vector6) -> Vector3 {
    twist.fixed_rows::<3>(3).into_owned()
}

/// One half of a twist.
#[inline]
pub fn half_of(twist: &Vector6, is_angular: bool) -> Vector3 {
    if is_angular {
        angular(twist)
    } else {
        linear(twist)
    }
}

/// The vector of this half of a twist, the other half zero.
#[inline]
pub fn halves(half: &Vector3, is_angular: bool) -> Vector6 {
    let zero = Vector3::zeros();
    if is_angular {
        stack(&zero, half)
    } else {
        stack(half, &zero)
    }
}

/// The parts of a twist or error along the axes that a task serves, zero along the others.
#[inline]
pub fn served(task: &[bool; 6], twist: &Vector6) -> Vector6 {
    Vector6::from_fn(|k, _| if task[k] { twist[k] } else { 0.0 })
}

/// Cubic step: 0 at x ≤ 0, 1 at x ≥ 1, flat at both ends.
#[inline]
pub fn smoothstep(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// `x` brought to (−π, π].
pub fn wrap_angle(x: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let y = x - TAU * libm::floor((x + PI) / TAU);
    if y <= -PI { y + TAU } else { y }
}

/// `x` brought to (−π/2, π/2]: the nearest of two opposite directions.
pub fn wrap_line(x: f64) -> f64 {
    0.5 * wrap_angle(2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// Matrices whose singular values lie over `decades`, in random directions.
    fn matrix6() -> impl Strategy<Value = Matrix6<f64>> {
        let entries = prop::collection::vec(-1.0..1.0_f64, 36);
        (entries, prop::array::uniform6(-6.0..2.0_f64)).prop_map(|(entries, decades)| {
            let svd = Matrix6::from_iterator(entries).svd(true, true);
            let sigma = Vector6::from(decades.map(|decade| 10.0_f64.powf(decade)));
            svd.u.unwrap() * Matrix6::from_diagonal(&sigma) * svd.v_t.unwrap()
        })
    }

    proptest! {
        #[test]
        fn decompositions_are_nalgebras(M in matrix6(), tolerance in 1e-5..1e-1_f64) {
            let sigma = M.singular_values();
            // `rank` counts those above its floor, wherever none is within rounding of it.
            let floor = tolerance * M.norm();
            if sigma.iter().all(|x| (x / floor - 1.0).abs() > 1e-4) {
                prop_assert_eq!(rank(&M, tolerance) as usize, sigma.iter().filter(|x| **x > floor).count());
            }
            prop_assert_eq!(rank(&(M * f64::NAN), tolerance), 0);
            let mut rows: [Vector6; 6] = std::array::from_fn(|i| M.row(i).transpose());
            let product: f64 = sigma.iter().product();
            prop_assert!((volume(&mut rows) - product).abs() < 1e-9 * product + 1e-13 * sigma[0].powi(6));
            let (values, V) = symmetric_eigen(&(M + M.transpose()));
            prop_assert!((V.transpose() * V - Matrix6::identity()).amax() < 1e-12);
            prop_assert!((V * Matrix6::from_diagonal(&values) * V.transpose() - M - M.transpose()).amax() < 1e-12 * sigma[0].max(1.0));
        }

        /// Rows of lengths over sixteen decades, near parallel or equal in size: the sweeps end because nothing is left to rotate.
        #[test]
        fn sweeps_suffice(
            entries in prop::collection::vec(-1.0..1.0_f64, 64),
            decades in prop::array::uniform8(-8.0..8.0_f64),
            parallel in 0.0..1.0_f64,
        ) {
            let M = SMatrix::<f64, 8, 8>::from_fn(|i, j| (1.0 - parallel) * entries[8 * i + j] + parallel * entries[j]);
            let mut rows: [SVector<f64, 8>; 8] = std::array::from_fn(|i| M.row(i).transpose() * 10.0_f64.powf(decades[i]));
            let negligible = |a: f64, b: f64| 1e-9 * (a * b).sqrt();
            one_sided_jacobi(&mut rows, negligible, |_, _, _| ());
            for (i, j) in (0..8).flat_map(|i| (0..i).map(move |j| (i, j))) {
                let (a, b) = (rows[i].norm_squared(), rows[j].norm_squared());
                prop_assert!(rows[i].dot(&rows[j]).abs() <= negligible(a, b), "{i}, {j}: {a:e} {b:e}");
            }
            for S in [M + M.transpose(), M.transpose() * M] {
                let (values, V) = symmetric_eigen(&S);
                prop_assert!((V * SMatrix::<f64, 8, 8>::from_diagonal(&values) * V.transpose() - S).amax() < 1e-12 * S.amax().max(1.0));
            }
        }
    }

    #[test]
    fn angles_and_lines_are_brought_to_their_nearest() {
        assert!((wrap_angle(3.0 * PI) - PI).abs() < 1e-15 && (wrap_angle(-PI) - PI).abs() < 1e-15);
        assert!((wrap_line(0.75 * PI) + 0.25 * PI).abs() < 1e-15);
    }
}
