//! Verdicts on made-up runs.

use control::centre::PoseMotion;
use control::{Asked, Contact, GroundTruth, Progress};
use nalgebra::Vector6;
use shared_types::codes;
use shared_types::scenario::Scenario;
use shared_types::summary::{BOUNDARY, MISSED, REACHED, Summary};
use shared_types::topics::{ByTopic, Whole};
use shared_types::{PlantState, SingularityReport, SingularityState, TargetContent};

use super::{Judge, Limits, Tick};

const IDENTITY: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

/// A truth that takes the analyzer's report for its own, of a run without a path.
#[derive(Debug, Default)]
struct Reported {
    zeta: Vec<Vector6<f64>>,
    /// Whether an error points outwards: in the neighbourhood of an elbow.
    is_outwards: bool,
    /// Whether the path beyond the boundary has no posture.
    is_out_of_reach: bool,
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
        let is_elbow = |one: &&SingularityState| one.kind == codes::KIND_ELBOW;
        self.is_outwards = inside.clone().any(|one| is_elbow(&one));
        self.zeta = inside.map(|one| Vector6::from(one.zeta_B)).collect();
    }
    fn advance(&self, _: &mut Progress, _: f64) {}
    fn desired(&self, _: &Progress, _: f64) -> Option<PoseMotion> {
        None
    }
    fn force(
        &self,
        _: Option<&Progress>,
        _: Option<&TargetContent>,
        _: &PlantState,
        _: &Vector6<f64>,
    ) -> Option<Contact> {
        None
    }
    fn asked(&self, _: usize) -> Asked {
        Asked::Nothing
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
        self.is_outwards
    }
    fn reaches(&self, _: &Progress, _: &PlantState) -> bool {
        !self.is_out_of_reach
    }
    fn response(&self, _: &[f64]) -> f64 {
        0.0
    }
}

/// The usual goal, at 1000 ticks per second.
fn scenario() -> Scenario {
    let text = "name = 'x'\nrobot = 'x'\nstart.posture = 'x'\nsegment = [{duration_s = 1.0}]";
    Scenario::parse("x.toml", text, &[]).unwrap()
}

fn limits() -> Limits {
    let names = (1..=6).map(|i| format!("joint{i}")).collect();
    Limits {
        served: [true; 6],
        names,
        kinds: vec![model::JointKind::Revolute; 6],
        lower: vec![-3.0; 6],
        upper: vec![3.0; 6],
        effort: vec![10.0; 6],
        velocity: vec![2.0; 6],
    }
}

fn judged(ticks: u64, shape: impl Fn(u64, &mut ByTopic<Whole>)) -> Summary {
    let mut judge = Judge::of(Reported::truth(), limits(), scenario());
    for k in 0..ticks {
        let mut m = upright(k);
        if k + 1 == ticks {
            m.torque.phase = codes::PHASE_DONE;
        }
        shape(k, &mut m);
        judge.take(&m.lent());
    }
    judge.verdict()
}

/// A tick of an arm whose end-effector has the base's orientation, as desired.
fn upright(tick: u64) -> ByTopic<Whole> {
    let mut m = ByTopic::<Whole>::default();
    m.plant_state.R_BE = IDENTITY;
    m.control_state.R_BE_d = IDENTITY;
    (m.sensor.header.tick, m.plant_state.header.tick) = (tick, tick);
    (m.control_state.header.tick, m.torque.header.tick) = (tick, tick);
    m
}

