//! Time per call of the rigid-body algorithms. Each sample cycles through random states.
//!
//! `cargo bench -p model`

use divan::{Bencher, black_box};
use model::{Model, Robot};
use nalgebra::SVector;

fn main() {
    divan::main();
}

/// Random-looking postures and rates: multiples of irrationals modulo a turn.
fn states<const N: usize>() -> Vec<[SVector<f64, N>; 3]> {
    let value =
        |k: usize, i: usize, step: f64| ((k * 7 + i + 1) as f64 * step).rem_euclid(6.0) - 3.0;
    (0..64)
        .map(|k| [2.39996, 1.61803, 0.57721].map(|step| SVector::from_fn(|i, _| value(k, i, step))))
        .collect()
}

fn bench<const N: usize, T>(
    bencher: Bencher,
    robot: &str,
    f: impl Fn(&Model<N>, &[SVector<f64, N>; 3]) -> T + Sync,
) {
    let model = Model::<N>::new(&Robot::builtin(robot).unwrap(), None).unwrap();
    let states = states();
    let next = std::sync::atomic::AtomicUsize::new(0);
    bencher
        .with_inputs(|| {
            states[next.fetch_add(1, std::sync::atomic::Ordering::Relaxed) % states.len()]
        })
        .bench_refs(|x| f(black_box(&model), black_box(x)));
}

macro_rules! arm {
    ($arm:ident, $n:literal, $robot:literal) => {
        mod $arm {
            use super::*;

            #[divan::bench(sample_size = 100)]
            fn evaluate(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |model, [q, qdot, _]| {
                    model.evaluate(q, qdot)
                });
            }

            #[divan::bench(sample_size = 100)]
            fn forward_dynamics(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |model, [q, qdot, tau]| {
                    model.forward_dynamics(q, qdot, tau)
                });
            }

            #[divan::bench(sample_size = 100)]
            fn inverse_dynamics(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |model, [q, qdot, qddot]| {
                    model.inverse_dynamics(q, qdot, qddot)
                });
            }

            #[divan::bench(sample_size = 100)]
            fn mass_matrix(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |model, [q, ..]| model.mass_matrix(q));
            }

            #[divan::bench(sample_size = 100)]
            fn jacobian(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |model, [q, ..]| model.jacobian(q));
            }

            /// The floor: the transcendental functions alone.
            #[divan::bench(sample_size = 100)]
            fn sincos_alone(bencher: Bencher) {
                bench::<$n, _>(bencher, $robot, |_, [q, ..]| {
                    q.map(|q| {
                        let (s, c) = libm::sincos(q);
                        s + c
                    })
                });
            }
        }
    };
}

arm!(puma560, 6, "puma560");
arm!(iiwa14, 7, "iiwa14");
