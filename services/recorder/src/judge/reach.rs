//! How far the path lies beyond the arm's reach, by the truth alone.

use control::{GroundTruth, Progress};
use shared_types::PlantState;
use shared_types::bounds::within;

/// A tick at a fold with the desired pose outwards of it.
#[derive(Clone, Copy, Debug)]
struct Outwards {
    /// Position error, mm.
    mm: f64,
    /// The place on the path; `None` in a steered run.
    place: Option<Progress>,
    posture: PlantState,
}

impl Outwards {
    /// Whether no posture has the desired pose.
    fn is_beyond(&self, truth: &dyn GroundTruth) -> bool {
        self.place
            .as_ref()
            .is_none_or(|place| !truth.reaches(place, &self.posture))
    }
}

/// Gathers the errors that point outwards at a fold.
#[derive(Debug, Default)]
pub(super) struct ReachMeter {
    worst: Option<Outwards>,
    /// The newest tick, if it is one.
    last: Option<Outwards>,
    /// Ticks with more than the bound.
    ticks: u64,
}

/// The part of a run that lay beyond reach.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Beyond {
    /// Largest distance of the path from the hand beyond the boundary, mm.
    pub(super) most_mm: f64,
    /// Ticks at which it was more than the bound.
    pub(super) ticks: u64,
    /// Whether the run ended there.
    pub(super) at_end: bool,
    /// Largest such distance that was within reach after all, mm: an error along ζ like any other.
    pub(super) within_mm: f64,
}

impl ReachMeter {
    /// Takes in a tick: its position error, whether it points outwards at a fold, and the place on the path; up to `bound_mm` it does not count.
    pub(super) fn tick(
        &mut self,
        mm: f64,
        is_outwards: bool,
        place: Option<Progress>,
        posture: &PlantState,
        bound_mm: f64,
    ) {
        self.last = None;
        if !is_outwards || within(mm, bound_mm) {
            return;
        }
        let here = Outwards {
            mm,
            place,
            posture: *posture,
        };
        self.ticks += 1;
        self.last = Some(here);
        if self.worst.is_none_or(|worst| mm > worst.mm) {
            self.worst = Some(here);
        }
    }

    /// The findings: whether the farthest place, and that of the end, can be reached is asked here alone, because it takes a search.
    pub(super) fn finish(&self, truth: &dyn GroundTruth) -> Beyond {
        let Some(worst) = self.worst else {
            return Beyond::default();
        };
        if !worst.is_beyond(truth) {
            return Beyond {
                within_mm: worst.mm,
                ..Beyond::default()
            };
        }
        Beyond {
            most_mm: worst.mm,
            ticks: self.ticks,
            at_end: self.last.is_some_and(|last| last.is_beyond(truth)),
            within_mm: 0.0,
        }
    }
}
