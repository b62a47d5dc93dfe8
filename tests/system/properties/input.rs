//! Messages and choices from any bytes.

use bytemuck::Pod;
use process::Packed;
use shared_types::wire::{Field, Part, Stamps};
use shared_types::{Layout, SingularityState, TargetContent};

/// Fills messages from bytes, and with zeros where they end.
pub(super) struct Bytes<'a>(pub(super) &'a [u8]);

impl Bytes<'_> {
    pub(super) fn next<M: Pod>(&mut self) -> M {
        let mut message = M::zeroed();
        self.fill(bytemuck::bytes_of_mut(&mut message));
        message
    }

    pub(super) fn fill(&mut self, message: &mut [u8]) {
        let n = self.0.len().min(message.len());
        message[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
    }
}

/// Where the numbers of a message lie, in bytes from its start.
pub(super) fn numbers<M: Layout>() -> Vec<usize> {
    fn of(fields: &[Field], begin: usize, found: &mut Vec<usize>) {
        for field in fields {
            let at = begin + field.offset;
            if field.type_name.contains("SingularityState") {
                let each = (at..at + field.size).step_by(size_of::<SingularityState>());
                each.for_each(|begin| of(SingularityState::FIELDS, begin, found));
            } else if field.type_name.contains("TargetContent") {
                of(TargetContent::FIELDS, at, found);
            } else if field.type_name.contains("f64") {
                found.extend((at..at + field.size).step_by(8));
            }
        }
    }
    let mut found = Vec::new();
    of(M::FIELDS, 0, &mut found);
    found
}

/// Takes choices from bytes; zeros where they end.
pub(super) struct Hand<'a>(pub(super) &'a [u8]);

impl Hand<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut taken = [0; N];
        let n = self.0.len().min(N);
        taken[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        taken
    }

    pub(super) fn byte(&mut self) -> u8 {
        self.take::<1>()[0]
    }

    /// A number at the limits of its type, or the old one moved, or any.
    pub(super) fn number(&mut self, old: f64) -> f64 {
        const HARD: [f64; 16] = [
            0.0,
            -0.0,
            1e-310,
            f64::EPSILON,
            1.0,
            -1.0,
            std::f64::consts::PI,
            1e6,
            -1e9,
            1e18,
            1e154,
            -1e200,
            f64::MAX,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
        ];
        let how = self.byte();
        match how >> 6 {
            0 => HARD[how as usize % HARD.len()],
            1 => old * HARD[how as usize % HARD.len()],
            2 => old + (f64::from(how & 63) - 31.5) * 1e-3,
            _ => f64::from_ne_bytes(self.take()),
        }
    }

    /// Puts a number somewhere in a message, stamps left out: no computation reads them.
    pub(super) fn corrupt(&mut self, message: &mut Packed) {
        self.spoil_words(message, size_of::<Stamps>() / 8);
    }

    /// Puts a number somewhere behind the first words.
    pub(super) fn spoil_words(&mut self, message: &mut Packed, first: usize) {
        let words: &mut [u64] = bytemuck::cast_slice_mut(message.bytes_mut());
        let words = &mut words[first..];
        for _ in 0..=self.byte() % 4 {
            let place = u16::from_ne_bytes(self.take()) as usize % words.len();
            words[place] = self.number(f64::from_bits(words[place])).to_bits();
        }
    }
}
