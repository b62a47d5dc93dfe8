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
