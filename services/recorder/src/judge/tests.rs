//! Verdicts on made-up runs.

use control::{GroundTruth, Progress};
use nalgebra::Vector6;
use shared_types::codes;
use shared_types::scenario::Goal;
use shared_types::topics::{ByTopic, Whole};
use shared_types::{AnalyzerCheckpoint, PlantState, SingularityReport};

use super::latency::Span;
use super::{Judge, Limits, Tick, Verdict};

const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// A truth that takes the analyzer's report for its own, of a run without a path.
#[derive(Debug, Default)]
struct Reported {
    zeta: Vec<Vector6<f64>>,
}

impl Reported {
    fn truth() -> Box<dyn GroundTruth> {
        Box::new(Self::default())
    }
}

impl GroundTruth for Reported {
    fn start(&self) -> Option<Progress> {
        None
    }
    fn duration_s(&self) -> f64 {
        0.0
    }
    fn analyse(&mut self, _: &PlantState, reported: &SingularityReport) {
        let listed = reported.singularities.iter().take(reported.count as usize);
        let inside = listed.filter(|one| one.inside != 0);
        self.zeta = inside.map(|one| Vector6::from(one.zeta_B)).collect();
    }
    fn advance(&self, _: &mut Progress, _: f64) -> Option<usize> {
        None
    }
    fn error(&self, _: &Progress, _: &PlantState) -> Vector6<f64> {
        Vector6::zeros()
    }
    fn orthogonal(&self, error: &Vector6<f64>) -> Vector6<f64> {
        self.zeta
            .iter()
            .fold(*error, |rest, zeta| rest - zeta * zeta.dot(&rest))
    }
    fn is_beyond(&self, _: &Vector6<f64>) -> bool {
        !self.zeta.is_empty()
    }
    fn response(&self, _: &[f64]) -> f64 {
        0.0
    }
    fn save(&self, _: &mut AnalyzerCheckpoint) {}
    fn restore(&mut self, _: &AnalyzerCheckpoint) {}
}

fn limits() -> Limits {
    let names = (1..=6).map(|i| format!("joint{i}")).collect();
    Limits {
        served: [true; 6],
        names,
        lower: vec![-3.0; 6],
        upper: vec![3.0; 6],
        effort: vec![10.0; 6],
        velocity: vec![2.0; 6],
    }
}

fn judged(ticks: u64, shape: impl Fn(u64, &mut ByTopic<Whole>)) -> Verdict {
    let mut judge = Judge::of(Reported::truth(), limits(), Goal::default(), ticks as f64);
    for k in 0..ticks {
        let mut m = upright(k);
        m.torque.phase = if k + 1 == ticks {
            codes::PHASE_DONE
        } else {
            codes::PHASE_RUNNING
        };
        shape(k, &mut m);
        judge.tick(Tick::of(&m.lent()).unwrap());
    }
    judge.verdict()
}

/// A tick of an arm whose end-effector has the base's orientation, as desired.
fn upright(tick: u64) -> ByTopic<Whole> {
    let mut m = ByTopic::<Whole>::default();
    (m.plant_state.R_BE, m.control_state.R_BE_d) = (IDENTITY, IDENTITY);
    (m.sensor.header.tick, m.plant_state.header.tick) = (tick, tick);
    (m.control_state.header.tick, m.torque.header.tick) = (tick, tick);
    m
}

#[test]
fn a_perfect_run_reaches_its_goal() {
    let verdict = judged(10, |_, _| ());
    assert_eq!(
        (verdict.outcome.as_str(), verdict.completed, verdict.ticks),
        ("goal reached", true, 10)
    );
}

#[test]
fn an_error_at_the_end_misses_the_goal_and_says_by_how_much() {
    let verdict = judged(10, |k, m| {
        m.plant_state.p_BE[0] = if k == 9 { 2e-3 } else { 0.0 }
    });
    assert_eq!(verdict.outcome, "goal missed");
    assert!(
        verdict
            .reason
            .contains("end position off by 2.000 mm, allowed 1 mm"),
        "{}",
        verdict.reason
    );
    assert!((verdict.task.position_max_mm - 2.0).abs() < 1e-12);
}

