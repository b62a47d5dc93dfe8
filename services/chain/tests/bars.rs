//! The acceptance bars on the hybrid plant with encoder noise: the whole chain, cycle by cycle, judged on the simulator's truth.
//!
//! Slow, and so not part of the daily tests: `cargo test --release -p chain -- --ignored --nocapture --test-threads 1` prints the tables.
#![allow(non_snake_case)]

use chain::Tick;
use model::Robot;
use nalgebra::{Matrix3, Vector3};
use shared_types::codes::{MODE_REGULAR, PHASE_DONE, PHASE_REFUSED};
use shared_types::scenario::Scenario;

/// The result of one run.
#[derive(Clone, Debug, Default)]
struct Figures {
    /// Largest errors along the engaged singular directions and orthogonal to them: mm, degrees.
    along: [f64; 2],
    orthogonal: [f64; 2],
    /// At the end.
    end: [f64; 2],
    /// Largest shares of the limits.
    speed: f64,
    torque: f64,
    /// 95th percentile of the torque's change in one tick, as a share of its limit.
    step_p95: f64,
    /// Its 99th percentile and its largest value.
    step_p99: f64,
    step_max: f64,
    /// Tick of the largest.
    step_tick: usize,
    /// Torque beside its mean over 21 ticks, root mean square and largest over a second, as a share of its limit: the worst joint's.
    hiss: [f64; 2],
    saturated_ticks: usize,
    /// Changes of mode, and the energy they put in (as the recorder's judge counts it).
    switches: usize,
    switch_j: f64,
    stretch: f64,
    /// Ran to its end, without a refusal and without a joint at its stop.
    clean: bool,
}

/// The first turn of the wait for a mode's power jump: 1/k_v.
const SWITCH_S: f64 = 0.025;

fn run(robot: &Robot, scenario: &Scenario) -> Figures {
    let mut out = Figures {
        clean: true,
        ..Figures::default()
    };
    let mut steps = vec![];
    let mut torques: Vec<Vec<f64>> = vec![];
    let mut last: Option<Tick> = None;
    let (mut ticks, mut phase) = (0_u32, 0);
    let n = robot.dof();
    let each = |tick: &Tick| {
        let (along, orthogonal) = split(tick);
        for k in 0..2 {
            out.along[k] = out.along[k].max(along[k]);
            out.orthogonal[k] = out.orthogonal[k].max(orthogonal[k]);
            out.end[k] = (along[k] * along[k] + orthogonal[k] * orthogonal[k]).sqrt();
        }
        let mut step = 0.0_f64;
        let mut jump = 0.0;
        for (i, joint) in robot.joints.iter().enumerate().take(n) {
            out.speed = out
                .speed
                .max(tick.plant_state.qdot[i].abs() / joint.velocity);
            out.torque = out.torque.max(tick.torque.tau[i].abs() / joint.effort);
            if let Some(last) = &last {
                let change = tick.torque.tau[i] - last.torque.tau[i];
                step = step.max(change.abs() / joint.effort);
                jump += change * tick.plant_state.qdot[i];
            }
        }
        steps.push(step);
        torques.push(
            robot
                .joints
                .iter()
                .enumerate()
                .map(|(i, joint)| tick.torque.tau[i] / joint.effort)
                .collect(),
        );
        if let Some(last) = &last {
            let changes = (0..4)
                .filter(|i| last.control_state.mode[*i] != tick.control_state.mode[*i])
                .count();
            out.switches += changes;
            out.switch_j += if changes > 0 {
                jump.abs() * SWITCH_S
            } else {
                0.0
            };
        }
        out.saturated_ticks += usize::from(tick.torque.saturation_mask != 0);
        phase = tick.torque.phase;
        out.clean &= phase != PHASE_REFUSED && tick.plant_state.limit_mask == 0;
        ticks += 1;
        last = Some(*tick);
    };
    chain::run(robot, scenario, each).unwrap();
    out.hiss = hiss(&torques);
    out.step_tick = (0..steps.len())
        .max_by(|a, b| steps[*a].total_cmp(&steps[*b]))
        .unwrap_or(0);
    steps.sort_by(f64::total_cmp);
    out.step_p95 = steps[steps.len() * 95 / 100];
    out.step_p99 = steps[steps.len() * 99 / 100];
    out.step_max = steps[steps.len() - 1];
    out.stretch = f64::from(ticks) * scenario.dt_s() / scenario.duration_s();
    out.clean &= phase == PHASE_DONE;
    out
}

