//! The singular frame: the directions of the task that are orthogonal to the singular ones.

use crate::linear::{Basis, Vector3, Vector6, halves};
use crate::types::Refusal;

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
    zetas: impl ExactSizeIterator<Item = Vector6> + Clone,
) -> Result<Basis<6>, Refusal> {
    let mut orthogonal = Basis::<6>::empty();
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
        if basis.is_empty() {
            // Nothing is dropped here: the axes of the task themselves.
            for axis in axes() {
                orthogonal.push(halves(&axis, from == 3));
            }
            continue;
        }
        let count = axes().count();
        while basis.len() < count {
            if !basis.add_best(axes()) {
                break;
            }
            orthogonal.push(halves(&basis[basis.len() - 1], from == 3));
        }
    }
    if orthogonal.len() + zetas.len() > N {
        return Err(Refusal::Singular);
    }
    Ok(orthogonal)
}
