//! The product's scenarios against the paper and the acceptance bars, on an exact plant.

use crate::testing::{Figures, Plant, run, scenario};
use crate::types::Mode;

macro_rules! scenario_text {
    ($name:literal) => {
        include_str!(concat!("../../../sim/scenarios/", $name, ".toml"))
    };
}

fn figure_5(plant: Plant) -> (Figures, [f64; 6], f64, f64) {
    let scenario = scenario(scenario_text!("fig5-wrist-rotation"), &[]);
    let (mut zeta_start, mut turned) = (None, 0.0);
    let (mut q_start, mut q_end) = (None, nalgebra::Vector6::zeros());
    let mut settled_mm = 0.0_f64;
    let figures = run::<6>(&scenario, plant, |k, tick| {
        let zeta = tick.report.singularities[1].axis();
        let start = *zeta_start.get_or_insert(zeta);
        q_start.get_or_insert(tick.q);
        if tick.command.segment == 0 {
            turned = libm::acos(start.dot(&zeta).clamp(-1.0, 1.0)).to_degrees();
            assert!(matches!(tick.command.mode[1], Mode::Reorient));
        }
        q_end = tick.q;
        if k > 300 {
            settled_mm = settled_mm.max(tick.split().1[0]);
        }
    });
    let moved = (q_end - q_start.unwrap()).map(f64::to_degrees);
    (figures, moved.into(), turned, settled_mm)
}

// covers: CK95 Eq. 3 (Figure 5)
#[test]
fn figure_5_turns_the_singular_direction_and_then_rotates_about_it() {
    let (figures, moved, turned, _) = figure_5(Plant::default());
    println!("{figures:#?}\nmoved {moved:?}\nturned {turned}");
    assert!((turned - 90.0).abs() < 0.05, "ζ turned by {turned}°");
    assert!(figures.along_mm.max(figures.across_mm) < 0.01 && figures.along_deg.max(figures.across_deg) < 0.02, "{figures:?}");
    assert!((moved[3] - 90.0).abs() < 0.05 && (moved[4].abs() - 45.0).abs() < 0.05 && (moved[5] + 90.0).abs() < 0.05, "{moved:?}");
    assert!(figures.torque_step_p95 < 0.1 && figures.speed < 1.0 && figures.torque < 1.0 && !figures.refused, "{figures:?}");
}

#[test]
fn figure_5_with_noisy_encoders() {
    let (figures, _, turned, settled_mm) = figure_5(Plant { encoder_bits: 16, ..Plant::default() });
    println!("{figures:#?}\nturned {turned}");
    assert!((turned - 90.0).abs() < 0.25, "ζ turned by {turned}°");
    // One count of a 16-bit encoder is 0.06 mm at the hand: until the first readings are averaged the arm follows the very first.
    assert!(figures.across_mm < 0.1 && settled_mm < 0.05, "{figures:?}, {settled_mm} mm after 0.3 s");
    assert!(figures.along_deg.max(figures.across_deg) < 0.1 && figures.final_mm < 0.1, "{figures:?}");
    assert!(figures.torque_step_p95 < 0.1 && figures.speed < 1.0 && figures.torque < 1.0 && !figures.refused, "{figures:?}");
}

#[test]
fn explore() {
    for (text, settings) in [
        (scenario_text!("elbow-in-and-out"), &[][..]),
        (scenario_text!("fig4-elbow-and-wrist"), &[]),
        (scenario_text!("overhead-pass"), &[]),
        (scenario_text!("straight-up"), &[]),
        (scenario_text!("wrist-near-miss"), &[]),
    ] {
        let scenario = scenario(text, settings);
        println!("== {}", scenario.name);
        let mut last = [Mode::Regular; 4];
        let figures = run::<6>(&scenario, Plant::default(), |k, tick| {
            if k % 1000 == 0 || last != tick.command.mode {
                let s: Vec<f64> = tick.report.meant().iter().map(|s| (s.s * 1e4).round() / 1e4).collect();
                println!(
                    "{k:5} {:.4?} s {s:?} {:?} b {:.2?} aux {:.3?} scale {:.2} {:?}",
                    tick.split(),
                    &tick.command.mode[..3],
                    &tick.command.beta[..3],
                    tick.report.meant().iter().enumerate().map(|(i, s)| tick.command.aux_d[i] - s.aux).collect::<Vec<_>>(),
                    tick.command.time_scale,
                    tick.command.phase
                );
                last = tick.command.mode;
            }
        });
        println!("{figures:?}");
    }
}

