//! Lines through exactly singular postures, followed by an inverse kinematics that shares nothing
//! with the planner: an arm reaches the goal where a route exists, and refuses the line before the
//! start where none does.
#![allow(non_snake_case)]

use crate::command::{Desk, finish};
use model::{Model, Pose, Robot, with_dof};
use nalgebra::{Matrix6, Rotation3, SMatrix, SVector, Vector3, Vector6};
use serde_json::Value;
use shared_types::job::RobotText;
use shared_types::random::Uniform;

/// Poses of a leg, and restarts of the inverse kinematics from each posture.
const POSES: u32 = 120;
const RESTARTS: u32 = 6;
/// Most postures of one pose that are followed, how far they lie apart, and the largest motion from
/// one pose to the next, rad (m).
const POSTURES: usize = 400;
const APART: f64 = 0.1;
const STEP: f64 = 0.3;

/// Revolute (`r`) and prismatic (`p`) joints: origin, roll-pitch-yaw, axis, limits, torque, speed.
type Joint = (char, &'static str, &'static str, &'static str, [f64; 4]);

const STANFORD: [Joint; 6] = [
    ('r', "0 0 0.4", "0 0 0", "0 0 1", [-2.9, 2.9, 200.0, 3.0]),
    ('r', "0 0.15 0", "0 0 0", "0 1 0", [-2.2, 2.2, 200.0, 3.0]),
    ('p', "0 0 0.4", "0 0 0", "0 0 1", [-0.3, 0.9, 400.0, 1.5]),
    ('r', "0 0 0", "0 0 0", "0 0 1", [-6.0, 6.0, 30.0, 6.0]),
    ('r', "0 0 0", "0 0 0", "0 1 0", [-2.0, 2.0, 30.0, 6.0]),
    ('r', "0 0 0.1", "0 0 0", "0 0 1", [-6.0, 6.0, 20.0, 6.0]),
];

fn urdf(joints: &[Joint]) -> String {
    let mut text = "<robot name=\"arm\"><link name=\"l0\"/>".to_owned();
    for (i, (kind, xyz, rpy, axis, [lower, upper, effort, velocity])) in joints.iter().enumerate() {
        let (kind, child, mass) = (
            if *kind == 'p' {
                "prismatic"
            } else {
                "revolute"
            },
            i + 1,
            4.0 / (i + 1) as f64,
        );
        text += &format!(
            "<link name=\"l{child}\"><inertial><mass value=\"{mass}\"/><inertia ixx=\"0.02\" iyy=\"0.02\" izz=\"0.02\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>\
             </inertial></link><joint name=\"j{child}\" type=\"{kind}\"><parent link=\"l{i}\"/><child link=\"l{child}\"/><origin xyz=\"{xyz}\" \
             rpy=\"{rpy}\"/><axis xyz=\"{axis}\"/><limit lower=\"{lower}\" upper=\"{upper}\" effort=\"{effort}\" velocity=\"{velocity}\"/></joint>"
        );
    }
    text + "</robot>"
}

/// The arm, its task's axes, and the poses between two.
struct Arm<const N: usize> {
    model: Model<N>,
    task: [bool; 6],
    dof: usize,
    length_m: f64,
}

/// The pose at a share of the straight way from one to another.
fn between(a: &Pose, b: &Pose, share: f64) -> Pose {
    let turn = Rotation3::from_matrix_unchecked(b.R * a.R.transpose()).scaled_axis();
    Pose {
        R: Rotation3::new(turn * share) * a.R,
        p: a.p + (b.p - a.p) * share,
    }
}

impl<const N: usize> Arm<N> {
    fn served(&self, e: Vector6<f64>) -> Vector6<f64> {
        Vector6::from_fn(|k, _| if self.task[k] { e[k] } else { 0.0 })
    }

    fn error(&self, X: &Pose, q: &SVector<f64, N>) -> Vector6<f64> {
        let at = self.model.forward_kinematics(q);
        let turn = Rotation3::from_matrix_unchecked(X.R * at.R.transpose()).scaled_axis();
        let by = (X.p - at.p) / self.length_m;
        self.served(Vector6::new(by.x, by.y, by.z, turn.x, turn.y, turn.z))
    }

    fn jacobian(&self, q: &SVector<f64, N>) -> SMatrix<f64, 6, N> {
        let mut J = self.model.jacobian(q);
        for mut column in J.column_iter_mut() {
            let scaled =
                Vector6::from_fn(|k, _| column[k] / if k < 3 { self.length_m } else { 1.0 });
            column.copy_from(&self.served(scaled));
        }
        J
    }

    /// The smallest singular value of the task.
    fn sigma(&self, q: &SVector<f64, N>) -> f64 {
        let J = self.jacobian(q);
        let mut values: Vec<f64> = (J * J.transpose())
            .symmetric_eigenvalues()
            .iter()
            .copied()
            .collect();
        values.sort_by(|a, b| b.total_cmp(a));
        let rows = self.task.iter().filter(|counts| **counts).count();
        values[rows - 1].max(0.0).sqrt()
    }

    /// Damped Newton steps to a posture of the pose.
    fn newton(&self, X: &Pose, mut q: SVector<f64, N>) -> Option<SVector<f64, N>> {
        for _ in 0..40 {
            let e = self.error(X, &q);
            if e.norm() < 1e-8 {
                return Some(q);
            }
            let J = self.jacobian(&q);
            let damping = (0.1 * e.norm_squared()).max(1e-12);
            let gram = J * J.transpose() + Matrix6::identity() * damping;
            let step = J.tr_mul(&gram.cholesky()?.solve(&e));
            q += step * (0.3 / step.amax().max(0.3));
        }
        None
    }

    fn is_inside(&self, q: &SVector<f64, N>, margin: f64) -> bool {
        let (lower, upper) = (self.model.lower(), self.model.upper());
        (0..self.dof).all(|i| q[i] > lower[i] + margin && q[i] < upper[i] - margin)
    }

    /// Whether the posture half-way, and those half-way to it, lie between the two.
    fn continues(
        &self,
        a: (&Pose, &SVector<f64, N>),
        b: (&Pose, &SVector<f64, N>),
        depth: u32,
    ) -> bool {
        let (X, mean) = (between(a.0, b.0, 0.5), (a.1 + b.1) * 0.5);
        let Some(middle) = self.newton(&X, mean) else {
            return false;
        };
        (middle - mean).norm() < 0.25 * (b.1 - a.1).norm() + 1e-5
            && (depth == 0
                || self.continues(a, (&X, &middle), depth - 1)
                    && self.continues((&X, &middle), b, depth - 1))
    }

    /// The postures of the pose `to` that continue those of the pose `from`.
    fn onwards(
        &self,
        from: (&Pose, &[SVector<f64, N>]),
        to: &Pose,
        random: &mut Uniform,
    ) -> Vec<SVector<f64, N>> {
        let mut found: Vec<SVector<f64, N>> = vec![];
        for q in from.1 {
            for k in 0..RESTARTS {
                let spread = [0.0, 0.03, 0.3][k.min(1 + k % 2) as usize];
                let guess = q + SVector::from_fn(|i, _| {
                    if i < self.dof {
                        random.within(-spread, spread)
                    } else {
                        0.0
                    }
                });
                let Some(next) = self.newton(to, guess) else {
                    continue;
                };
                let is_new = found.iter().all(|other| (other - next).amax() > APART);
                if is_new
                    && found.len() < POSTURES
                    && (next - q).amax() < STEP
                    && self.is_inside(&next, 0.0)
                    && self.continues((from.0, q), (to, &next), 2)
                {
                    found.push(next);
                }
            }
        }
        found
    }

    /// Whether a chain of postures without a jump leads from the start through the poses.
    /// `None`: undecided, with more postures than are followed.
    fn has_route(
        &self,
        q_start: &SVector<f64, N>,
        poses: &[Pose],
        random: &mut Uniform,
    ) -> Option<bool> {
        let mut postures = vec![*q_start];
        let mut from = self.model.forward_kinematics(q_start);
        for goal in poses {
            let begin = from;
            for k in 1..=POSES {
                let to = between(&begin, goal, f64::from(k) / f64::from(POSES));
                postures = self.onwards((&from, &postures), &to, random);
                from = to;
                if postures.len() >= POSTURES {
                    return None;
                }
            }
            // In a singular posture the arm may move while the pose rests.
            let mut count = 0;
            while postures.len() > count {
                count = postures.len();
                for q in self.onwards((&from, &postures), &from, random) {
                    if postures.iter().all(|other| (other - q).amax() > APART) {
                        postures.push(q);
                    }
                }
                if postures.len() >= POSTURES {
                    return None;
                }
            }
        }
        Some(!postures.is_empty())
    }

    /// A posture with σ = 0.
    fn lock(&self, random: &mut Uniform) -> Option<SVector<f64, N>> {
        let limit = |i: usize| {
            (
                self.model.lower()[i].max(-3.1),
                self.model.upper()[i].min(3.1),
            )
        };
        let mut q = SVector::from_fn(|i, _| {
            let (low, high) = if i < self.dof { limit(i) } else { (0.0, 0.0) };
            low + random.within(0.1, 0.9) * (high - low)
        });
        for _ in 0..120 {
            let sigma = self.sigma(&q);
            if sigma < 1e-8 {
                return self.is_inside(&q, 0.05).then_some(q);
            }
            let h = (0.05 * sigma).clamp(1e-9, 1e-5);
            let slope: SVector<f64, N> = SVector::from_fn(|i, _| {
                let by = SVector::from_fn(|k, _| if k == i && i < self.dof { h } else { 0.0 });
                (self.sigma(&(q + by)) - self.sigma(&(q - by))) / (2.0 * h)
            });
            let step = slope * (-sigma / slope.norm_squared().max(1e-6));
            q += step * (0.3 / step.amax().max(0.3));
        }
        None
    }

    /// A start posture, the pose of a lock and the pose beyond it.
    fn line(&self, random: &mut Uniform) -> Option<(SVector<f64, N>, [Pose; 2])> {
        let lock = self.lock(random)?;
        let at = self.model.forward_kinematics(&lock);
        let mut axis = |first: usize, size: f64| {
            Vector3::from_fn(|k, _| {
                if self.task[first + k] {
                    random.within(-size, size)
                } else {
                    0.0
                }
            })
        };
        let (by, turn) = (axis(0, 0.5 * self.length_m), axis(3, 0.5));
        let beyond = |share: f64| Pose {
            R: Rotation3::new(turn * share) * at.R,
            p: at.p + by * share,
        };
        let mut end = |share: f64| {
            (0..20).find_map(|_| {
                let guess = lock
                    + SVector::from_fn(|i, _| {
                        if i < self.dof {
                            random.within(-0.4, 0.4)
                        } else {
                            0.0
                        }
                    });
                self.newton(&beyond(share), guess)
                    .filter(|q| self.is_inside(q, 0.05))
            })
        };
        let (start, _) = (end(-1.0)?, end(1.0)?);
        Some((start, [at, beyond(1.0)]))
    }
}

fn scenario<const N: usize>(
    robot: &str,
    arm: &Arm<N>,
    q_start: &SVector<f64, N>,
    poses: &[Pose],
) -> String {
    let mut text = format!(
        "name = \"line\"\nrobot = \"{robot}\"\nsettle_s = 0.3\n[start]\nq = {:?}\n",
        &q_start.as_slice()[..arm.dof]
    );
    for X in poses {
        let rows: Vec<[f64; 3]> = X.R.row_iter().map(|row| [row[0], row[1], row[2]]).collect();
        text += &format!(
            "[[segment]]\nto_m = {:?}\nrotation = {rows:?}\nduration_s = 2.0\n",
            X.p.as_slice()
        );
    }
    text
}

/// Runs seeded lines of an arm; returns those in which the arm did not do what the inverse
/// kinematics asks for, and prints a table.
fn lines_of<const N: usize>(
    desk: &Desk,
    name: &str,
    robot: &Robot,
    seed: u64,
    count: usize,
) -> Vec<String> {
    let arm = Arm::<N> {
        model: Model::new(robot, None).unwrap(),
        task: robot.task.0,
        dof: robot.dof(),
        length_m: robot.length_m,
    };
    let mut random = Uniform(seed);
    let (mut wrong, mut counts, mut undecided) = (vec![], [0; 2], 0);
    for line in 1..=count {
        let Some((q_start, poses)) = (0..2_000).find_map(|_| arm.line(&mut random)) else {
            println!("{}: no line through a lock after {}", robot.name, line - 1);
            break;
        };
        let file = format!("{}-{seed}-{line}.toml", robot.name);
        let text = scenario(name, &arm, &q_start, &poses);
        desk.file(&file, &text);
        let said = finish(desk.start(&["run", &file, "--no-record", "--json"]));
        let summary: Value = serde_json::from_str(&said.out).unwrap_or_default();
        let (reached, refused) = (said.code == 0, said.code == 2);
        counts[0] += usize::from(reached);
        counts[1] += usize::from(refused);
        if reached {
            continue;
        }
        let exists = arm.has_route(&q_start, &poses, &mut random);
        undecided += usize::from(exists.is_none());
        if exists.is_some_and(|exists| exists || !refused) {
            let (word, why) = (
                if exists == Some(true) {
                    "route"
                } else {
                    "no route"
                },
                said.err.lines().next_back(),
            );
            println!("{text}");
            wrong.push(format!(
                "{file}: {word}, but {} {}",
                summary["reason"],
                why.unwrap_or_default()
            ));
        }
    }
    println!(
        "{} seed {seed}: {} reached, {} refused, {} wrong, {undecided} undecided of {count}",
        robot.name,
        counts[0],
        counts[1],
        wrong.len()
    );
    wrong.iter().for_each(|line| println!("  {line}"));
    wrong
}

fn lines(desk: &Desk, name: &str, robot: &Robot, seed: u64, count: usize) -> Vec<String> {
    with_dof!(robot.dof(), N => lines_of::<N>(desk, name, robot, seed, count)).expect(name)
}

#[test]
fn lines_through_locks_reach_their_goal_or_are_refused_as_they_should() {
    let desk = Desk::new();
    let mut wrong = vec![];
    let (urdf, description) = (urdf(&STANFORD), String::new());
    desk.file("stanford.urdf", &urdf);
    let robot = Robot::from_source(&RobotText {
        name: "stanford".to_owned(),
        urdf,
        description,
        ..RobotText::default()
    });
    wrong.extend(lines(&desk, "stanford.urdf", &robot.unwrap(), 1, 4));
    for name in ["ur10", "puma560"] {
        wrong.extend(lines(&desk, name, &Robot::builtin(name).unwrap(), 1, 2));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_path_that_returns_brings_spare_joints_back() {
    let desk = Desk::new();
    for (name, q, by, duration_s) in [
        // Away from every lock; through that of a wrist, with its start in it.
        (
            "fr3",
            "[0.3, -0.4, 0.2, -2.0, 0.3, 1.8, 0.7]",
            "[0.1, 0.2, -0.15]",
            4.0,
        ),
        (
            "iiwa14",
            "[0.3, 0.5, 0.1, -1.4, 0.4, 0.0, 0.2]",
            "[0.05, 0.10, -0.08]",
            5.0,
        ),
    ] {
        let leg = format!(
            "[[segment]]\nby_m = {by}\npath = \"there-and-back\"\nduration_s = {duration_s}\n"
        );
        desk.file(
            "returns.toml",
            &format!(
                "name = \"returns\"\nrobot = \"{name}\"\n[start]\nq = {q}\n{}",
                leg.repeat(10)
            ),
        );
        let said = desk.succeeds(&[
            "run",
            "returns.toml",
            "--no-record",
            "--no-messages",
            "--json",
        ]);
        let summary: Value = serde_json::from_str(&said.out).unwrap();
        let posture = |end: &str| -> Vec<f64> {
            let list = summary["joints"][end].as_array().unwrap();
            list.iter().map(|q| q.as_f64().unwrap()).collect()
        };
        for (begin, end) in posture("q_start").iter().zip(posture("q_end")) {
            // After 20 crossings without the way back: 122° (fr3), 33° (iiwa14).
            assert!(
                (begin - end).abs() < 5_f64.to_radians(),
                "{name}: {begin} {end}"
            );
        }
    }
}
