//! The singular frame: the directions of the task that are orthogonal to the singular ones.

use crate::types::Refusal;
use nalgebra::{SVector, Vector3, Vector6};

/// Directions of the task orthogonal to the singular ones, orthonormal within each half, and how many.
#[derive(Clone, Copy, Debug)]
pub struct OrthogonalRows {
    rows: [Vector6<f64>; 6],
    count: usize,
}

impl OrthogonalRows {
    /// Adds a direction of the half of the task whose first axis is `from`.
    #[inline]
    fn push(&mut self, from: usize, direction: &Vector3<f64>) {
        self.rows[self.count]
            .fixed_rows_mut::<3>(from)
            .copy_from(direction);
        self.count += 1;
    }
}

impl std::ops::Deref for OrthogonalRows {
    type Target = [Vector6<f64>];
    fn deref(&self) -> &[Vector6<f64>] {
        &self.rows[..self.count]
    }
}

/// The orthogonal complement of the singular directions in the task, translations and rotations apart.
///
/// The singular frame of the paper with its first axes dropped: which basis of the complement is chosen does not matter, for the torque does not
/// depend on it. A metre is never mixed with a radian.
///
/// Shapes each row 6, [linear; angular] · Frame base axes at C · Requires each ζ a unit vector in one half · Ensures rows orthonormal within each half
/// and orthogonal to every ζ · Source CK95 §4 · Cost O(6³), no allocation
///
/// # Errors
/// [`Refusal::Singular`] where orthogonal and singular rows together outnumber the joints.
#[inline]
pub fn orthogonal_rows<const N: usize>(
    task: &[bool; 6],
    zetas: impl ExactSizeIterator<Item = Vector6<f64>> + Clone,
) -> Result<OrthogonalRows, Refusal> {
    let mut orthogonal = OrthogonalRows {
        rows: [Vector6::zeros(); 6],
        count: 0,
    };
    for from in [0, 3] {
        let axes = || {
            (0..3)
                .filter(|k| task[from + k])
                .map(|k| Vector3::ith(k, 1.0))
        };
        // Orthonormal directions so far: singular ones first, then those orthogonal to them.
        let mut basis = Basis::<3>::empty();
        for zeta in zetas.clone() {
            let zeta = zeta.fixed_rows::<3>(from);
            if zeta.norm_squared() > 0.25 {
                basis.add(Vector3::from_fn(
                    |k, _| if task[from + k] { zeta[k] } else { 0.0 },
                ));
            }
        }
        if basis.count() == 0 {
            // Nothing is dropped here: the axes of the task themselves.
            for axis in axes() {
                orthogonal.push(from, &axis);
            }
            continue;
        }
        let count = axes().count();
        while basis.count() < count {
            if !basis.add_best(axes()) {
                break;
            }
            orthogonal.push(from, &basis.last());
        }
    }
    if orthogonal.count + zetas.len() > N {
        return Err(Refusal::Singular);
    }
    Ok(orthogonal)
}

/// An orthonormal set that grows: Gram–Schmidt, twice for orthogonality to rounding.
#[derive(Clone, Copy, Debug)]
pub struct Basis<const D: usize> {
    vectors: [SVector<f64, D>; D],
    count: usize,
}

impl<const D: usize> Basis<D> {
    /// The empty set.
    #[must_use]
    pub fn empty() -> Self {
        Self {
            vectors: [SVector::zeros(); D],
            count: 0,
        }
    }

    /// How many vectors it has.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// The vector added last.
    #[must_use]
    pub fn last(&self) -> SVector<f64, D> {
        self.vectors[self.count - 1]
    }

    #[inline]
    fn residual(&self, mut v: SVector<f64, D>) -> SVector<f64, D> {
        for _ in 0..2 {
            for b in &self.vectors[..self.count] {
                v -= b * b.dot(&v);
            }
        }
        v
    }

    /// Adds what is new in `v`; false if nothing is (less than 1e-6 of it), or the set is full.
    pub fn add(&mut self, v: SVector<f64, D>) -> bool {
        let (length, residual) = (v.norm(), self.residual(v));
        let new = residual.norm();
        if self.count == D || new <= 1e-6 * length || new == 0.0 {
            return false;
        }
        self.vectors[self.count] = residual / new;
        self.count += 1;
        true
    }

    /// Adds the candidate with the largest new part.
    pub fn add_best(&mut self, candidates: impl Iterator<Item = SVector<f64, D>>) -> bool {
        let mut best = SVector::zeros();
        let mut size = 0.0;
        for candidate in candidates {
            let residual = self.residual(candidate);
            if residual.norm_squared() > size {
                (best, size) = (residual, residual.norm_squared());
            }
        }
        self.add(best)
    }
}
