//! The checkpoint of followed directions.

use super::{Entry, LostDirections};
use crate::arm_family::classify::Verdict;
use crate::types::Class;
use model::{joints, padded};
use shared_types::AnalyzerCheckpoint;
use shared_types::checkpoints::PlaceCheckpoint;

impl<const N: usize> LostDirections<N> {
    /// Writes what must survive a restart.
    pub(in crate::arm_family) fn save(&self, out: &mut AnalyzerCheckpoint) {
        out.blocks[0] = self.block.checkpoint();
        for (out, entry) in out.places.iter_mut().zip(&self.entries) {
            *out = PlaceCheckpoint {
                index: entry.index as u32,
                place: entry.place as u32,
                class: entry.verdict.class.code(),
                angular: u32::from(entry.angular),
                latched: u32::from(entry.latched),
                flipped: u32::from(entry.flipped),
                kappa_1: entry.verdict.kappa_1,
                kappa_2: entry.verdict.kappa_2,
                direction: padded(&entry.a),
            };
        }
    }

    /// Takes up what [`save`](Self::save) has written.
    pub(in crate::arm_family) fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.block.restore(&from.blocks[0]);
        for (entry, from) in self.entries.iter_mut().zip(&from.places) {
            let class = Class::from_code(from.class);
            // Without a type that exists it is classified again.
            let (angular, latched, flipped) = (
                from.angular != 0,
                from.latched != 0 && class.is_some(),
                from.flipped != 0,
            );
            *entry = Entry {
                index: (from.index as usize).min(self.block.count.saturating_sub(1)),
                place: (from.place as usize).min(self.place_count.saturating_sub(1)),
                angular,
                latched,
                settled: latched,
                flipped,
                verdict: Verdict {
                    class: class.unwrap_or(Class::Unknown),
                    kappa_1: from.kappa_1,
                    kappa_2: from.kappa_2,
                    distance: 0.0,
                },
                a: joints(&from.direction),
            };
        }
    }
}