/// Noise of the torques: each beside its own mean over 21 ticks; root mean square over any half second, and the largest, of the worst joint.
fn hiss(torques: &[Vec<f64>]) -> [f64; 2] {
    const HALF: usize = 10;
    let mut out = [0.0_f64; 2];
    for i in 0..torques.first().map_or(0, Vec::len) {
        let fast: Vec<f64> = torques
            .windows(2 * HALF + 1)
            .map(|window| {
                window[HALF][i] - window.iter().map(|tau| tau[i]).sum::<f64>() / window.len() as f64
            })
            .collect();
        out[1] = fast.iter().fold(out[1], |most, x| most.max(x.abs()));
        for half_second in fast.chunks_exact(500) {
            out[0] = out[0].max((half_second.iter().map(|x| x * x).sum::<f64>() / 500.0).sqrt());
        }
    }
    out
}

/// Error along the engaged singular directions, and orthogonal to them: (mm, degrees) each.
fn split(tick: &Tick) -> ([f64; 2], [f64; 2]) {
    let (truth, command) = (&tick.plant_state, &tick.control_state);
    let matrix = |R: &[f64; 9]| Matrix3::from_column_slice(R);
    let p = Vector3::from(command.p_BE_d) - Vector3::from(truth.p_BE);
    let w = model::rotation_log(&(matrix(&command.R_BE_d) * matrix(&truth.R_BE).transpose()));
    let (mut linear, mut angular) = (p, w);
    for (i, s) in tick.singularity.singularities[..tick.singularity.count as usize]
        .iter()
        .enumerate()
    {
        if command.mode[i] == MODE_REGULAR {
            continue;
        }
        let (v, turn) = (
            Vector3::from_column_slice(&s.zeta_B[..3]),
            Vector3::from_column_slice(&s.zeta_B[3..]),
        );
        linear -= v * v.dot(&linear);
        angular -= turn * turn.dot(&angular);
    }
    let unit = |p: Vector3<f64>, w: Vector3<f64>| [p.norm() * 1e3, w.norm().to_degrees()];
    (unit(p - linear, w - angular), unit(linear, angular))
}

fn built_in(name: &str, settings: &[&str]) -> (Robot, Scenario) {
    let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
    let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &settings).unwrap();
    (Robot::builtin(&scenario.robot).unwrap(), scenario)
}

fn print(name: &str, f: &Figures) {
    println!(
        "{name:38} along {:8.4} mm {:7.4}°  orthogonal {:7.4} mm {:7.4}°  end {:6.4} mm {:6.4}°  step p95 {:.4} p99 {:.4} max {:.4} at {:5} hiss {:.4} {:.4}  {:2} switches {:.4} J  speed {:.2} torque {:.2}  stretch {:.2}{}",
        f.along[0],
        f.along[1],
        f.orthogonal[0],
        f.orthogonal[1],
        f.end[0],
        f.end[1],
        f.step_p95,
        f.step_p99,
        f.step_max,
        f.step_tick,
        f.hiss[0],
        f.hiss[1],
        f.switches,
        f.switch_j,
        f.speed,
        f.torque,
        f.stretch,
        if f.clean { "" } else { "  NOT CLEAN" }
    );
}

