//! The product's scenarios against the paper and the acceptance bars, on an exact plant.

use crate::testing::{Figures, Tick, run, scenario};
use crate::types::{Kind, Mode};
use shared_types::scenario::{Scenario, Strategy};

macro_rules! scenario_text {
    ($name:literal) => {
        include_str!(concat!("../../../../sim/scenarios/", $name, ".toml"))
    };
}

/// The values of Figure 5, beside the figures of every run.
struct Figure5 {
    run: Figures,
    /// How far each joint moved, degrees.
    moved: [f64; 6],
    /// How far ζ turned before the rotation began, degrees.
    turned: f64,
}

fn figure_5(settings: &[&str]) -> Figure5 {
    let scenario = scenario(scenario_text!("fig5-wrist-rotation"), settings);
    let (mut zeta_start, mut turned) = (None, 0.0);
    let (mut q_start, mut q_end) = (None, nalgebra::Vector6::zeros());
    let run = run::<6>(&scenario, |_, tick| {
        // The wrist is the second by formula, the last by number.
        let zeta = tick
            .report
            .listed()
            .iter()
            .find(|s| s.kind == Kind::Wrist)
            .expect("a wrist")
            .axis();
        let start = *zeta_start.get_or_insert(zeta);
        q_start.get_or_insert(tick.q);
        if tick.command.segment == 0 {
            turned = libm::acos(start.dot(&zeta).clamp(-1.0, 1.0)).to_degrees();
            assert!(tick.command.mode.contains(&Mode::Reorient));
            let plan = tick
                .command
                .plan
                .expect("said before it begins")
                .by
                .map(f64::to_degrees);
            assert!(
                (plan[3].abs() - 90.0).abs() < 1e-3 && (plan[3] + plan[5]).abs() < 1e-3,
                "{plan}"
            );
        }
        q_end = tick.q;
    });
    Figure5 {
        run,
        moved: (q_end - q_start.unwrap()).map(f64::to_degrees).into(),
        turned,
    }
}

// covers: CK95 Figure 5
#[test]
fn figure_5_turns_the_singular_direction_and_then_rotates_about_it() {
    let Figure5 {
        run, moved, turned, ..
    } = figure_5(&[]);
    println!("{run:#?}\nmoved {moved:?}\nturned {turned}");
    assert!((turned - 90.0).abs() < 0.05, "ζ turned by {turned}°");
    assert!(
        run.along_mm.max(run.orthogonal_mm) < 0.01 && run.along_deg.max(run.orthogonal_deg) < 0.02,
        "{run:?}"
    );
    assert!(
        (moved[3] - 90.0).abs() < 0.05
            && (moved[4].abs() - 45.0).abs() < 0.05
            && (moved[5] + 90.0).abs() < 0.05,
        "{moved:?}"
    );
    assert!(
        run.torque_step_p95 < 0.1 && run.speed < 1.0 && run.torque < 1.0 && !run.refused,
        "{run:?}"
    );
}

#[test]
fn figure_5_by_the_papers_own_form_and_at_the_flange() {
    for settings in [
        &["control.strategy=\"chang-khatib\""][..],
        &["frame=\"flange\""],
    ] {
        let Figure5 { run, turned, .. } = figure_5(settings);
        println!("{settings:?}: {run:?}");
        assert!((turned - 90.0).abs() < 0.05, "{settings:?}: {turned}°");
        assert!(
            run.orthogonal_mm < 0.05
                && run.orthogonal_deg < 0.05
                && run.final_mm < 0.01
                && !run.refused,
            "{settings:?}: {run:?}"
        );
    }
}

