//! Singularities during a run: distance, duration, modes and errors.

use nalgebra::Vector3;
use shared_types::SingularityState;
use shared_types::bounds::{larger, smaller, within};
use shared_types::codes::{self, MODE_HOLD, MODE_REGULAR, MODE_SLIDE};
use shared_types::scenario::Goal;
use shared_types::summary::{ModeChange, SingularitySummary};

use super::task::TaskError;
use super::tick::{Tick, halves};

/// Gathers figures for each singularity.
#[derive(Debug, Default)]
pub(super) struct SingularityMeter {
    watched: Vec<Watched>,
    modes: Vec<ModeChange>,
}

#[derive(Debug)]
struct Watched {
    summary: SingularitySummary,
    mode: u32,
    inside: bool,
    /// ζ when the neighbourhood was entered last.
    zeta_at_entry: [f64; 3],
    /// The first tick of the first hold that costs more than the goal allows.
    held_from: Option<u64>,
    /// Whether such a hold is under way.
    is_held: bool,
    /// Error along the singular directions at the latest tick, mm and degrees, where it is beyond the goal's bounds inside the neighbourhood.
    left: Option<[f64; 2]>,
}

impl SingularityMeter {
    /// Takes in a tick; each beginning of a hold that costs more than the goal allows goes into `events`. Returns the changes of mode.
    pub(super) fn tick(
        &mut self,
        tick: &Tick<'_>,
        error: &TaskError,
        goal: &Goal,
        mut events: impl FnMut(String),
    ) -> usize {
        let before = self.modes.len();
        for (i, singularity) in tick.report.listed().iter().enumerate() {
            if self.watched.len() <= i {
                let name = codes::singularity_name(singularity.kind, i).to_owned();
                self.watched.push(Watched::new(name));
            }
            let watched = &mut self.watched[i];
            watched.measure(singularity);
            let mode = tick.control.mode[i];
            if mode != watched.mode {
                watched.mode = mode;
                self.modes.push(ModeChange {
                    tick: tick.torque.header.tick,
                    singularity: watched.summary.name.clone(),
                    mode: codes::name_of(codes::MODES, mode).to_owned(),
                });
            }
            watched.hold(tick.torque.header.tick, error, goal, &mut events);
        }
        self.modes.len() - before
    }

    /// One clause for each singularity at which a hold cost more than the goal allows.
    pub(super) fn clauses(&self) -> impl Iterator<Item = String> {
        self.watched.iter().filter_map(|watched| {
            let SingularitySummary { name, hold_ticks, hold_max_mm, hold_max_deg, .. } = &watched.summary;
            let from = watched.held_from?;
            Some(format!(
                "held at the {name} singularity for {hold_ticks} ticks from tick {from} on, up to {hold_max_mm:.3} mm and {hold_max_deg:.3}° \
                 off along the singular directions"
            ))
        })
    }

    /// One clause for each singularity in whose neighbourhood the run ended without a hold, too far off along its direction.
    pub(super) fn ends(&self) -> impl Iterator<Item = String> {
        self.watched.iter().filter(|watched| watched.held_from.is_none()).filter_map(|watched| {
            let [mm, deg] = watched.left?;
            let name = &watched.summary.name;
            Some(format!(
                "the run ended inside the {name} singularity's neighbourhood, {mm:.3} mm and {deg:.3}° off along the singular directions"
            ))
        })
    }

    pub(super) fn finish(self) -> (Vec<SingularitySummary>, Vec<ModeChange>) {
        (
            self.watched
                .into_iter()
                .map(|watched| watched.summary)
                .collect(),
            self.modes,
        )
    }
}

impl Watched {
    fn new(name: String) -> Self {
        Self {
            summary: SingularitySummary {
                name,
                s_min: f64::INFINITY,
                ..SingularitySummary::default()
            },
            mode: MODE_REGULAR,
            inside: false,
            zeta_at_entry: [0.0; 3],
            held_from: None,
            is_held: false,
            left: None,
        }
    }

    fn measure(&mut self, singularity: &SingularityState) {
        let summary = &mut self.summary;
        let inside = singularity.inside != 0;
        summary.s_min = smaller(summary.s_min, singularity.s.abs());
        codes::name_of(codes::TYPES, singularity.class).clone_into(&mut summary.class);
        summary.kappa_1 = singularity.kappa_1;
        summary.kappa_2 = singularity.kappa_2;
        if inside {
            let (linear, angular) = halves(&singularity.zeta_B);
            let zeta = match singularity.angular {
                0 => linear,
                _ => angular,
            };
            if !self.inside {
                summary.entries += 1;
                self.zeta_at_entry = zeta.into();
            }
            summary.inside_ticks += 1;
            let entry = Vector3::from(self.zeta_at_entry);
            let turned = libm::atan2(entry.cross(&zeta).norm(), entry.dot(&zeta)).to_degrees();
            summary.zeta_turned_deg = larger(summary.zeta_turned_deg, turned);
        }
        self.inside = inside;
    }

    /// A hold whose error along the singular directions is beyond the goal's final bounds.
    fn hold(&mut self, tick: u64, error: &TaskError, goal: &Goal, events: &mut impl FnMut(String)) {
        let mm = error.position[2];
        let deg = error.orientation[2];
        let is_cheap = within(mm, goal.position_mm) && within(deg, goal.orientation_deg);
        self.left = (self.inside && !is_cheap).then_some([mm, deg]);
        let is_held = [MODE_HOLD, MODE_SLIDE].contains(&self.mode) && !is_cheap;
        if is_held {
            let summary = &mut self.summary;
            summary.hold_ticks += 1;
            summary.hold_max_mm = larger(summary.hold_max_mm, mm);
            summary.hold_max_deg = larger(summary.hold_max_deg, deg);
            if !self.is_held {
                events(format!(
                    "the law holds at the {} singularity: the goal's bounds are exceeded along it",
                    summary.name
                ));
            }
            self.held_from.get_or_insert(tick);
        }
        self.is_held = is_held;
    }
}