#[test]
fn an_error_along_the_singular_direction_is_not_across_it() {
    let verdict = judged(10, |k, m| {
        m.singularity.count = 1;
        m.singularity.singularities[0].zeta_B[0] = 1.0;
        m.singularity.singularities[0].inside = 1;
        m.control_state.mode[0] = codes::MODE_TRACK;
        m.plant_state.p_BE[0] = if k == 4 { 5e-3 } else { 0.0 };
    });
    assert!(verdict.task.position_max_mm > 4.9 && verdict.task.orthogonal_max_mm < 1e-12);
    assert_eq!(verdict.outcome, "goal reached");
    assert_eq!(
        (verdict.modes.len(), verdict.modes[0].mode.as_str()),
        (1, "track")
    );
}

#[test]
fn the_angle_through_which_zeta_turns_is_measured_from_the_entry() {
    let verdict = judged(91, |k, m| {
        m.singularity.count = 1;
        let angle = (k as f64).to_radians();
        let zeta = &mut m.singularity.singularities[0];
        (zeta.angular, zeta.inside, zeta.kind) = (1, 1, codes::KIND_WRIST);
        (zeta.zeta_B[3], zeta.zeta_B[4]) = (angle.cos(), angle.sin());
    });
    assert!((verdict.singularities[0].zeta_turned_deg - 90.0).abs() < 1e-9);
    assert_eq!(verdict.singularities[0].name, "wrist");
}

#[test]
fn a_switch_puts_in_the_power_that_jumps() {
    let verdict = judged(20, |k, m| {
        m.singularity.count = 1;
        m.control_state.mode[0] = if k >= 10 {
            codes::MODE_TRACK
        } else {
            codes::MODE_REGULAR
        };
        // 4 N·m at 0.5 rad/s against 1 N·m at 1 rad/s: 1 W for 25 ms.
        (m.torque.tau[0], m.torque.tau[1]) = if k >= 10 { (4.0, -1.0) } else { (0.0, 0.0) };
        (m.plant_state.qdot[0], m.plant_state.qdot[1]) = (0.5, 1.0);
    });
    assert_eq!(verdict.joints.switches, 1);
    assert!(
        (verdict.joints.switch_energy_j - 0.025).abs() < 1e-12,
        "{}",
        verdict.joints.switch_energy_j
    );
}

#[test]
fn a_turn_is_followed_from_its_announcement_to_its_end() {
    let verdict = judged(30, |k, m| {
        m.singularity.count = 2;
        m.singularity.singularities[1].kind = codes::KIND_WRIST;
        if (10..20).contains(&k) {
            (
                m.control_state.planned,
                m.control_state.planned_s,
                m.control_state.planned_dq[3],
            ) = (2, 0.009, 1.5);
        }
        m.plant_state.q[3] = 0.1 * k.clamp(10, 20) as f64;
    });
    let turn = &verdict.turns[0];
    assert_eq!(
        (verdict.turns.len(), turn.tick, turn.singularity.as_str()),
        (1, 10, "wrist")
    );
    assert!(
        (turn.actual_deg[3] - 1f64.to_degrees()).abs() < 1e-9 && turn.actual_ticks == 10,
        "{turn:?}"
    );
    assert!((turn.planned_deg[3] - 1.5f64.to_degrees()).abs() < 1e-9);
}

