//! Step 2 of a tick: for each singularity the target by its type, the mode by the transition table, and the auxiliary loop's demand.

use crate::arm_family::choice::Family;
use crate::arm_family::family::Situation;
use crate::continuous::auxiliary::Gains;
use crate::continuous::guide::{Guide, WAIT};
use crate::continuous::turn_plan;
use crate::law::{Active, Actives, LawError};
use crate::paper::reference::{Memory, Target};
use crate::paper::{type_1, type_2};
use crate::state::State;
use crate::telemetry::Telemetry;
use crate::tick::{Auxiliary, Inputs, Motion};
use crate::trajectory::Path;
use crate::types::{Class, Kind, Mode, Report, Singularity};
use model::Model;
use shared_types::scenario::{Control, Strategy};

/// Share of a joint's speed that the self-motion at a singularity may take.
const JOINT_SHARE: f64 = 0.5;

/// The arm, the path and the terms of one tick's auxiliary coordinates.
pub(crate) struct Coordinates<'a, const N: usize> {
    pub(crate) model: &'a Model<N>,
    pub(crate) family: &'a Family<N>,
    pub(crate) path: &'a Path,
    pub(crate) guide: &'a Guide<N>,
    pub(crate) task: [bool; 6],
    pub(crate) control: &'a Control,
    /// Length of a tick, s.
    pub(crate) dt_s: f64,
}

