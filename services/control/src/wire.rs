//! Messages from values and back: shared by the analyzer's and the controller's cycle.

use crate::linear::{Matrix3, Vector3, Vector6};
use crate::types::{Class, Command, Kind, Report, Singularity};
use model::{joints, padded};
use shared_types::wire::Part;
use shared_types::{
    ControlState, Header, MAX_DOF, MAX_SINGULARITIES, SingularityReport, SingularityState,
    TorqueCommand,
};

/// Fills the analyzer's message: everything but the header's stamps and incarnation.
pub fn report_message<const N: usize>(tick: u64, report: &Report<N>, out: &mut SingularityReport) {
    // In place: a message of its own would be copied whole.
    let SingularityReport {
        header,
        count,
        rank,
        det,
        manipulability,
        length_m,
        p_BC,
        singularities,
    } = out;
    *header = Header {
        tick,
        ..Header::default()
    };
    (*count, *rank, *det) = (report.count as u32, report.rank, report.det);
    (*manipulability, *length_m, *p_BC) =
        (report.manipulability, report.length_m, report.p_BC.into());
    for (out, s) in singularities.iter_mut().zip(&report.singularities) {
        *out = SingularityState {
            kind: s.kind.code(),
            class: s.class.code(),
            inside: u32::from(s.inside),
            angular: u32::from(s.angular),
            s: s.s,
            s_rate: s.s_rate,
            eta_in: s.eta_in,
            eta_out: s.eta_out,
            zeta_B: s.zeta_B.into(),
            R_BS: column_major(&s.R_BS),
            gain: s.gain,
            aux: s.aux,
            aux_rate: s.aux_rate,
            aux_bias: s.aux_bias,
            aux_row: padded(&s.aux_row),
            kappa_1: s.kappa_1,
            kappa_2: s.kappa_2,
        };
    }
}

/// The report in a message; `None` where a kind or a type has no name, because the sender speaks another version of the wire, or a number is not finite.
pub fn report<const N: usize>(message: &SingularityReport) -> Option<Report<N>> {
    if !message.is_finite() {
        return None;
    }
    let mut report = Report {
        rank: message.rank,
        det: message.det,
        manipulability: message.manipulability,
        length_m: message.length_m,
        p_BC: Vector3::from(message.p_BC),
        count: (message.count as usize).min(MAX_SINGULARITIES),
        singularities: [Singularity::none(); MAX_SINGULARITIES],
    };
    for (out, s) in report.singularities.iter_mut().zip(&message.singularities) {
        *out = Singularity {
            kind: Kind::from_code(s.kind)?,
            class: Class::from_code(s.class)?,
            inside: s.inside != 0,
            angular: s.angular != 0,
            s: s.s,
            s_rate: s.s_rate,
            eta_in: s.eta_in,
            eta_out: s.eta_out,
            zeta_B: Vector6::from(s.zeta_B),
            other: Vector3::zeros(),
            R_BS: Matrix3::from_column_slice(&s.R_BS),
            gain: s.gain,
            askew: 0.0,
            aux: s.aux,
            aux_rate: s.aux_rate,
            aux_bias: s.aux_bias,
            aux_row: joints(&s.aux_row),
            kappa_1: s.kappa_1,
            kappa_2: s.kappa_2,
        };
    }
    Some(report)
}

/// Fills the controller's messages: everything but the headers' stamps and incarnation.
pub fn command_messages<const N: usize>(
    tick: u64,
    command: &Command<N>,
    state: &mut ControlState,
    torque: &mut TorqueCommand,
) {
    let header = Header {
        tick,
        ..Header::default()
    };
    *state = ControlState {
        header,
        tau_task: padded(&command.tau_task),
        tau_null: padded(&command.tau_null),
        p_BE_d: command.X_BE_d.p.into(),
        R_BE_d: column_major(&command.X_BE_d.R),
        V_BE_d: command.V_BE_d.into(),
        error: command.error.into(),
        path_time_s: command.path_time_s,
        time_scale: command.time_scale,
        null_scale: command.limited.null_scale,
        task_scale: command.limited.task_scale,
        beta: command.beta,
        aux_d: command.aux_d,
        aux_rate_d: command.aux_rate_d,
        planned_dq: command.plan.map_or([0.0; MAX_DOF], |plan| padded(&plan.by)),
        planned_s: command.plan.map_or(0.0, |plan| plan.duration_s),
        mode: command.mode.map(|mode| mode.code()),
        segment: command.segment,
        clipped: u32::from(command.clipped),
        planned: command.plan.map_or(0, |plan| plan.place as u32 + 1),
        refusal: command.refusal.code(),
        rate_mask: command.limited.rate_mask,
        rejected_ticks: command.rejected_ticks,
    };
    *torque = TorqueCommand {
        header,
        tau: padded(&command.tau),
        phase: command.phase.code(),
        saturation_mask: command.limited.saturation_mask,
    };
}

fn column_major(R: &Matrix3) -> [f64; 9] {
    std::array::from_fn(|i| R[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::Joints;
    use crate::singularity::analyzer::Analyzer;
    use crate::testing::{posture, puma, robot};
    use proptest::prelude::*;
    use shared_types::scenario::Analysis;

    proptest! {
        #[test]
        fn a_report_survives_the_wire(q in posture(puma())) {
            let terms = puma().evaluate(&q, &Joints::zeros());
            let mut analyzer = Analyzer::<6>::new(robot("puma560"), &Analysis::default());
            let sent = analyzer.step(&q, &Joints::zeros(), &terms);
            let mut message = SingularityReport::default();
            report_message(7, &sent, &mut message);
            prop_assert_eq!(report::<6>(&message).unwrap(), sent);
        }
    }

    #[test]
    fn a_number_that_is_not_finite_and_a_code_of_another_version_are_refused() {
        let mut messages = [SingularityReport::default(); 4];
        messages[0].singularities[MAX_SINGULARITIES - 1].gain = f64::NAN;
        messages[1].singularities[2].class = 77;
        messages[2].singularities[0].kind = 77;
        assert!(messages[..3].iter().all(|one| report::<6>(one).is_none()));
        assert!(report::<6>(&messages[3]).is_some());
    }
}