#[test]
#[ignore = "minutes: every built-in scenario against five times its bar"]
fn scenarios_with_noise() {
    // Along: mm, degrees; orthogonal: mm, degrees; five times the exact plant's bars. Where the specification has none, the position bar of the others.
    let bars = [
        ("fig5-wrist-rotation", [0.05, 0.1, 0.05, 0.1]),
        ("fig4-elbow-and-wrist", [2.0, 0.5, 0.05, 0.5]),
        ("elbow-in-and-out", [1.5, 0.5, 0.05, 0.5]),
        ("overhead-pass", [0.1, 0.05, 0.1, 0.05]),
        ("straight-up", [2.0, 0.5, 0.05, 0.5]),
        ("wrist-near-miss", [0.05, 5.0, 0.05, 2.5]),
        ("ur5-wrist", [0.5, 0.1, 0.5, 0.1]),
        ("ur5-elbow", [0.5, 0.1, 0.5, 0.1]),
        ("iiwa-elbow", [0.5, 0.1, 0.5, 0.1]),
        ("iiwa-posture", [0.5, 0.1, 0.5, 0.1]),
        ("seven-joints", [0.5, 0.1, 0.5, 0.1]),
    ];
    // Encoder noise in the torques, root mean square over any half second, as a share of the limit, in two passes through a lock.
    const HISS: f64 = 0.005;
    let mut missed = vec![];
    for (name, bar) in bars {
        let (robot, scenario) = built_in(name, &[]);
        let f = run(&robot, &scenario);
        print(name, &f);
        let hisses = ["fig5-wrist-rotation", "overhead-pass"].contains(&name) && f.hiss[0] > HISS;
        let within = [f.along[0], f.along[1], f.orthogonal[0], f.orthogonal[1]]
            .iter()
            .zip(bar)
            .all(|(value, bar)| *value <= bar);
        if !(within && f.end[0] < 0.1 && f.clean && f.step_p95 < 0.5 && f.switch_j < 2.5) || hisses
        {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "missed: {missed:?}");
}

/// Runs lines of the sweep; counts S1, S2 and reached ends, prints what fails and the sums.
fn sweep(seed: u64, count: usize, speed: f64, settings: &[&str]) -> [usize; 3] {
    let (robot, mut template) = built_in("sweep", settings);
    // The lines are drawn in free space.
    template.plant.floor_m = None;
    let mut counts = [0; 3];
    let (mut stretches, mut steps, mut energies) = (vec![], vec![], vec![]);
    let (mut top_speed, mut top_torque) = (0.0_f64, 0.0_f64);
    for line in lines::lines(&robot, &template, seed, count, speed) {
        let f = run(&robot, &line.scenario);
        let ends = f.end[0] < 1.0 && f.end[1] < 0.5;
        let clean = ends && f.clean && f.speed <= 1.0 && f.saturated_ticks <= 10;
        let s1 = clean && f.orthogonal[0] < 1.0 && f.orthogonal[1] < 0.5;
        let s2 = clean
            && f.orthogonal[0] < 1.0
            && f.orthogonal[1] < 3.0
            && f.along[0] < 10.0
            && f.along[1] < 5.0;
        for (count, yes) in counts.iter_mut().zip([s1, s2, ends]) {
            *count += usize::from(yes);
        }
        if !s2 {
            print(&format!("{} {:?}", line.scenario.name, line.near), &f);
        }
        stretches.push(f.stretch);
        steps.push(f.step_p95);
        energies.push(f.switch_j);
        (top_speed, top_torque) = (top_speed.max(f.speed), top_torque.max(f.torque));
    }
    let at = |values: &mut Vec<f64>, share: f64| {
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share) as usize]
    };
    println!(
        "{count} lines at {speed} m/s, seed {seed}, {settings:?}: S1 {}, S2 {}, ends {}; stretch median {:.2}, p90 {:.2}, max {:.2}; step p95 {:.4} (worst line); \
         energy at switches {:.3} J median, {:.3} J worst; speed {top_speed:.3}, torque {top_torque:.3} of the limits",
        counts[0],
        counts[1],
        counts[2],
        at(&mut stretches, 0.5),
        at(&mut stretches, 0.9),
        at(&mut stretches, 1.0),
        at(&mut steps, 1.0),
        at(&mut energies, 0.5),
        at(&mut energies, 1.0),
    );
    counts
}

