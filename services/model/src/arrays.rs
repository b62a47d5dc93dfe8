//! Arrays of joints on the wire, and vectors of the arm's own joints.

use nalgebra::SVector;
use shared_types::MAX_DOF;

/// The first `N` of an array of joints.
#[must_use]
pub fn joints<const N: usize>(values: &[f64; MAX_DOF]) -> SVector<f64, N> {
    const { assert!(N <= MAX_DOF) };
    SVector::from_fn(|i, _| values[i])
}

/// An array of joints, zero beyond the arm's own.
#[must_use]
pub fn padded<const N: usize>(values: &SVector<f64, N>) -> [f64; MAX_DOF] {
    const { assert!(N <= MAX_DOF) };
    std::array::from_fn(|i| if i < N { values[i] } else { 0.0 })
}