#[test]
fn a_turn_goes_on_after_ticks_that_only_bring_the_arm_to_rest() {
    let verdict = judged(30, |k, m| {
        m.singularity.count = 2;
        m.singularity.singularities[1].kind = codes::KIND_WRIST;
        if (10..20).contains(&k) && !(13..16).contains(&k) {
            (
                m.control_state.planned,
                m.control_state.planned_s,
                m.control_state.planned_dq[3],
            ) = (2, 0.009, 1.5);
        }
        m.plant_state.q[3] = 0.1 * k.clamp(10, 20) as f64;
    });
    let turn = &verdict.turns[0];
    assert_eq!(
        (verdict.turns.len(), turn.tick, turn.actual_ticks),
        (1, 10, 10)
    );
    assert!(
        (turn.actual_deg[3] - 1f64.to_degrees()).abs() < 1e-9,
        "{turn:?}"
    );
}

#[test]
fn a_refusal_says_why() {
    let verdict = judged(5, |_, m| {
        (m.torque.phase, m.control_state.refusal) = (codes::PHASE_REFUSED, codes::REFUSAL_ROOM)
    });
    assert!(
        verdict.reason.contains("the joints have no room for it"),
        "{}",
        verdict.reason
    );
}

#[test]
fn loads_are_ratios_and_steps_have_a_tail() {
    let verdict = judged(100, |k, m| {
        m.torque.tau[1] = if k == 50 { 5.0 } else { 0.0 };
        m.plant_state.qdot[2] = if k == 3 { -1.0 } else { 0.0 };
    });
    assert!(
        (verdict.joints.torque_commanded_max_ratio - 0.5).abs() < 1e-12
            && (verdict.joints.torque_step_max_ratio - 0.5).abs() < 1e-12
    );
    assert!((verdict.joints.speed_max_ratio - 0.5).abs() < 1e-12);
    assert!(
        verdict.joints.torque_step_p95_ratio < 1e-3,
        "two steps of a hundred lie above the 95th percentile"
    );
}

#[test]
fn latencies_come_from_the_stamps_and_an_unfinished_run_is_stopped() {
    let verdict = judged(10, |k, m| {
        let start = 1_000_000 * (k + 1);
        m.sensor.header.stamps.sent_ns[0] = start;
        m.sensor.header.stamps.received_ns[0] = start - 900_000;
        m.torque.header.stamps.sent_ns[0] = start;
        m.torque.header.stamps.received_ns[1] = start + 2_000;
        m.torque.header.stamps.sent_ns[1] = start + 5_000;
        m.torque.phase = codes::PHASE_RUNNING;
    });
    assert_eq!(verdict.outcome, "stopped");
    let hop = &verdict.latency_us["plant to estimator"];
    assert_eq!(hop.count, 10);
    assert!((hop.p50 - 2.0).abs() < 0.01 && (verdict.latency_us["chain"].p50 - 100.0).abs() < 0.2);
}

#[test]
fn on_a_grid_latencies_count_from_the_due_time_and_skipped_points_count_too() {
    const MS: u64 = 1_000_000;
    // Due at 10, 11, then 14 ms: the second tick took until 13.5 ms. It began 0.2 ms late. The third torque never came.
    let (due, sent, received) = (
        [10, 11, 14, 15].map(|ms| ms * MS),
        [10_000, 11_200, 14_000, 15_000],
        [0, 10_500, 13_500, 13_500],
    );
    let mut judge = Judge::of(Reported::truth(), limits(), Goal::default(), 4.0).on_grid(MS);
    for k in 0..4 {
        let mut m = upright(k as u64);
        let stamps = &mut m.sensor.header.stamps;
        (stamps.due_ns, stamps.sent_ns[0], stamps.received_ns[0]) =
            (due[k], sent[k] * 1000, received[k] * 1000);
        judge.tick(Tick::of(&m.lent()).unwrap());
    }
    let mut chain: Vec<f64> = judge
        .latency
        .of(Span::Chain)
        .iter_recorded()
        .map(|bucket| bucket.value_iterated_to() as f64 / MS as f64)
        .collect();
    chain.sort_by(f64::total_cmp);
    // 0.5 from 10; 2.5 from 11; of the third 1.0 until the plant went on, and 3.0 and 2.0 from the skipped points 12 and 13.
    let expected = [0.5, 1.0, 2.0, 2.5, 3.0];
    assert!(
        chain.len() == 5
            && chain
                .iter()
                .zip(expected)
                .all(|(a, b)| (a / b - 1.0).abs() < 2e-3),
        "{chain:?}"
    );
    let plant = &judge.verdict().latency_us["plant"];
    assert!(
        plant.count == 3 && (plant.max - 200.0).abs() < 1.0,
        "late beginnings: {plant:?}"
    );
}

