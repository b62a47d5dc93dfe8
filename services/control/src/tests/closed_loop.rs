//! The product's scenarios against the paper and the acceptance bars, on an exact plant.

use crate::testing::{Figures, Plant, Tick, robot, run, scenario};
use crate::types::{Kind, Mode};
use lines::lines;
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
    /// Largest position error after 0.3 s, mm.
    settled_mm: f64,
}

fn figure_5(settings: &[&str], plant: Plant) -> Figure5 {
    let scenario = scenario(scenario_text!("fig5-wrist-rotation"), settings);
    let (mut zeta_start, mut turned, mut settled_mm) = (None, 0.0, 0.0_f64);
    let (mut q_start, mut q_end) = (None, nalgebra::Vector6::zeros());
    let run = run::<6>(&scenario, plant, |k, tick| {
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
        if k > 300 {
            settled_mm = settled_mm.max(tick.split().1[0]);
        }
    });
    Figure5 {
        run,
        moved: (q_end - q_start.unwrap()).map(f64::to_degrees).into(),
        turned,
        settled_mm,
    }
}

/// S1 and S2 of the specification.
fn success(f: &Figures) -> (bool, bool) {
    let clean = f.final_mm < 1.0
        && f.final_deg < 0.5
        && f.speed <= 1.0
        && f.saturated_ticks <= 10
        && !f.limit_violated
        && !f.refused;
    let s1 = clean && f.orthogonal_mm < 1.0 && f.orthogonal_deg < 0.5;
    let s2 = clean
        && f.orthogonal_mm < 1.0
        && f.orthogonal_deg < 3.0
        && f.along_mm < 10.0
        && f.along_deg < 5.0;
    (s1, s2)
}

/// Runs lines of a sweep and counts S1, S2 and reached ends; prints what fails.
fn sweep(seed: u64, count: usize, speed: f64, plant: Plant, strategy: Strategy) -> [usize; 3] {
    let mut template = scenario(scenario_text!("sweep"), &[]);
    template.control.strategy = strategy;
    template.control.compensate_disturbance = plant.observer;
    let lines = lines(robot("puma560"), &template, seed, count, speed);
    assert_eq!(lines.len(), count);
    let mut counts = [0; 3];
    for line in &lines {
        let figures = run::<6>(&line.scenario, plant, |_, _| {});
        let (s1, s2) = success(&figures);
        for (count, yes) in
            counts
                .iter_mut()
                .zip([s1, s2, figures.final_mm < 1.0 && figures.final_deg < 0.5])
        {
            *count += usize::from(yes);
        }
        if !s2 {
            println!("{} near {:?}: {figures:?}", line.scenario.name, line.near);
        }
    }
    println!(
        "{strategy:?} at {speed} m/s, seed {seed}: S1 {}, S2 {}, ends {} of {count}",
        counts[0], counts[1], counts[2]
    );
    counts
}

