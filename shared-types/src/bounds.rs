//! Comparisons that decide an outcome. A NaN fails all of them: it is within no bound, and it is
//! both the largest and the smallest value.

/// Whether `value` is at most `bound`; false if either is NaN.
#[inline]
#[must_use]
pub fn within(value: f64, bound: f64) -> bool {
    value <= bound
}

/// The larger of two values; NaN if either is NaN (`f64::max` drops it).
#[inline]
#[must_use]
pub fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// The smaller of two values; NaN if either is NaN (`f64::min` drops it).
#[inline]
#[must_use]
pub fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

/// |value| as a share of `limit`; 0 of an infinite limit, NaN for a value that is not finite there.
#[inline]
#[must_use]
pub fn share(value: f64, limit: f64) -> f64 {
    if limit.is_infinite() && value.is_finite() {
        0.0
    } else {
        value.abs() / limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_fails_every_comparison() {
        const NAN: f64 = f64::NAN;
        let pairs = [(NAN, 1.0), (1.0, NAN), (NAN, NAN)];
        for (a, b) in pairs {
            assert!(!within(a, b) && larger(a, b).is_nan() && smaller(a, b).is_nan());
        }
        assert!(within(1.0, 1.0) && !within(1.1, 1.0) && !within(f64::INFINITY, 1.0));
        assert_eq!([larger(-1.0, 1.0), larger(2.0, 1.0)], [1.0, 2.0]);
        assert_eq!([smaller(-1.0, 1.0), smaller(2.0, 1.0)], [-1.0, 1.0]);
        assert!([3.0, NAN, 1.0].into_iter().fold(0.0, larger).is_nan());
        assert_eq!((share(-3.0, 6.0), share(3.0, f64::INFINITY)), (0.5, 0.0));
        assert!(
            [NAN, f64::INFINITY]
                .iter()
                .all(|x| share(*x, f64::INFINITY).is_nan())
        );
    }
}
