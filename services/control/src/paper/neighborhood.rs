//! Neighbourhoods of singularities.

/// The neighbourhood of one singularity; entry and exit are apart so that noise at its boundary switches nothing (+).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighborhood {
    /// Entry threshold on |s_i|, dimensionless.
    pub eta_in: f64,
    /// Exit threshold on |s_i|, dimensionless; η_out > η_in.
    pub eta_out: f64,
}

impl Neighborhood {
    /// Whether a posture of measure `s` lies inside, given whether the one before did.
    ///
    /// D_si = { q : |s_i(q)| ≤ η_i }, η_i = η_out where the posture before was inside, else η_in     [CK95 Eq. 2]
    ///
    /// Units none · Ensures that a NaN is outside · Errors none · Cost O(1)
    #[must_use]
    #[inline]
    pub fn update(&self, was_inside: bool, s: f64) -> bool {
        s.abs()
            <= if was_inside {
                self.eta_out
            } else {
                self.eta_in
            }
    }

    /// Weight of operational control along ζ_i: 0 at |s| ≤ η_in, 1 at |s| ≥ η_out, continuously differentiable between.
    #[inline]
    pub fn openness(&self, s: f64) -> f64 {
        // Where both are the same the quotient is 0/0 there.
        if s.abs() <= self.eta_in {
            return 0.0;
        }
        crate::linear::smoothstep((s.abs() - self.eta_in) / (self.eta_out - self.eta_in))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const D: Neighborhood = Neighborhood {
        eta_in: 0.1,
        eta_out: 0.2,
    };

    // covers: CK95 Eq. 2 (neighborhood::Neighborhood::update)
    #[test]
    fn entry_and_exit_are_apart() {
        assert!(
            !D.update(false, 0.15) && D.update(true, 0.15),
            "between the thresholds nothing changes"
        );
        assert!(D.update(false, -0.1) && !D.update(true, -0.21));
    }

    #[test]
    fn openness_is_zero_inside_and_one_outside() {
        assert_eq!(
            [
                D.openness(0.05),
                D.openness(-0.1),
                D.openness(0.2),
                D.openness(-0.5)
            ],
            [0.0, 0.0, 1.0, 1.0]
        );
        assert!((D.openness(-0.15) - 0.5).abs() < 1e-15);
        let sharp = Neighborhood {
            eta_in: 0.0,
            eta_out: 0.0,
        };
        assert_eq!([sharp.openness(0.0), sharp.openness(1e-9)], [0.0, 1.0]);
        assert!(D.openness(f64::NAN).is_nan());
    }
}