#[test]
#[ignore = "minutes: the sweep of the acceptance table"]
fn sweep_with_noise() {
    let [s1, s2, ends] = sweep(11, 210, 0.28, &[]);
    assert!(
        s1 >= 200 && s2 >= 208 && ends == 210,
        "S1 {s1}, S2 {s2}, ends {ends}"
    );
}

#[test]
#[ignore = "minutes: the same, fast"]
fn fast_sweeps_with_noise() {
    for speed in [0.5, 1.0] {
        let [_, s2, ends] = sweep(12, 105, speed, &[]);
        assert!(
            s2 >= 100 && ends == 105,
            "{speed} m/s: S2 {s2}, ends {ends}"
        );
    }
}

/// Without the disturbance observer, which is on by default.
const OBSERVER_OFF: [&str; 1] = ["estimator.disturbance_bandwidth=0.0"];

#[test]
#[ignore = "a minute: a wrong mass, with the observer off and on"]
fn a_wrong_mass_on_the_hybrid_plant() {
    let mut missed = vec![];
    for name in [
        "fig5-wrist-rotation",
        "fig4-elbow-and-wrist",
        "overhead-pass",
    ] {
        for mass in ["plant.mass_factor=0.9", "plant.mass_factor=1.1"] {
            for observer in [false, true] {
                let settings: Vec<&str> = [mass]
                    .into_iter()
                    .chain(
                        if observer { &[] } else { &OBSERVER_OFF[..] }
                            .iter()
                            .copied(),
                    )
                    .collect();
                let (robot, scenario) = built_in(name, &settings);
                let f = run(&robot, &scenario);
                let label = format!(
                    "{name} {} {}",
                    &mass[18..],
                    if observer { "observer" } else { "" }
                );
                print(&label, &f);
                let worst = f.along[0].max(f.orthogonal[0]);
                // 2.5 and 0.5 mm with an exact plant; with noise five times that.
                if worst > if observer { 2.5 } else { 12.5 } || !f.clean {
                    missed.push(label);
                }
            }
        }
    }
    assert!(missed.is_empty(), "missed: {missed:?}");
}

#[test]
#[ignore = "a minute: friction that the controller does not model"]
fn unmodelled_friction_on_the_hybrid_plant() {
    for coulomb in [false, true] {
        for observer in [false, true] {
            let settings: Vec<&str> = ["plant.friction=true"]
                .into_iter()
                .chain(
                    if observer { &[] } else { &OBSERVER_OFF[..] }
                        .iter()
                        .copied(),
                )
                .collect();
            let (mut robot, scenario) = built_in("overhead-pass", &settings);
            if !coulomb {
                robot
                    .joints
                    .iter_mut()
                    .for_each(|joint| joint.coulomb_friction = 0.0);
            }
            let f = run(&robot, &scenario);
            print(
                &format!(
                    "overhead-pass, {} {}",
                    if coulomb { "all friction" } else { "viscous" },
                    if observer { "observer" } else { "" }
                ),
                &f,
            );
            assert!(
                !observer || coulomb || f.orthogonal[0] < 2.5,
                "orthogonal {} mm",
                f.orthogonal[0]
            );
        }
    }
}

#[test]
#[ignore = "seconds: at the edge of a neighbourhood"]
fn nothing_chatters_at_the_edge_of_a_neighbourhood() {
    for s in [0.1_f64, 0.2, 0.21] {
        let text = format!(
            "name = \"edge\"\nrobot = \"puma560\"\nsettle_s = 0.0\n[start]\nq_rad = [0.3, -1.0, 2.9, 0.2, {}, 0.0]\n[[segment]]\nduration_s = 5.0\n",
            s.asin()
        );
        let scenario = Scenario::parse("edge.toml", &text, &[]).unwrap();
        let f = run(&Robot::builtin("puma560").unwrap(), &scenario);
        print(&format!("5 s at |s| = {s}"), &f);
        assert!(f.switches <= 1, "{} switches at {s}", f.switches);
    }
}
