//! Neighbourhoods of singularities.

/// The neighbourhood of one singularity, with entry and exit apart so that noise at the edge switches nothing.
///
/// D_si = { q : |s_i(q)| ≤ η_i }     [CK95 Eq. 2]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighborhood {
    /// Entered at |s| ≤ η_in.
    pub eta_in: f64,
    /// Left at |s| > η_out.
    pub eta_out: f64,
}

impl Neighborhood {
    /// Whether a posture of measure `s` lies inside, given whether the one before did.
    #[must_use]
    pub fn update(&self, was_inside: bool, s: f64) -> bool {
        s.abs() <= if was_inside { self.eta_out } else { self.eta_in }
    }

    /// How regular the posture is: 0 at |s| ≤ η_in, 1 at |s| ≥ η_out, smooth between.
    #[must_use]
    pub fn openness(&self, s: f64) -> f64 {
        crate::linear::smoothstep((s.abs() - self.eta_in) / (self.eta_out - self.eta_in))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const D: Neighborhood = Neighborhood { eta_in: 0.1, eta_out: 0.2 };

    // covers: CK95 Eq. 2
    #[test]
    fn entry_and_exit_are_apart() {
        assert!(!D.update(false, 0.15) && D.update(true, 0.15), "between the thresholds nothing changes");
        assert!(D.update(false, -0.1) && !D.update(true, -0.21));
    }

    #[test]
    fn openness_is_zero_inside_and_one_outside() {
        assert_eq!([D.openness(0.05), D.openness(-0.1), D.openness(0.2), D.openness(-0.5)], [0.0, 0.0, 1.0, 1.0]);
        assert!((D.openness(-0.15) - 0.5).abs() < 1e-15);
    }
}