#[test]
fn explore_3r() {
    for text in [scenario_text!("fig1-pseudo-inverse"), scenario_text!("fig2-dynamically-consistent")] {
        let scenario = scenario(text, &[]);
        let mut worst = 0.0_f64;
        let mut q_end = nalgebra::Vector3::zeros();
        let figures = run::<3>(&scenario, Plant::default(), |_, tick| {
            worst = worst.max(tick.error.fixed_rows::<2>(0).norm() * 1e3);
            q_end = tick.q;
        });
        println!("{} tip {worst} mm; q_end {:?} {figures:?}", scenario.name, q_end.map(f64::to_degrees).as_slice());
    }
}

#[test]
fn explore_compare() {
    let template = scenario(scenario_text!("fig5-wrist-rotation"), &[]);
    let lines = crate::sweep::lines(crate::testing::robot("puma560"), &template, 11, 45, 0.28);
    use shared_types::scenario::Strategy::*;
    for strategy in [Blended, ChangKhatib, OperationalSpace, DampedLeastSquares, TruncatedSvd, HoldAndBlend, JointPd] {
        let (mut s1n, mut s2n, mut endn, mut limn) = (0, 0, 0, 0);
        let (mut step, mut across) = (0.0_f64, vec![]);
        for line in &lines {
            let mut sc = line.scenario.clone();
            sc.control.strategy = strategy;
            let f = run::<6>(&sc, Plant::default(), |_, _| {});
            let ends = f.final_mm < 1.0 && f.final_deg < 0.5;
            let limits = f.speed <= 1.0 && f.torque <= 1.0 && f.saturated_ticks <= 10 && !f.limit_violated && !f.refused;
            let s1 = ends && limits && f.across_mm < 1.0 && f.across_deg < 0.5;
            let s2 = ends && limits && f.across_mm < 1.0 && f.across_deg < 3.0 && f.along_mm < 10.0 && f.along_deg < 5.0;
            s1n += usize::from(s1);
            s2n += usize::from(s2);
            endn += usize::from(ends);
            limn += usize::from(limits);
            step = step.max(f.torque_step);
            across.push(f.across_mm);
        }
        across.sort_by(f64::total_cmp);
        println!(
            "{strategy:?}: ends {endn} limits {limn} S1 {s1n} S2 {s2n} of 45; torque step max {step:.2}; across median {:.3} mm",
            across[22]
        );
    }
}