/// A null space that swings in a potential without dissipation, and one that Eq. 5's k_vq brings to rest.
// covers: CK95 Figures 1 and 2
#[test]
fn figures_1_and_2_hold_the_tip_only_with_the_dynamically_consistent_inverse() {
    let swing = |text: &str, set: &[&str]| {
        let (mut worst_mm, mut ranges) = (0.0_f64, [[f64::INFINITY, -f64::INFINITY]; 2]);
        run::<3>(&scenario(text, set), |k, tick: &Tick<3>| {
            worst_mm = worst_mm.max(tick.error.fixed_rows::<2>(0).norm() * 1e3);
            let [low, high] = &mut ranges[usize::from(k >= 1000)];
            (*low, *high) = (low.min(tick.q[1]), high.max(tick.q[1]));
        });
        (worst_mm, ranges.map(|[low, high]| high - low))
    };
    let pseudo = swing(scenario_text!("fig1-pseudo-inverse"), &[]);
    let consistent = swing(scenario_text!("fig2-dynamically-consistent"), &[]);
    println!("tip error, mm, and swings, rad: {pseudo:?}, {consistent:?}");
    assert!(consistent.0 < 1.0 && pseudo.0 > 100.0 * consistent.0);
    let (_, [first, later]) = consistent;
    assert!(first > 1.0 && (later / first - 1.0).abs() < 0.1);
    let damped = swing(
        scenario_text!("fig2-dynamically-consistent"),
        &["control.k_vq=40.0"],
    );
    assert!(damped.1[1] < 0.1 * first, "{damped:?}");
}

/// The extremes of a number over a run.
fn extremes<const N: usize>(text: &str, number: impl Fn(&Tick<N>) -> f64) -> [f64; 2] {
    let mut extremes = [f64::MAX, f64::MIN];
    run::<N>(&scenario(text, &[]), |_, tick| {
        let x = number(tick);
        extremes = [extremes[0].min(x), extremes[1].max(x)];
    });
    extremes
}

#[test]
fn locks_are_left_in_either_posture_and_the_spare_joint_keeps_its_own() {
    let s = |place: usize| move |tick: &Tick<6>| tick.report.singularities[place].s;
    for [low, high] in [
        extremes::<6>(scenario_text!("elbow-in-and-out"), s(0)),
        extremes::<6>(scenario_text!("ur5-elbow"), s(0)),
        extremes::<6>(scenario_text!("ur5-wrist"), s(1)),
    ] {
        assert!(low < -0.4 && high > 0.4, "{low} {high}");
    }
    let rank = extremes::<6>(scenario_text!("straight-up"), |tick| {
        tick.report.rank.into()
    });
    assert_eq!(rank[0], 3.0, "the triple lock");
    let q1 = extremes::<7>(scenario_text!("iiwa-posture"), |tick| tick.q[0]);
    assert!(q1[1] - q1[0] > 0.3, "the posture changes: {q1:?}");
}

#[test]
fn a_start_at_the_edge_of_a_fold_keeps_its_side() {
    // |s| lies between η_in and η_out, and has one sign on both sides of this elbow.
    let start = "q = [-0.0001, 0.569, 0.0005, -0.7782, 0.0, 1.3453, 0.7845]";
    let text = format!(
        "name = \"t\"\nrobot = \"panda\"\n[control]\ngovernor = false\n[start]\n{start}\n[[segment]]\nby_m = [0.001, 0.0, 0.0]\nduration_s = 0.5\n"
    );
    let held = run::<7>(&scenario(&text, &[]), |_, tick| {
        let fold = &tick.report.listed()[0];
        assert!(fold.kind == Kind::Elbow && fold.aux * tick.command.aux_d[0] > 0.0);
    });
    assert!(held.orthogonal_mm < 0.1, "{} mm", held.orthogonal_mm);
}

#[test]
fn a_fold_is_left_on_the_side_that_is_asked_for_from_anywhere_beside_it() {
    for (degrees, branch) in [
        (2.0, -1),
        (-2.0, 1),
        (0.3, -1),
        (-0.3, 1),
        (0.003, -1),
        (2.0, 1),
    ] {
        let text = format!(
            "name = \"t\"\nrobot = \"ur5\"\n[start]\nq_deg = [20, -70, {degrees}, -40, 60, 0]\n[[segment]]\nslide = {{ along = \"zeta:elbow\", by_m = -0.05 }}\nbranch = {branch}\nduration_s = 1.5\n"
        );
        let mut elbow = 0.0;
        let ran = run::<6>(&scenario(&text, &[]), |_, tick| {
            elbow = tick.q[2];
        });
        assert!(
            elbow * f64::from(branch) > 0.5 && ran.orthogonal_mm < 0.1 && ran.final_mm < 0.1,
            "{degrees}, {branch}: {elbow}, {ran:?}"
        );
    }
}

