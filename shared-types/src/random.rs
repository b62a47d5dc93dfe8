//! Seeded random numbers: the one SplitMix64 of the workspace, the same on every machine.
//!
//! Steele, Lea & Flood, *Fast Splittable Pseudorandom Number Generators*, OOPSLA 2014.

/// 2⁶⁴ divided by the golden ratio: the step of the sequence.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A bijection of 64 bits with full avalanche.
#[inline]
fn finalise(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The number after `state`: one step and one bijection.
#[must_use]
#[inline]
pub fn mix(state: u64) -> u64 {
    finalise(state.wrapping_add(GOLDEN))
}

/// The number at `index` of the sequence that begins at `seed`: any place of it without those before.
#[must_use]
pub fn at(seed: u64, index: u64) -> u64 {
    finalise(seed.wrapping_add(index.wrapping_mul(GOLDEN)))
}

/// A sequence of uniform numbers; the field is its state.
#[derive(Clone, Copy, Debug)]
pub struct Uniform(pub u64);

impl Uniform {
    /// The next number in [low, high), with 53 random bits.
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        let bits = mix(self.0);
        self.0 = self.0.wrapping_add(GOLDEN);
        low + (high - low) * (bits >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first numbers of the reference implementation for seed 1234567 (Vigna, splitmix64.c).
    #[test]
    fn the_sequence_is_the_published_one() {
        let published = [
            6_457_827_717_110_365_317_u64,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
        ];
        assert_eq!([1, 2, 3].map(|index| at(1_234_567, index)), published);
        assert_eq!(mix(1_234_567), published[0]);
    }

    #[test]
    fn numbers_are_within_their_bounds_and_spread() {
        let mut random = Uniform(3);
        let values: Vec<f64> = (0..10_000).map(|_| random.within(-2.0, 3.0)).collect();
        assert!(values.iter().all(|x| (-2.0..3.0).contains(x)));
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        // Standard error 5/√12/100 = 0.0144; five of them.
        assert!((mean - 0.5).abs() < 0.08, "{mean}");
    }
}