/// Errors of a perfect arm at some ticks, and the outcome.
#[test]
fn an_error_is_judged_where_it_lies() {
    let end = |x: f64| {
        move |k: u64, m: &mut ByTopic<Whole>| {
            if k == 9 {
                m.plant_state.p_BE[0] = x;
            }
        }
    };
    let verdict = judged(10, end(0.0));
    assert_eq!(
        (verdict.outcome.as_str(), verdict.completed, verdict.ticks),
        (REACHED, true, 10)
    );
    let verdict = judged(10, end(2e-3));
    assert_eq!(verdict.outcome, MISSED);
    assert!((verdict.task.position_max_mm - 2.0).abs() < 1e-12);
    assert!((verdict.task.final_position_mm - 2.0).abs() < 1e-12);
    let verdict = judged(10, |k, m| {
        near(m, 0);
        m.control_state.mode[0] = codes::MODE_TRACK;
        if k == 4 {
            m.plant_state.p_BE[0] = 5e-3;
        }
    });
    assert!(verdict.task.position_max_mm > 4.9 && verdict.task.orthogonal_max_mm < 1e-12);
    assert_eq!(verdict.outcome, REACHED);
    assert_eq!(
        (verdict.modes.len(), verdict.modes[0].mode.as_str()),
        (1, "track")
    );
    // A half turn off is 180° off, and a rotation whose trace rounds to more than 3 is not off at all.
    for (R, outcome, deg) in [
        (
            [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0],
            MISSED,
            180.0,
        ),
        (
            [1.0 + 4e-16, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            REACHED,
            0.0,
        ),
    ] {
        let verdict = judged(10, |_, m| m.plant_state.R_BE = R);
        assert_eq!(
            (verdict.outcome.as_str(), verdict.task.final_orientation_deg),
            (outcome, deg)
        );
    }
}

/// Puts the arm inside the neighbourhood of its first singularity, of a kind, which takes away x.
fn near(m: &mut ByTopic<Whole>, kind: u32) {
    m.singularity.count = 1;
    let one = &mut m.singularity.singularities[0];
    one.kind = kind;
    one.inside = 1;
    one.zeta_B[0] = 1.0;
}

#[test]
fn the_angle_through_which_zeta_turns_is_measured_from_the_entry() {
    let verdict = judged(91, |k, m| {
        near(m, codes::KIND_WRIST);
        let zeta = &mut m.singularity.singularities[0];
        let (sin, cos) = (k as f64).to_radians().sin_cos();
        zeta.angular = 1;
        zeta.zeta_B = [0.0, 0.0, 0.0, cos, sin, 0.0];
    });
    let wrist = &verdict.singularities[0];
    assert!((wrist.zeta_turned_deg - 90.0).abs() < 1e-9);
    assert_eq!((wrist.name.as_str(), wrist.entries), ("wrist", 1));
}

#[test]
fn a_switch_puts_in_the_power_that_jumps() {
    let verdict = judged(20, |k, m| {
        m.singularity.count = 1;
        // 4 N·m at 0.5 rad/s against 1 N·m at 1 rad/s: 1 W for 25 ms.
        if k >= 10 {
            m.control_state.mode[0] = codes::MODE_TRACK;
            m.torque.tau[0] = 4.0;
            m.torque.tau[1] = -1.0;
        }
        m.plant_state.qdot[0] = 0.5;
        m.plant_state.qdot[1] = 1.0;
    });
    assert_eq!(verdict.joints.switches, 1);
    assert!((verdict.joints.switch_energy_j - 0.025).abs() < 1e-12);
}

/// Also over ticks that only bring the arm to rest, in which it is not announced.
#[test]
fn a_turn_is_followed_from_its_announcement_to_its_end() {
    for silent in [0..0, 13..16] {
        let verdict = judged(30, |k, m| {
            m.singularity.count = 2;
            m.singularity.singularities[1].kind = codes::KIND_WRIST;
            if (10..20).contains(&k) && !silent.contains(&k) {
                let state = &mut m.control_state;
                state.planned = 2;
                state.planned_s = 0.009;
                state.planned_dq[3] = 1.5;
            }
            m.plant_state.q[3] = 0.1 * k.clamp(10, 20) as f64;
        });
        let turn = &verdict.turns[0];
        assert_eq!(
            (
                verdict.turns.len(),
                turn.tick,
                turn.actual_ticks,
                turn.singularity.as_str()
            ),
            (1, 10, 10, "wrist")
        );
        assert!((turn.actual[3] - 1.0).abs() < 1e-9, "{turn:?}");
        assert!((turn.planned[3] - 1.5).abs() < 1e-9);
    }
}

#[test]
fn loads_are_ratios_and_steps_have_a_tail() {
    let verdict = judged(100, |k, m| {
        m.torque.tau[1] = if k == 50 { 5.0 } else { 0.0 };
        m.plant_state.qdot[2] = if k == 3 { -1.0 } else { 0.0 };
    });
    let joints = &verdict.joints;
    for ratio in [
        joints.torque_commanded_max_ratio,
        joints.torque_step_max_ratio,
        joints.speed_max_ratio,
    ] {
        assert!((ratio - 0.5).abs() < 1e-12, "{joints:?}");
    }
    // Two steps of a hundred lie above the 95th percentile.
    assert!(joints.torque_step_p95_ratio < 1e-3);
}

#[test]
fn latencies_come_from_the_stamps_and_an_unfinished_run_is_stopped() {
    let verdict = judged(10, |k, m| {
        let start = 1_000_000 * (k + 1);
        let sensor = &mut m.sensor.header.stamps;
        let torque = &mut m.torque.header.stamps;
        sensor.sent_ns[0] = start;
        sensor.received_ns[0] = start - 900_000;
        torque.sent_ns[..2].copy_from_slice(&[start, start + 5_000]);
        torque.received_ns[1] = start + 2_000;
        m.torque.phase = codes::PHASE_RUNNING;
    });
    assert_eq!(
        (verdict.outcome.as_str(), verdict.completed),
        ("stopped", false)
    );
    let hop = &verdict.latency_us["plant to estimator"];
    assert_eq!(hop.count, 10);
    assert!((hop.p50 - 2.0).abs() < 0.01 && (verdict.latency_us["chain"].p50 - 100.0).abs() < 0.2);
}

#[test]
fn on_a_grid_latencies_count_from_the_due_time_and_skipped_points_count_too() {
    const MS: u64 = 1_000_000;
    // Due at 10, 11, then 14 ms: the second tick took until 13.5 ms. It began 0.2 ms late. The third torque never came.
    let due = [10, 11, 14, 15].map(|ms| ms * MS);
    let sent = [10_000, 11_200, 14_000, 15_000];
    let received = [0, 10_500, 13_500, 13_500];
    let mut judge = Judge::of(Reported::truth(), limits(), scenario()).on_grid(MS);
    for k in 0..4 {
        let mut m = upright(k as u64);
        let stamps = &mut m.sensor.header.stamps;
        (stamps.due_ns, stamps.sent_ns[0], stamps.received_ns[0]) =
            (due[k], sent[k] * 1000, received[k] * 1000);
        judge.take(&m.lent());
    }
    let mut chain: Vec<f64> = judge
        .latency
        .chain
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
            if k == at {
                m.plant_state.p_BE[0] = f64::NAN;
            }
        });
        assert_eq!(verdict.outcome, MISSED, "{}", verdict.reason);
        assert!(verdict.task.position_max_mm.is_nan() && verdict.task.orthogonal_max_mm.is_nan());
    }
    let verdict = judged(10, |k, m| {
        if k == 9 {
            m.control_state.R_BE_d[0] = f64::NAN;
        }
    });
    assert_eq!(verdict.outcome, MISSED);
    assert!(verdict.task.final_orientation_deg.is_nan());
    let verdict = judged(10, |k, m| {
        if k == 3 {
            m.plant_state.qdot[1] = f64::NAN;
            m.torque.tau[2] = f64::NAN;
        }
    });
    let joints = &verdict.joints;
    assert!(
        joints.speed_max_ratio.is_nan()
            && joints.torque_commanded_max_ratio.is_nan()
            && joints.torque_step_max_ratio.is_nan()
    );
    assert_eq!(
        (
            joints.limits[0].joint.as_str(),
            joints.limits[0].limit.as_str()
        ),
        ("joint2", "speed")
    );
}