#[test]
fn a_spare_joint_near_its_limit_is_kept_from_it() {
    // Joint 7 begins 6° from its limit, and is led back and forth.
    let text = r#"name = "t"
        robot = "iiwa14"
        [start]
        q = [1.17101, -0.86039, 0.82946, -0.98377, 1.92768, -0.36457, 2.95253]
        [[segment]]
        to_m = [-0.23675, -0.02773, 0.97316]
        rotation = [[0.9212542734065431, -0.3192085213852698, -0.22225319706409696], [0.38518427381478815, 0.8281374052841699, 0.40721187749742355], [0.054070684626300144, -0.46075411864055243, 0.8858792260911251]]
        duration_s = 7.481
    "#;
    let ran = run::<7>(&scenario(text, &[]), |_, _| {});
    assert!(
        !ran.limit_violated && ran.orthogonal_mm < 0.1 && ran.final_mm < 0.1,
        "{ran:?}"
    );
}

#[test]
fn a_turn_of_zeta_goes_as_it_was_announced() {
    let (mut plan, mut moved, mut q_start) = (None, None, None);
    run::<6>(&scenario(scenario_text!("ur5-wrist"), &[]), |_, tick| {
        let start: nalgebra::Vector6<f64> = *q_start.get_or_insert(tick.q);
        if tick.command.segment == 0 {
            (plan, moved) = (tick.command.plan, Some(tick.q - start));
        }
    });
    let (plan, moved) = (plan.unwrap(), moved.unwrap());
    assert!((plan.by - moved).amax() < 2e-3, "{} {moved}", plan.by);
}

/// The same arm by number: what the tracking of singular values costs against the formulas.
#[test]
fn a_puma_by_number_comes_close_to_the_formulas() {
    let Figure5 {
        run, moved, turned, ..
    } = figure_5(&["analysis.numeric=true"]);
    assert!(
        (turned - 90.0).abs() < 0.05
            && run.orthogonal_mm < 0.01
            && run.along_deg.max(run.orthogonal_deg) < 0.02,
        "{turned} {run:?}"
    );
    assert!(
        (moved[3] - 90.0).abs() < 0.05 && (moved[5] + 90.0).abs() < 0.05,
        "{moved:?}"
    );
}

#[test]
fn a_turn_without_room_is_refused_before_anything_moves() {
    let settings = [
        "start={q_deg = [20, -60, 170, 150, 0, 250]}",
        "segment=[{reorient = {singularity = \"wrist\", by_deg = 60}, duration_s = 1.0}]",
    ];
    let mut last = None;
    let f = run::<6>(
        &scenario(scenario_text!("fig5-wrist-rotation"), &settings),
        |_, tick| last = Some(tick.command),
    );
    // Joint 4 may go to 170°, joint 6 to 266°: +60° is too much for the one, −120° for the other.
    assert!(f.refused && f.speed < 1e-6, "{f:?}");
    assert_eq!(last.unwrap().refusal, crate::Refusal::Room);
}

#[test]
fn every_law_keeps_within_the_limits_and_never_gives_a_nan() {
    for strategy in [
        Strategy::ChangKhatib,
        Strategy::OperationalSpace,
        Strategy::DampedLeastSquares,
        Strategy::TruncatedSvd,
        Strategy::HoldAndBlend,
        Strategy::JointPd,
        Strategy::PseudoInverse,
        Strategy::DynamicallyConsistent,
    ] {
        for text in [
            scenario_text!("fig5-wrist-rotation"),
            scenario_text!("fig4-elbow-and-wrist"),
            scenario_text!("overhead-pass"),
        ] {
            let mut scenario: Scenario = scenario(text, &["settle_s=0.0"]);
            scenario.control.strategy = strategy;
            scenario.segment.truncate(1);
            scenario.segment[0].duration_s = 0.3;
            let f = run::<6>(&scenario, |_, tick| {
                assert!(
                    tick.command.tau.iter().all(|x| x.is_finite()),
                    "{strategy:?}"
                );
            });
            assert!(f.torque <= 1.0 + 1e-12, "{strategy:?}: {f:?}");
        }
    }
}