// covers: CK95 Figure 5
#[test]
fn figure_5_turns_the_singular_direction_and_then_rotates_about_it() {
    let Figure5 {
        run, moved, turned, ..
    } = figure_5(&[], Plant::default());
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
fn figure_5_with_noisy_encoders() {
    let Figure5 {
        run,
        turned,
        settled_mm,
        ..
    } = figure_5(
        &[],
        Plant {
            encoder_bits: 16,
            ..Plant::default()
        },
    );
    println!("{run:#?}\nturned {turned}, {settled_mm} mm");
    assert!((turned - 90.0).abs() < 0.25, "ζ turned by {turned}°");
    // One count of a 16-bit encoder is 0.06 mm at the hand: until the first readings are averaged the arm follows the very first.
    assert!(
        run.orthogonal_mm < 0.1 && settled_mm < 0.05,
        "{run:?}, {settled_mm} mm after 0.3 s"
    );
    assert!(
        run.along_deg.max(run.orthogonal_deg) < 0.1 && run.final_mm < 0.1,
        "{run:?}"
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
        let Figure5 { run, turned, .. } = figure_5(settings, Plant::default());
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
        run::<3>(
            &scenario(text, set),
            Plant::default(),
            |k, tick: &Tick<3>| {
                worst_mm = worst_mm.max(tick.error.fixed_rows::<2>(0).norm() * 1e3);
                let [low, high] = &mut ranges[usize::from(k >= 1000)];
                (*low, *high) = (low.min(tick.q[1]), high.max(tick.q[1]));
            },
        );
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

/// Scenarios of the product on an exact plant: errors along ζ, orthogonal to it (mm), of orientation (°, each), 95th percentile of the torque step.
// covers: CK95 Figure 4
#[test]
fn scenarios_keep_the_bars_of_the_specification() {
    let bars = [
        (
            scenario_text!("elbow-in-and-out"),
            6,
            [0.3, 0.01, 0.1, 0.1, 0.1],
        ),
        (
            scenario_text!("fig4-elbow-and-wrist"),
            6,
            [0.4, 0.01, 0.1, 0.1, 0.1],
        ),
        (
            scenario_text!("overhead-pass"),
            6,
            [0.02, 0.02, 0.001, 0.001, 0.1],
        ),
        (scenario_text!("straight-up"), 6, [0.4, 0.01, 0.1, 0.1, 0.1]),
        // 20 mrad are 1.15°: what passing straight through costs where joint 4 has no room to follow.
        (
            scenario_text!("wrist-near-miss"),
            6,
            [10.0, 0.01, 1.2, 0.5, 0.1],
        ),
        (scenario_text!("ur5-elbow"), 6, [0.1, 0.01, 0.1, 0.1, 0.01]),
        (
            scenario_text!("ur5-wrist"),
            6,
            [0.1, 0.02, 0.02, 0.02, 0.01],
        ),
        (
            scenario_text!("seven-joints"),
            7,
            [10.0, 0.02, 0.5, 0.02, 0.1],
        ),
        (scenario_text!("iiwa-elbow"), 7, [0.1, 0.01, 0.5, 0.5, 0.01]),
        (
            scenario_text!("iiwa-posture"),
            7,
            [0.1, 0.01, 0.5, 0.5, 0.1],
        ),
    ];
    for (text, joints, [along_mm, orthogonal_mm, along_deg, orthogonal_deg, step]) in bars {
        let scenario = scenario(text, &[]);
        let f = match joints {
            7 => run::<7>(&scenario, Plant::default(), |_, _| {}),
            _ => run::<6>(&scenario, Plant::default(), |_, _| {}),
        };
        println!("{}: {f:?}", scenario.name);
        assert!(
            f.along_mm < along_mm
                && f.orthogonal_mm < orthogonal_mm
                && f.along_deg < along_deg
                && f.orthogonal_deg < orthogonal_deg
                && f.torque_step_p95 < step
                && f.torque_step < 0.2
                && success(&f).1,
            "{}: {f:?}",
            scenario.name
        );
    }
}

/// The extremes of a number over a run.
fn extremes<const N: usize>(text: &str, number: impl Fn(&Tick<N>) -> f64) -> [f64; 2] {
    let mut extremes = [f64::MAX, f64::MIN];
    run::<N>(&scenario(text, &[]), Plant::default(), |_, tick| {
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
    let held = run::<7>(&scenario(&text, &[]), Plant::default(), |_, tick| {
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
        let ran = run::<6>(&scenario(&text, &[]), Plant::default(), |_, tick| {
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
    let ran = run::<7>(&scenario(text, &[]), Plant::default(), |_, _| {});
    assert!(
        !ran.limit_violated && ran.orthogonal_mm < 0.1 && ran.final_mm < 0.1,
        "{ran:?}"
    );
}

#[test]
fn a_turn_of_zeta_goes_as_it_was_announced() {
    let (mut plan, mut moved, mut q_start) = (None, None, None);
    run::<6>(
        &scenario(scenario_text!("ur5-wrist"), &[]),
        Plant::default(),
        |_, tick| {
            let start: nalgebra::Vector6<f64> = *q_start.get_or_insert(tick.q);
            if tick.command.segment == 0 {
                (plan, moved) = (tick.command.plan, Some(tick.q - start));
            }
        },
    );
    let (plan, moved) = (plan.unwrap(), moved.unwrap());
    assert!((plan.by - moved).amax() < 2e-3, "{} {moved}", plan.by);
}

/// The same arm by number: what the tracking of singular values costs against the formulas.
#[test]
fn a_puma_by_number_comes_close_to_the_formulas() {
    // The bar on the angle was set with the wrist's neighbourhood at these thresholds; it grows with the neighbourhood.
    let settings = [
        "analysis.numeric=true",
        "analysis.eta_in={wrist = 0.08}",
        "analysis.eta_out={wrist = 0.16}",
    ];
    let numeric = |text: &str| run::<6>(&scenario(text, &settings), Plant::default(), |_, _| {});
    let elbow = numeric(scenario_text!("elbow-in-and-out"));
    let both = numeric(scenario_text!("fig4-elbow-and-wrist"));
    let three = numeric(scenario_text!("straight-up"));
    println!("{elbow:?}\n{both:?}\n{three:?}");
    for f in [elbow, both, three] {
        assert!(
            f.along_mm < 0.3 && f.orthogonal_mm < 0.01 && f.along_deg < 0.15 && success(&f).0,
            "{f:?}"
        );
    }
    let Figure5 {
        run, moved, turned, ..
    } = figure_5(&["analysis.numeric=true"], Plant::default());
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
        Plant::default(),
        |_, tick| last = Some(tick.command),
    );
    // Joint 4 may go to 170°, joint 6 to 266°: +60° is too much for the one, −120° for the other.
    assert!(f.refused && f.speed < 1e-6, "{f:?}");
    assert_eq!(last.unwrap().refusal, crate::Refusal::Room);
}

#[test]
fn nothing_chatters_at_the_edge() {
    let at = |s: f64, strategy: &str| {
        let text = format!(
            "name = \"edge\"\nrobot = \"puma560\"\nsettle_s = 0.0\n[start]\nq = [0.3, -1.0, 2.9, 0.2, {}, 0.0]\n[[segment]]\nduration_s = 5.0\n[control]\nstrategy = \"{strategy}\"\n",
            libm::asin(s)
        );
        run::<6>(
            &scenario(&text, &[]),
            Plant {
                encoder_bits: 16,
                ..Plant::default()
            },
            |_, _| {},
        )
        .switches
    };
    let hard = at(0.1, "chang-khatib");
    let blended = [0.1, 0.2, 0.21].map(|s| at(s, "blended"));
    println!("switches in 5 s: hard {hard}, blended {blended:?}");
    assert!(
        blended.iter().all(|switches| *switches <= 1),
        "once in or out, never back: {blended:?}"
    );
    assert!(
        hard > 20,
        "the same edge makes hard switching chatter: {hard}"
    );
}

#[test]
fn lines_through_and_near_every_singularity() {
    // One of these lines passes the wrist's singularity so closely, and sideways, that the speed limits leave 6.7° along ζ: S2 of the whole set is the bar.
    let [s1, s2, ends] = sweep(3, 24, 0.28, Plant::default(), Strategy::Blended);
    assert!(ends == 24 && s2 >= 23 && s1 >= 23, "{s1} {s2} {ends}");
    let [_, s2, ends] = sweep(4, 12, 1.0, Plant::default(), Strategy::Blended);
    assert!(ends == 12 && s2 == 12, "{s2} {ends}");
}

#[test]
fn lines_with_noisy_encoders_late_and_lost_torques() {
    let noisy = Plant {
        encoder_bits: 16,
        ..Plant::default()
    };
    let troubled = [
        (5, noisy),
        (
            6,
            Plant {
                delay: 5,
                ..Plant::default()
            },
        ),
        (
            7,
            Plant {
                dropped: 0.2,
                ..Plant::default()
            },
        ),
    ];
    for (seed, plant) in troubled {
        // No line is lost that the exact plant does not lose, or one: a near miss of a lock is at the edge of S2 either way.
        let [calm, rough] =
            [Plant::default(), plant].map(|plant| sweep(seed, 9, 0.28, plant, Strategy::Blended));
        assert!(
            rough[2] == 9 && rough[1] >= 8 && rough[1] + 1 >= calm[1],
            "{seed}: {calm:?} {rough:?}"
        );
    }
}

#[test]
fn a_wrong_mass_and_unknown_friction_are_compensated_by_the_observer() {
    let worst = |plant: Plant| {
        let settings = if plant.observer {
            &["control.compensate_disturbance=true"][..]
        } else {
            &[]
        };
        let f = run::<6>(
            &scenario(scenario_text!("fig5-wrist-rotation"), settings),
            plant,
            |_, _| {},
        );
        f.along_mm.max(f.orthogonal_mm)
    };
    for mass_factor in [0.9, 1.1] {
        let wrong = Plant {
            mass_factor,
            ..Plant::default()
        };
        let (off, on) = (
            worst(wrong),
            worst(Plant {
                observer: true,
                ..wrong
            }),
        );
        println!("mass {mass_factor}: {off} mm without, {on} mm with the observer");
        assert!(
            off < 2.5 && on < 0.5,
            "mass {mass_factor}: {off} mm, {on} mm"
        );
    }
    let rubbing = Plant {
        viscous: 1.0,
        ..Plant::default()
    };
    let worst_mm = |plant: Plant, settings: &[&str]| {
        run::<6>(
            &scenario(scenario_text!("overhead-pass"), settings),
            plant,
            |_, _| {},
        )
        .orthogonal_mm
    };
    let (off, on) = (
        worst_mm(rubbing, &[]),
        worst_mm(
            Plant {
                observer: true,
                ..rubbing
            },
            &["control.compensate_disturbance=true"],
        ),
    );
    println!("friction: {off} mm without, {on} mm with the observer");
    assert!(on < 0.5 && off > on, "friction: {off} mm, {on} mm");
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
            let f = run::<6>(&scenario, Plant::default(), |_, tick| {
                assert!(
                    tick.command.tau.iter().all(|x| x.is_finite()),
                    "{strategy:?}"
                );
            });
            assert!(f.torque <= 1.0 + 1e-12, "{strategy:?}: {f:?}");
        }
    }
}

#[test]
#[ignore = "minutes: the sweep of the acceptance table, slow and fast"]
fn the_whole_sweep() {
    // S1 is a bar at the usual speed alone.
    for (speed, least_s1, least_s2) in [(0.28, 200, 208), (0.5, 0, 200), (1.0, 0, 200)] {
        let [s1, s2, ends] = sweep(7, 210, speed, Plant::default(), Strategy::Blended);
        let is_met = s1 >= least_s1 && s2 >= least_s2 && ends == 210;
        assert!(is_met, "{speed} m/s: {s1} {s2} {ends}");
    }
}