#[test]
fn every_limit_is_in_the_summary_and_in_the_events() {
    let mut judge = Judge::of(Reported::truth(), limits(), scenario());
    for k in 0..10 {
        let mut m = upright(k);
        m.torque.phase = codes::PHASE_DONE;
        if (3..7).contains(&k) {
            m.plant_state.limit_mask = 1 << 3;
            m.plant_state.q[3] = -1.0;
            m.plant_state.qdot[1] = 2.1;
            m.torque.tau[5] = limits().effort[5];
        }
        judge.take(&m.lent());
    }
    assert_eq!(
        judge.events().map(|(tick, _)| tick).collect::<Vec<_>>(),
        [3; 3]
    );
    let verdict = judge.verdict();
    assert_eq!(verdict.outcome, MISSED);
    let expected = [
        ("joint2", "speed"),
        ("joint4", "lower stop"),
        ("joint6", "torque"),
    ];
    assert_eq!(
        reached(&verdict),
        expected.map(|(joint, limit)| (joint, limit, 3, 4))
    );
}

/// Joint, limit, first tick and ticks of each limit that was reached.
fn reached(verdict: &Summary) -> Vec<(&str, &str, u64, u64)> {
    let limits = verdict.joints.limits.iter();
    limits
        .map(|one| {
            (
                one.joint.as_str(),
                one.limit.as_str(),
                one.first_tick,
                one.ticks,
            )
        })
        .collect()
}

