//! Analytic factors of det J.

/// An analytic factorisation of det J, if one holds.
///
/// Checked against the geometry when the robot is loaded, so a robot that carries one obeys it.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields, tag = "kind", rename_all = "lowercase")]
pub enum Factors {
    /// det J = a2·(d4·c3 − a3·s3)·(a2·c2 + a3·c23 + d4·s23)·s5: elbow, overhead, wrist (modified DH, Craig's zero).
    Puma {
        /// Upper arm, m.
        a2: f64,
        /// Elbow offset, m.
        a3: f64,
        /// Forearm, m.
        d4: f64,
    },
    /// None known: singularities are found numerically.
    #[default]
    #[serde(skip)]
    Numeric,
}

impl Factors {
    /// det J(q) by the factorisation, m³ (`None` without one, or for fewer than six joints).
    pub fn determinant(&self, q: &[f64]) -> Option<f64> {
        match (*self, q) {
            (Factors::Puma { a2, a3, d4 }, &[_, q2, q3, _, q5, ..]) => {
                let (s3, c3) = libm::sincos(q3);
                let (s23, c23) = libm::sincos(q2 + q3);
                let elbow = d4 * c3 - a3 * s3;
                let overhead = a2 * libm::cos(q2) + a3 * c23 + d4 * s23;
                Some(a2 * elbow * overhead * libm::sin(q5))
            }
            _ => None,
        }
    }
}