/// A number that is not finite misses the goal, whichever message it came in, and shows in the figures.
#[test]
fn nan_misses_the_goal() {
    for at in [4, 9] {
        let verdict = judged(10, |k, m| {
            m.plant_state.p_BE[0] = if k == at { f64::NAN } else { 0.0 }
        });
        assert_eq!(verdict.outcome, "goal missed", "{}", verdict.reason);
        assert!(verdict.task.position_max_mm.is_nan() && verdict.task.orthogonal_max_mm.is_nan());
    }
    let verdict = judged(10, |k, m| {
        m.control_state.R_BE_d[0] = if k == 9 { f64::NAN } else { 1.0 }
    });
    assert_eq!(verdict.outcome, "goal missed");
    assert!(
        verdict.task.final_orientation_deg.is_nan()
            && verdict.reason.contains("end orientation off by NaN"),
        "{}",
        verdict.reason
    );
    let verdict = judged(10, |k, m| {
        (m.plant_state.qdot[1], m.torque.tau[2]) = if k == 3 {
            (f64::NAN, f64::NAN)
        } else {
            (0.0, 0.0)
        };
    });
    let joints = &verdict.joints;
    assert!(
        joints.speed_max_ratio.is_nan()
            && joints.torque_commanded_max_ratio.is_nan()
            && joints.torque_step_max_ratio.is_nan()
    );
    assert!(
        verdict.reason.contains("joint2 above its speed limit"),
        "{}",
        verdict.reason
    );
}

/// A half turn off is 180° off, and a rotation whose trace rounds to more than 3 is not off at all.
#[test]
fn both_ends_of_the_rotation_error_are_finite() {
    let verdict = judged(10, |_, m| {
        m.plant_state.R_BE = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]
    });
    assert_eq!(
        (verdict.outcome.as_str(), verdict.task.final_orientation_deg),
        ("goal missed", 180.0)
    );
    let verdict = judged(10, |_, m| m.plant_state.R_BE[0] = 1.0 + 4e-16);
    assert_eq!(
        (verdict.outcome.as_str(), verdict.task.final_orientation_deg),
        ("goal reached", 0.0)
    );
}

#[test]
fn every_limit_is_in_the_reason_and_in_the_events() {
    let mut judge = Judge::of(Reported::truth(), limits(), Goal::default(), 10.0);
    for k in 0..10 {
        let mut m = upright(k);
        m.torque.phase = codes::PHASE_DONE;
        if (3..7).contains(&k) {
            (m.plant_state.limit_mask, m.plant_state.q[3]) = (1 << 3, -1.0);
            m.plant_state.qdot[1] = 2.1;
            m.torque.saturation_mask = 1 << 5;
        }
        judge.tick(Tick::of(&m.lent()).unwrap());
    }
    let events: Vec<_> = judge.events().collect();
    let expected = [
        "joint2 above its speed limit",
        "joint4 against its lower stop",
        "joint6 at its torque limit",
    ];
    assert_eq!(events, expected.map(|text| (3, text.to_owned())));
    let verdict = judge.verdict();
    assert_eq!(
        (verdict.outcome.as_str(), verdict.joints.limits.len()),
        ("goal missed", 3)
    );
    for text in expected {
        assert!(
            verdict
                .reason
                .contains(&format!("{text} for 4 ticks from tick 3 on")),
            "{}",
            verdict.reason
        );
    }
}

