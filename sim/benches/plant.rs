//! Time per tick of the plant, 1 kHz, 4 sub-steps.
//!
//! `cargo bench -p sim`

use divan::{Bencher, black_box};
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::{self, PlantModel};
use sim::{Drive, Encoders, Plant};

type Joints = SVector<f64, 6>;

/// Counts allocations: none where rapier3d is not asked.
#[global_allocator]
static ALLOCATIONS: divan::AllocProfiler = divan::AllocProfiler::system();

fn main() {
    divan::main();
}

fn robot() -> Robot {
    Robot::builtin("puma560").unwrap()
}

fn nominal() -> Joints {
    Joints::from_column_slice(&robot().postures["nominal"])
}

/// A tick of the plant in a world, after `settle` ticks, with gravity compensated but for `extra`.
fn tick(bencher: Bencher, options: &scenario::Plant, settle: u32, extra: Joints) {
    let mut plant = Plant::<6>::new(&robot(), None, options, 1000, &nominal()).unwrap();
    let start = nominal();
    let mut step = move || {
        let x = *plant.state();
        let posture = (start - x.q) * 100.0 - x.qdot * 20.0;
        let tau = plant.model().gravity(&x.q)
            + extra
            + if extra == Joints::zeros() {
                posture
            } else {
                -x.qdot * 20.0
            };
        plant.step(black_box(&tau)).unwrap();
        plant.touch().contacts
    };
    for _ in 0..settle {
        step();
    }
    bencher.bench_local(step);
}

/// The default scenarios: the arm is clear of everything.
#[divan::bench]
fn free(bencher: Bencher) {
    tick(bencher, &scenario::Plant::default(), 10, Joints::zeros());
}

#[divan::bench]
fn reference(bencher: Bencher) {
    tick(
        bencher,
        &scenario::Plant {
            model: PlantModel::Reference,
            ..Default::default()
        },
        10,
        Joints::zeros(),
    );
}

/// Dry friction of an arm that touches nothing.
#[divan::bench]
fn dry_friction(bencher: Bencher) {
    tick(
        bencher,
        &scenario::Plant {
            friction: true,
            ..Default::default()
        },
        10,
        Joints::zeros(),
    );
}

/// Pressed against the floor.
#[divan::bench]
fn contact(bencher: Bencher) {
    let world = scenario::Plant {
        floor_m: Some(-0.3),
        ..Default::default()
    };
    tick(
        bencher,
        &world,
        4000,
        Joints::new(0.0, 15.0, 0.0, 0.0, 0.0, 0.0),
    );
}

#[divan::bench]
fn encoders(bencher: Bencher) {
    let encoders = Encoders::<6>::new(&robot(), 16, 0.5, 1);
    let (q, mut tick) = (nominal(), 0);
    bencher.bench_local(|| {
        tick += 1;
        encoders.read(tick, black_box(&q))
    });
}

#[divan::bench]
fn drive(bencher: Bencher) {
    let model = Model::<6>::new(&robot(), None).unwrap();
    let q = nominal();
    let tau = model.gravity(&q);
    let mut drive = Drive::new(model, 1000, 3, &q);
    bencher.bench_local(|| {
        drive
            .step(black_box(&q), &Joints::zeros(), Some(black_box(&tau)))
            .tau
    });
}