/// A controller's mask may deny a torque at its limit, or claim one that is not.
#[test]
fn a_torque_is_at_its_limit_whatever_its_law_says() {
    for (share, mask, ticks) in [(-1.0, 0, 20), (0.43, 1 << 5, 0)] {
        let verdict = judged(40, |k, m| {
            if (3..23).contains(&k) {
                m.torque.tau[5] = share * limits().effort[5];
                m.torque.saturation_mask = mask;
            }
        });
        assert_eq!(verdict.joints.saturated_ticks, ticks);
        assert_eq!(
            (verdict.task.s1, reached(&verdict).len()),
            (ticks == 0, usize::from(ticks > 0))
        );
    }
}

/// Towards a pose that no posture has, the hand is at the boundary; towards one that a posture has, it lags.
#[test]
fn a_path_beyond_reach_is_followed_to_the_boundary() {
    let meter = |truth: &Reported| {
        let mut meter = super::reach::ReachMeter::default();
        for (mm, is_outwards) in [
            (1.5, true),
            (24.0, false),
            (7.0, true),
            (3.0, true),
            (0.0, true),
        ] {
            meter.tick(
                mm,
                is_outwards,
                Some(Progress::default()),
                &PlantState::default(),
                2.0,
            );
        }
        let found = meter.finish(truth);
        (found.most_mm, found.ticks, found.at_end, found.within_mm)
    };
    let is_out_of_reach = true;
    let beyond = Reported {
        is_out_of_reach,
        ..Reported::default()
    };
    assert_eq!(meter(&beyond), (7.0, 2, false, 0.0));
    assert_eq!(meter(&Reported::default()), (0.0, 0, false, 7.0));
    // On the way alone, or at the end.
    for at in [4..7, 4..10] {
        let verdict = judged(10, |k, m| {
            near(m, codes::KIND_ELBOW);
            if at.contains(&k) {
                m.plant_state.p_BE[0] = 0.024;
            }
        });
        assert_eq!(
            (verdict.outcome.as_str(), verdict.task.beyond_ticks),
            (BOUNDARY, at.end - at.start)
        );
        assert!((verdict.task.beyond_max_mm - 24.0).abs() < 1e-9 && !verdict.task.s1);
        assert!(verdict.task.causes.contains(&"beyond".to_owned()));
    }
}

/// While no torque comes the drives brake the arm; ticks that the judge did not see for want of one are theirs, too.
#[test]
fn drives_that_take_over_are_named() {
    for (stopping, is_named) in [(3..7, true), (0..1, false)] {
        let verdict = judged(10, move |k, m| {
            if stopping.contains(&k) {
                m.plant_state.drive = codes::DRIVE_STOPPING;
            }
        });
        let says = verdict.task.causes.contains(&"braked".to_owned());
        assert_eq!(
            (says, verdict.joints.stopped_ticks > 0),
            (is_named, is_named)
        );
    }
}

/// A drive limits a torque for three reasons; only one of them is the joint's torque limit.
#[test]
fn a_drive_that_cuts_a_torque_is_named_with_its_cause() {
    for (flags, share, limit) in [
        (codes::DRIVE_EFFORT, 1.0, "torque"),
        (codes::DRIVE_EFFORT | codes::DRIVE_SPEED, -1.0, "torque"),
        (codes::DRIVE_SPEED, 0.3, "drive speed"),
        (codes::DRIVE_RATE, 0.3, "drive rate"),
    ] {
        let verdict = judged(10, move |k, m| {
            if (3..7).contains(&k) {
                m.plant_state.saturation_mask = 1 << 5;
                m.plant_state.drive_flags = flags;
                m.plant_state.tau[5] = share * limits().effort[5];
            }
        });
        assert_eq!(reached(&verdict), [("joint6", limit, 3, 4)]);
    }
}

#[test]
fn a_hold_beyond_the_goal_is_counted() {
    for (mode, off_m, ticks) in [
        (codes::MODE_HOLD, 24e-3, 7),
        (codes::MODE_HOLD, 0.5e-3, 0),
        (codes::MODE_TRACK, 24e-3, 0),
    ] {
        let verdict = judged(20, move |k, m| {
            near(m, codes::KIND_ELBOW);
            let is_held = (5..12).contains(&k);
            (m.control_state.mode[0], m.plant_state.p_BE[0]) = if is_held {
                (mode, off_m)
            } else {
                (codes::MODE_TRACK, 0.0)
            };
        });
        let elbow = &verdict.singularities[0];
        assert_eq!((elbow.hold_ticks, elbow.hold_max_deg), (ticks, 0.0));
        let most_mm = if ticks > 0 { 24.0 } else { 0.0 };
        assert!((elbow.hold_max_mm - most_mm).abs() < 1e-9, "{elbow:?}");
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
        all.plant_state.p_BE[0] = x_m;
        all.plant_state.p_BE[2] = z_m;
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