/// A drive limits a torque for three reasons; only one of them is the joint's torque limit.
#[test]
fn a_drive_that_cuts_a_torque_is_named_with_its_cause() {
    let reason = |flags: u32, share: f64| {
        let verdict = judged(10, move |k, m| {
            if (3..7).contains(&k) {
                (m.plant_state.saturation_mask, m.plant_state.drive_flags) = (1 << 5, flags);
                m.plant_state.tau[5] = share * limits().effort[5];
            }
        });
        assert_eq!(
            verdict.joints.limits.len(),
            1,
            "{:?}",
            verdict.joints.limits
        );
        verdict.reason
    };
    let is_told = |reason: String, text: &str| {
        assert!(
            reason.contains(&format!("{text} for 4 ticks from tick 3 on")),
            "{reason}"
        )
    };
    is_told(
        reason(codes::DRIVE_EFFORT, 1.0),
        "joint6 at its torque limit",
    );
    is_told(
        reason(codes::DRIVE_EFFORT | codes::DRIVE_SPEED, -1.0),
        "joint6 at its torque limit",
    );
    is_told(
        reason(codes::DRIVE_SPEED, 0.3),
        "joint6's torque cut by its drive because of the speed",
    );
    is_told(
        reason(codes::DRIVE_RATE, 0.3),
        "joint6's torque delayed by its drive because of the rate",
    );
}

#[test]
fn a_hold_beyond_the_goal_is_counted_and_named() {
    let held = |mode: u32, off_m: f64| {
        judged(20, move |k, m| {
            (m.singularity.count, m.singularity.singularities[0].kind) = (1, codes::KIND_ELBOW);
            m.singularity.singularities[0].zeta_B[0] = 1.0;
            m.singularity.singularities[0].inside = 1;
            let is_held = (5..12).contains(&k);
            (m.control_state.mode[0], m.plant_state.p_BE[0]) = if is_held {
                (mode, off_m)
            } else {
                (codes::MODE_TRACK, 0.0)
            };
        })
    };
    let verdict = held(codes::MODE_HOLD, 24e-3);
    let elbow = &verdict.singularities[0];
    assert!(
        elbow.hold_ticks == 7
            && (elbow.hold_max_mm - 24.0).abs() < 1e-9
            && elbow.hold_max_deg == 0.0,
        "{elbow:?}"
    );
    assert!(
        verdict
            .reason
            .contains("held at the elbow singularity for 7 ticks from tick 5 on, up to 24.000 mm"),
        "{}",
        verdict.reason
    );
    for quiet in [
        held(codes::MODE_HOLD, 0.5e-3),
        held(codes::MODE_TRACK, 24e-3),
    ] {
        assert!(
            quiet.singularities[0].hold_ticks == 0 && !quiet.reason.contains("held"),
            "{}",
            quiet.reason
        );
    }
}

/// A planar arm turns its end-effector where it goes; only the axes it serves are judged, and a NaN on the others is a NaN.
#[test]
fn only_served_axes_are_judged() {
    let planar = || Limits {
        served: [true, true, false, false, false, false],
        ..limits()
    };
    let error = |x_m: f64, z_m: f64| {
        let mut all = ByTopic::<Whole>::default();
        (all.plant_state.R_BE, all.control_state.R_BE_d) =
            ([0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0], IDENTITY);
        (all.plant_state.p_BE[0], all.plant_state.p_BE[2]) = (x_m, z_m);
        let whole = super::against_reference(&Tick::of(&all.lent()).unwrap(), &planar().served);
        super::TaskError::split(Reported::truth().as_ref(), &whole)
    };
    assert_eq!(
        (
            error(2e-3, 5e-3).position[0],
            error(2e-3, 5e-3).orientation[0]
        ),
        (2.0, 0.0)
    );
    assert!(error(0.0, f64::NAN).position[0].is_nan());
}
