//! The controller's telemetry of each singularity.

use crate::continuous::auxiliary::{Demand, Loop};
use crate::paper::reference::Target;
use crate::types::{Mode, Singularity};
use shared_types::MAX_SINGULARITIES;

/// Telemetry by place in the report.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Telemetry {
    pub(crate) beta: [f64; MAX_SINGULARITIES],
    pub(crate) aux_d: [f64; MAX_SINGULARITIES],
    pub(crate) aux_rate_d: [f64; MAX_SINGULARITIES],
    pub(crate) mode: [Mode; MAX_SINGULARITIES],
    pub(crate) clipped: bool,
}

impl Default for Telemetry {
    fn default() -> Self {
        Self {
            beta: [1.0; MAX_SINGULARITIES],
            aux_d: [0.0; MAX_SINGULARITIES],
            aux_rate_d: [0.0; MAX_SINGULARITIES],
            mode: [Mode::Regular; MAX_SINGULARITIES],
            clipped: false,
        }
    }
}

impl Telemetry {
    #[inline]
    pub(crate) fn note<const N: usize>(
        &mut self,
        i: usize,
        state: &Loop,
        s: &Singularity<N>,
        target: &Target,
        demand: &Demand,
    ) {
        self.beta[i] = demand.beta;
        self.aux_d[i] = s.aux + target.error * target.weight;
        self.aux_rate_d[i] = state.rate;
        self.mode[i] = state.mode;
        self.clipped |= state.engaged() && target.clipped;
    }
}