#[test]
fn explore_sweep() {
    let speed: f64 = std::env::var("SPEED").map_or(0.28, |s| s.parse().unwrap());
    let template = scenario(scenario_text!("fig5-wrist-rotation"), &[]);
    let lines = crate::sweep::lines(crate::testing::robot("puma560"), &template, 7, 210, speed);
    let mut ok = [[0usize; 4]; 3];
    let mut stretch = vec![];
    let mut steps = vec![];
    for line in &lines {
        let plant = Plant {
            encoder_bits: std::env::var("BITS").map_or(0, |b| b.parse().unwrap()),
            mass_factor: std::env::var("MASS").map_or(0.0, |b| b.parse().unwrap()),
        };
        let f = run::<6>(&line.scenario, plant, |_, _| {});
        stretch.push(f.stretch);
        steps.push(f.torque_step_p95);
        let ends = f.final_mm < 1.0 && f.final_deg < 0.5;
        let limits = f.speed <= 1.0 && f.torque <= 1.0 && f.saturated_ticks <= 10 && !f.limit_violated && !f.refused;
        let s1 = ends && limits && f.across_mm < 1.0 && f.across_deg < 0.5;
        let s2 = ends && limits && f.across_mm < 1.0 && f.across_deg < 3.0 && f.along_mm < 10.0 && f.along_deg < 5.0;
        let i = line.near.code() as usize - 1;
        for (k, yes) in [ends, limits, s1, s2].into_iter().enumerate() {
            ok[i][k] += usize::from(yes);
        }
        if !s2 && std::env::var("QUIET").is_err() {
            println!(
                "{:?} {} S1 {s1} S2 {s2} along {:.2} {:.2} across {:.3} {:.3} final {:.3} {:.3} speed {:.2} torque {:.2} step {:.2}/{:.3} sat {} stretch {:.2} sw {} ref {} lim {}",
                line.near,
                line.scenario.name,
                f.along_mm,
                f.along_deg,
                f.across_mm,
                f.across_deg,
                f.final_mm,
                f.final_deg,
                f.speed,
                f.torque,
                f.torque_step,
                f.torque_step_p95,
                f.saturated_ticks,
                f.stretch,
                f.switches,
                f.refused,
                f.limit_violated
            );
        }
    }
    stretch.sort_by(f64::total_cmp);
    steps.sort_by(f64::total_cmp);
    println!("stretch median {:.3} p90 {:.3} max {:.3}; step p95 max {:.3}", stretch[105], stretch[189], stretch[209], steps[209]);
    println!("elbow/wrist/overhead: [ends, limits, S1, S2] of 70: {ok:?}");
}

#[test]
fn explore_line() {
    let Ok(numbers) = std::env::var("LINE") else { return };
    let speed: f64 = std::env::var("SPEED").map_or(0.28, |s| s.parse().unwrap());
    let template = scenario(scenario_text!("fig5-wrist-rotation"), &[]);
    let lines = crate::sweep::lines(crate::testing::robot("puma560"), &template, 7, 210, speed);
    for n in numbers.split(',') {
        let line = &lines[n.parse::<usize>().unwrap()];
        println!("== {n} {:?}", line.scenario.segment[0].duration_s);
        let mut last = [Mode::Regular; 4];
        let mut tau = nalgebra::Vector6::zeros();
        run::<6>(&line.scenario, Plant::default(), |k, tick| {
            let step = (tick.command.tau - tau).component_div(&nalgebra::vector![97.6, 186.4, 89.4, 24.2, 20.1, 21.3]).amax();
            tau = tick.command.tau;
            if (k % 60 == 0 && tick.command.mode != [Mode::Regular; 4]) || last != tick.command.mode || (k > 0 && step > 0.2) {
                let s: Vec<f64> = tick.report.meant().iter().map(|s| (s.s * 1e3).round() / 1e3).collect();
                let (al, ac) = tick.split();
                println!(
                    "{k:5} al {:5.2} {:5.2} ac {:5.3} {:5.3} s {s:?} {:?} b {:.2?} e {:.3?} rc {:.2?} ra {:.2?} sc {:.2} st {step:.2} q {:.2?}",
                    al[0],
                    al[1],
                    ac[0],
                    ac[1],
                    &tick.command.mode[..3],
                    &tick.command.beta[..3],
                    tick.report.meant().iter().enumerate().map(|(i, s)| tick.command.aux_d[i] - s.aux).collect::<Vec<_>>(),
                    &tick.command.aux_rate_d[..3],
                    tick.report.meant().iter().map(|s| s.aux_rate).collect::<Vec<_>>(),
                    tick.command.time_scale,
                    tick.q.as_slice()
                );
                last = tick.command.mode;
            }
        });
    }
}