impl<const N: usize> Coordinates<'_, N> {
    /// Step 2: for each singularity, the target by its type, the mode by the transition table, and the auxiliary loop's demand.
    pub(crate) fn step(
        &self,
        state: &mut State<N>,
        now: &Inputs<'_, N>,
        motion: &Motion<N>,
    ) -> Result<Auxiliary<N>, LawError> {
        self.check_rank(now.report)?;
        let control = self.control;
        let ahead = self.path.ahead(&state.progress, *now.p_EC);
        let planned = state.qdot_planned;
        let mut out = Auxiliary {
            actives: Actives::none(),
            telemetry: Telemetry::default(),
            load: 0.0,
        };
        for (i, singularity) in now.report.listed().iter().enumerate() {
            let kind = singularity.kind.code();
            let rate_max = self.rate_max(i, singularity);
            let situation = Situation {
                q: now.q,
                qdot_planned: &planned,
                terms: now.terms,
                at: now.at,
                desired: &motion.desired,
                V_nominal: &motion.V_nominal,
                ahead: &ahead,
                error: &motion.error,
                lower: self.model.lower(),
                upper: self.model.upper(),
                rate_max,
                governed: control.governor,
                clips: motion.clips,
            };
            let target = self.strategy(i, singularity, state, &situation, (now, motion))?;
            let gains = Gains {
                k: control.k_aux,
                k_v: control.k_v,
                rate_max,
                slew: control.aux_slew.of(kind),
            };
            let one = &mut state.loops[i];
            let demand = match control.strategy {
                Strategy::ChangKhatib => {
                    one.step_switched(singularity, &target, &gains, motion.clock, self.dt_s)
                }
                _ => one.step(singularity, &target, &gains, motion.clock, self.dt_s),
            };
            if self.control.strategy.is_ours() {
                out.load = out.load.max(demand.load);
                if motion.planned.is_some() {
                    out.load = out.load.max(Guide::<N>::waiting(target.error, demand.beta));
                }
                // While a neighbourhood is left along the self-motion, or ζ turned out of the way, the path waits.
                if one.mode == Mode::Pass && self.has_higher_codimension(i) {
                    out.load = out.load.max(WAIT * (1.0 - demand.beta));
                }
            }
            out.telemetry.note(i, one, singularity, &target, &demand);
            if one.engaged() {
                out.actives.push(Active {
                    zeta_B: singularity.zeta_B,
                    gain: singularity.gain,
                    beta: demand.beta,
                    aux_row: singularity.aux_row,
                    aux_acceleration: demand.acceleration - singularity.aux_bias,
                    aux_rate: demand.nominal,
                });
            }
        }
        Ok(out)
    }

    /// The target of one singularity: of a commanded turn of ζ, of the planned posture, or of the strategy that its type asks for.
    fn strategy(
        &self,
        place: usize,
        s: &Singularity<N>,
        state: &mut State<N>,
        situation: &Situation<'_, N>,
        (now, motion): (&Inputs<'_, N>, &Motion<N>),
    ) -> Result<Target, LawError> {
        let commanded = motion.leg.and_then(|leg| {
            leg.reorient
                .map(|(place, angle)| (place, angle, leg.duration_s))
        });
        let branch = motion.leg.map_or(0, |leg| leg.branch) + state.servo.branch();
        let memory = &mut state.loops[place].memory;
        let target = match &motion.planned {
            // A fold with a formula keeps it; the plan decides its side.
            Some(_) if s.class == Class::Type1 && self.has_formula(place, s) => {
                memory.side = self
                    .guide
                    .side(s, now.q, state.route_time_s)
                    .unwrap_or(memory.side);
                self.by_type(s, situation, 0, memory)
            }
            Some(planned) => self.guide.target(s, planned, now.q, motion.clock),
            None => self.by_type(s, situation, branch, memory),
        };
        match commanded {
            Some((turned, angle, duration_s)) if turned == place => {
                self.reorient(state, now, s, angle, duration_s)
            }
            // A planned leg lies within reach: what the formula of a fold misses there is tracking error.
            _ => Ok(Target {
                clipped: target.clipped && motion.planned.is_none(),
                ..target
            }),
        }
    }

    /// Whether a formula of the arm's family gives the singularity at a place of the report.
    fn has_formula(&self, place: usize, s: &Singularity<N>) -> bool {
        s.kind != Kind::Numeric && !self.has_higher_codimension(place)
    }

    /// Whether the singularity at a place of the report has codimension two or more, so that a self-motion leads around it.
    fn has_higher_codimension(&self, place: usize) -> bool {
        self.family
            .get()
            .first_of_higher_codimension()
            .is_some_and(|first| place >= first)
    }

    /// Largest auxiliary rate, rad/s: the scenario's, and for the self-motion of an arm with spare joints a share of what the joints have.
    #[inline]
    pub(crate) fn rate_max(&self, place: usize, s: &Singularity<N>) -> f64 {
        let stated = self.control.aux_rate_max.of(s.kind.code());
        if !self.has_higher_codimension(place) {
            return stated;
        }
        // As fast as a joint may be where only it moves.
        let size = s.aux_row.norm_squared().max(1e-12);
        (0..N).fold(stated, |rate, i| {
            rate.min(JOINT_SHARE * self.model.velocity()[i] * size / s.aux_row[i].abs().max(1e-9))
        })
    }

    /// The target of one auxiliary coordinate: the computed type decides the strategy, for every arm.
    fn by_type(
        &self,
        s: &Singularity<N>,
        at: &Situation<'_, N>,
        branch: i32,
        memory: &mut Memory,
    ) -> Target {
        if memory.side == 0.0 {
            memory.side = if s.s < 0.0 { -1.0 } else { 1.0 };
        }
        let family = self.family.get();
        match s.class {
            Class::Type1 => family.fold(s, at).map_or_else(
                || type_2::target(None),
                |fold| type_1::target(&fold, branch, memory),
            ),
            Class::Type2 | Class::Mixed => type_2::target(family.direction(s, at, memory)),
            Class::Unknown => type_2::target(None),
        }
    }

    /// ζ turned by a commanded profile; the joint motion is predicted and published before the arm moves.
    fn reorient(
        &self,
        state: &mut State<N>,
        now: &Inputs<'_, N>,
        s: &Singularity<N>,
        angle: f64,
        duration_s: f64,
    ) -> Result<Target, LawError> {
        if state.turn.duration_s == 0.0 {
            let motion = |angle: f64| {
                self.family
                    .get()
                    .turning(s, now.terms, &now.report.p_BC, angle)
            };
            let room = turn_plan::Room {
                q: now.q,
                model: self.model,
                control: self.control,
            };
            state.turn = turn_plan::plan(s, angle, duration_s, &room, motion)?;
        }
        let [share, share_rate, _] = self.path.fraction(&state.progress);
        Ok(state.turn.target(s, share, share_rate, state.governor.rate))
    }

    /// Whether the listed singularities explain the rank: each takes one direction.
    ///
    /// # Errors
    /// [`LawError::Unlisted`] where more directions are lost than singularities are inside their neighbourhoods.
    fn check_rank(&self, report: &Report<N>) -> Result<(), LawError> {
        let full = self.task.iter().filter(|counts| **counts).count().min(N);
        let listed = report.listed().iter().filter(|s| s.inside).count();
        if self.control.strategy.is_ours() && report.rank as usize + listed < full {
            return Err(LawError::Unlisted {
                rank: report.rank,
                listed,
            });
        }
        Ok(())
    }
}
