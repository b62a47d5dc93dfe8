//! The arm and its floor in rapier3d: what constraints do to the arm in one sub-step.
//!
//! Everything that rapier3d needs special care for is here (and nowhere else):
//! a multibody's root is a free joint until the first `forward_kinematics(_, true)`; joints are damped by default;
//! torques persist until they are reset; there is no generalised force, so that a joint's torque is applied as equal and
//! opposite torques on its two links; `num_solver_iterations` counts sub-steps, not iterations; user-set multibody
//! coordinates reach the colliders only through `set_position`.

use crate::error::PlantError;
use crate::smooth::State;
use crate::solids::{Solid, distance, placed, solids, to_rapier};
use model::{Joint, JointKind, Pose, Robot};
use nalgebra::{Matrix3, SVector, Vector3};
use rapier3d::dynamics::{
    CCDSolver, GenericJoint, GenericJointBuilder, ImpulseJointSet, IntegrationParameters,
    IslandManager, JointAxesMask, JointAxis, MassProperties, Multibody, MultibodyJointHandle,
    MultibodyJointSet, RigidBodyBuilder, RigidBodyHandle, RigidBodySet, SoftBodySet,
    SpringCoefficients,
};
use rapier3d::geometry::{
    BroadPhaseBvh, ColliderBuilder, ColliderHandle, ColliderSet, Group, InteractionGroups,
    InteractionTestMode, NarrowPhase, SharedShape,
};
use rapier3d::math;
use rapier3d::pipeline::PhysicsPipeline;

/// Coulomb friction coefficient of arm against floor and arm against arm.
const CONTACT_FRICTION: f64 = 0.5;

/// Contacts are made for solids nearer than this; m.
pub(crate) const PREDICTION: f64 = 0.005;

/// Iterations of the constraint solver per sub-step, with and without position correction.
const ITERATIONS: usize = 8;

/// Contact gives way like a critically damped spring of this natural frequency: a weight sinks in by g/(2πf)²; Hz.
const CONTACT_FREQUENCY: f64 = 500.0;

/// Smallest principal inertia as a fraction of the link's largest: rapier3d inverts inertias, and drops singular ones.
const INERTIA_FLOOR: f64 = 1e-7;

/// Stand-in for the mass and inertia of a massless link; kg, kg·m².
const NO_MASS: f64 = 1e-9;

/// rapier3d's result of one sub-step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Response<const N: usize> {
    /// rapier's own state afterwards.
    pub(crate) state: State<N>,
    /// Its joint velocities if there were no constraints; rad/s.
    pub(crate) free: SVector<f64, N>,
    /// Number of contact points that carry force.
    pub(crate) contacts: u32,
    /// Number of contact points looked at, force or none.
    pub(crate) candidates: u32,
    /// Sum of the contact impulses from the world on the arm, base axes; N·s.
    pub(crate) impulse: Vector3<f64>,
}

pub(crate) struct World<const N: usize> {
    gravity: math::Vector,
    parameters: IntegrationParameters,
    pipeline: PhysicsPipeline,
    islands: IslandManager,
    broad_phase: BroadPhaseBvh,
    narrow_phase: NarrowPhase,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    impulse_joints: ImpulseJointSet,
    multibody_joints: MultibodyJointSet,
    soft_bodies: SoftBodySet,
    ccd_solver: CCDSolver,
    arm: MultibodyJointHandle,
    /// The arm's own joints; the places beyond are absent joints, which rapier does not see.
    joints: usize,
    /// The base at the places of absent joints.
    links: [RigidBodyHandle; N],
    /// Joint axes, link axes.
    axes: [math::Vector; N],
    sliding: [bool; N],
    /// Joint limits; rad, m.
    lower: [f64; N],
    upper: [f64; N],
    solids: Vec<Solid>,
    /// Which solids may touch which; `None` is the floor.
    pairs: Vec<(usize, Option<usize>)>,
    floor: Option<(math::Pose, SharedShape)>,
    moving: Vec<ColliderHandle>,
}

/// The arm's links and joints in rapier3d's sets.
struct Arm<const N: usize> {
    bodies: RigidBodySet,
    joints: MultibodyJointSet,
    base: RigidBodyHandle,
    /// The base at the places of absent joints.
    links: [RigidBodyHandle; N],
    /// Joint axes, link axes.
    axes: [math::Vector; N],
    /// The last joint, which leads to the multibody of all.
    last: MultibodyJointHandle,
}

impl<const N: usize> Arm<N> {
    /// The arm with all joints at zero, undamped, with the drives' inertia and, where asked for, the joints' dry friction.
    ///
    /// # Errors
    /// [`PlantError`] for an arm without joints, or a link whose inertia is none.
    fn new(robot: &Robot, dry_friction: bool) -> Result<Self, PlantError> {
        let (mut bodies, mut joints) = (RigidBodySet::new(), MultibodyJointSet::new());
        let base = bodies.insert(RigidBodyBuilder::fixed());
        let (mut links, mut axes, mut last) = ([base; N], [math::Vector::ZERO; N], None);
        for (i, joint) in robot.joints.iter().enumerate() {
            let mass = mass_properties(joint)?;
            links[i] = bodies.insert(
                RigidBodyBuilder::dynamic()
                    .can_sleep(false)
                    .additional_mass_properties(mass),
            );
            axes[i] = math::Vector::new(joint.axis.x, joint.axis.y, joint.axis.z);
            let parent = if i == 0 { base } else { links[i - 1] };
            last = joints.insert(parent, links[i], jointed(joint), true);
        }
        let last = last.ok_or(PlantError::NoJoints)?;
        let (multibody, _) = joints.get_mut(last).ok_or(PlantError::NoJoints)?;
        multibody.forward_kinematics(&bodies, true);
        multibody.damping_mut().fill(0.0);
        for (i, joint) in robot.joints.iter().enumerate() {
            multibody.armature_mut()[i] = joint.armature;
            multibody.frictions_mut()[i] = if dry_friction {
                joint.coulomb_friction
            } else {
                0.0
            };
        }
        Ok(Self {
            bodies,
            joints,
            base,
            links,
            axes,
            last,
        })
    }

    /// Gives each solid a collider that meets its partners in `pairs` alone; the colliders on links.
    fn collide(
        &mut self,
        solids: &[Solid],
        pairs: &[(usize, Option<usize>)],
        colliders: &mut ColliderSet,
    ) -> Vec<ColliderHandle> {
        let mut moving = Vec::new();
        for (k, solid) in solids.iter().enumerate() {
            let partners = pairs.iter().filter_map(|&(a, b)| match b {
                None if a == k => Some(FLOOR),
                Some(b) if a == k => Some(group(solids[b].link)),
                Some(b) if b == k => Some(group(solids[a].link)),
                _ => None,
            });
            let collider = ColliderBuilder::new(solid.shape.clone())
                .position(to_rapier(&solid.X_LS))
                .density(0.0)
                .friction(CONTACT_FRICTION)
                .collision_groups(groups(
                    group(solid.link),
                    partners.fold(Group::NONE, |all, g| all | g),
                ));
            let body = solid.link.map_or(self.base, |i| self.links[i]);
            let handle = colliders.insert_with_parent(collider, body, &mut self.bodies);
            if solid.link.is_some() {
                moving.push(handle);
            }
        }
        moving
    }
}

/// A joint in rapier3d's terms, within its range.
fn jointed(joint: &Joint) -> GenericJoint {
    // rapier's joints turn about, and slide along, the x axis of their frame.
    let to_axis = Pose::rotation(x_to(&joint.axis));
    let (free, locked) = match joint.kind {
        JointKind::Prismatic => (JointAxis::LinX, JointAxesMask::LOCKED_PRISMATIC_AXES),
        JointKind::Revolute | JointKind::Continuous => {
            (JointAxis::AngX, JointAxesMask::LOCKED_REVOLUTE_AXES)
        }
    };
    let frames = GenericJointBuilder::new(locked)
        .local_frame1(to_rapier(&(joint.X_PJ * to_axis)))
        .local_frame2(to_rapier(&to_axis));
    if joint.lower.is_finite() || joint.upper.is_finite() {
        return frames
            .limits(
                free,
                [joint.lower.max(-f64::MAX), joint.upper.min(f64::MAX)],
            )
            .build();
    }
    frames.build()
}

/// rapier3d's settings for sub-steps of `h` s.
fn parameters(h: f64) -> IntegrationParameters {
    let softness = SpringCoefficients::new(CONTACT_FREQUENCY, 1.0);
    IntegrationParameters {
        dt: h,
        num_solver_iterations: 1,
        num_internal_pgs_iterations: ITERATIONS,
        num_internal_stabilization_iterations: ITERATIONS,
        contact_softness: softness,
        static_contact_softness: softness,
        normalized_prediction_distance: PREDICTION,
        contact_recycling: false,
        contact_clustering: false,
        // Positions are ours: rapier's are a proposal.
        max_ccd_substeps: 0,
        ..IntegrationParameters::default()
    }
}

impl<const N: usize> World<N> {
    /// The arm at `q`, its floor and what may touch what, with sub-steps of `h` s.
    pub(crate) fn new(
        robot: &Robot,
        q: &SVector<f64, N>,
        X_BL: &[Pose; N],
        floor_m: Option<f64>,
        self_collision: bool,
        dry_friction: bool,
        h: f64,
    ) -> Result<Self, PlantError> {
        let solids = solids(robot);
        let floor = floor_m.map(|z| {
            (
                math::Pose::from_translation(math::Vector::new(0.0, 0.0, z)),
                SharedShape::halfspace(math::Vector::Z),
            )
        });
        let pairs = touching(robot, &solids, floor.as_ref(), X_BL, self_collision)?;

        let mut arm = Arm::new(robot, dry_friction)?;
        let mut colliders = ColliderSet::new();
        let moving = arm.collide(&solids, &pairs, &mut colliders);
        if let Some((pose, shape)) = &floor {
            let collider = ColliderBuilder::new(shape.clone())
                .position(*pose)
                .friction(CONTACT_FRICTION);
            colliders.insert(collider.collision_groups(groups(FLOOR, Group::ALL)));
        }
        let g = robot.gravity;
        let mut world = Self {
            gravity: math::Vector::new(g.x, g.y, g.z),
            parameters: parameters(h),
            pipeline: PhysicsPipeline::new(),
            islands: IslandManager::new(),
            broad_phase: BroadPhaseBvh::new(),
            narrow_phase: NarrowPhase::new(),
            bodies: arm.bodies,
            colliders,
            impulse_joints: ImpulseJointSet::new(),
            multibody_joints: arm.joints,
            soft_bodies: SoftBodySet::new(),
            ccd_solver: CCDSolver::new(),
            arm: arm.last,
            links: arm.links,
            axes: arm.axes,
            joints: robot.dof(),
            sliding: std::array::from_fn(|i| {
                robot
                    .joints
                    .get(i)
                    .is_some_and(|joint| joint.kind == JointKind::Prismatic)
            }),
            lower: std::array::from_fn(|i| {
                robot
                    .joints
                    .get(i)
                    .map_or(f64::NEG_INFINITY, |joint| joint.lower)
            }),
            upper: std::array::from_fn(|i| {
                robot
                    .joints
                    .get(i)
                    .map_or(f64::INFINITY, |joint| joint.upper)
            }),
            solids,
            pairs,
            floor,
            moving,
        };
        // Pairs with the floor are found once and for all, in one order, whatever is stepped later.
        world.step(&State::at_rest(*q), &SVector::zeros(), h);
        Ok(world)
    }

    /// Least distance between any two solids that may touch; m. ∞ if none may.
    pub(crate) fn clearance(&self, X_BL: &[Pose; N]) -> f64 {
        let between = |&(a, b): &(usize, Option<usize>)| {
            let of = |k: usize| placed(&self.solids[k], X_BL);
            match (b, &self.floor) {
                (Some(b), _) => distance(
                    (&of(a), &self.solids[a].shape),
                    (&of(b), &self.solids[b].shape),
                ),
                (None, Some((pose, shape))) => {
                    distance((&of(a), &self.solids[a].shape), (pose, shape))
                }
                (None, None) => f64::INFINITY,
            }
        };
        self.pairs.iter().map(between).fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// One sub-step of `h` s from `x` with joint torques `tau`, rapier's way.
    ///
    /// Allocates: rapier3d does, a few small matrices a step.
    pub(crate) fn step(&mut self, x: &State<N>, tau: &SVector<f64, N>, h: f64) -> Response<N> {
        self.parameters.dt = h;
        self.load(x);
        self.push(tau);
        self.pipeline.step(
            self.gravity,
            &self.parameters,
            &mut self.islands,
            &mut self.broad_phase,
            &mut self.narrow_phase,
            &mut self.bodies,
            &mut self.colliders,
            &mut self.impulse_joints,
            &mut self.multibody_joints,
            &mut self.soft_bodies,
            &mut self.ccd_solver,
            &(),
            &(),
        );
        let (contacts, candidates, impulse) = self.contacts();
        let Some((multibody, _)) = self.multibody_joints.get(self.arm) else {
            unreachable!("the arm is never removed from the world")
        };
        let velocity = multibody.generalized_velocity();
        let acceleration = multibody.generalized_acceleration();
        let (mut state, mut free) = (*x, x.qdot);
        for i in 0..self.joints {
            (state.q[i], state.qdot[i]) = (coordinate(multibody, i, self.sliding[i]), velocity[i]);
            free[i] = x.qdot[i] + self.parameters.dt * acceleration[i];
        }
        Response {
            state,
            free,
            contacts,
            candidates,
            impulse,
        }
    }

    /// Puts the arm into state `x`, to the last bit.
    fn load(&mut self, x: &State<N>) {
        let Some((multibody, _)) = self.multibody_joints.get_mut(self.arm) else {
            unreachable!("the arm is never removed from the world")
        };
        // Coordinates can only be displaced. A displacement rounds, but less each time: a − b is exact for a ≈ b
        // (Sterbenz), so that the second or third one lands exactly.
        for _ in 0..4 {
            let mut displacement = [0.0; N];
            for (i, d) in displacement[..self.joints].iter_mut().enumerate() {
                *d = x.q[i] - coordinate(multibody, i, self.sliding[i]);
            }
            if displacement.iter().all(|d| *d == 0.0) {
                break;
            }
            multibody.apply_displacements(&displacement[..self.joints]);
        }
        // rapier makes a constraint of each limited joint, which is solved in every iteration and does nothing within the limits.
        for i in 0..self.joints {
            if let Some(link) = multibody.link_mut(i + 1) {
                let is_beyond = x.q[i] < self.lower[i] || x.q[i] > self.upper[i];
                let axis = if self.sliding[i] {
                    JointAxesMask::LIN_X
                } else {
                    JointAxesMask::ANG_X
                };
                link.joint.data.limit_axes = if is_beyond {
                    axis
                } else {
                    JointAxesMask::empty()
                };
            }
        }
        multibody
            .generalized_velocity_mut()
            .copy_from_slice(&x.qdot.as_slice()[..self.joints]);
        multibody.forward_kinematics(&self.bodies, false);
        for (i, link) in self.links[..self.joints].iter().enumerate() {
            if let (Some(body), Some(at)) = (self.bodies.get_mut(*link), multibody.link(i + 1)) {
                body.set_position(*at.local_to_world(), false);
            }
        }
    }

    /// Applies joint torques as equal and opposite torques (forces, for a sliding joint) on the links they join.
    fn push(&mut self, tau: &SVector<f64, N>) {
        for link in &self.links[..self.joints] {
            self.bodies[*link].reset_forces(false);
            self.bodies[*link].reset_torques(false);
        }
        for i in 0..self.joints {
            let child = &mut self.bodies[self.links[i]];
            let effort = *child.rotation() * self.axes[i] * tau[i];
            let at = child.center_of_mass();
            if self.sliding[i] {
                child.add_force(effort, false);
            } else {
                child.add_torque(effort, false);
            }
            if i == 0 {
                continue;
            }
            let parent = &mut self.bodies[self.links[i - 1]];
            if self.sliding[i] {
                parent.add_force_at_point(-effort, at, false);
            } else {
                parent.add_torque(-effort, false);
            }
        }
    }

    fn contacts(&self) -> (u32, u32, Vector3<f64>) {
        let (mut carrying, mut candidates, mut impulse) = (0, 0, math::Vector::ZERO);
        for pair in self.narrow_phase.contact_pairs() {
            let moves = |collider: ColliderHandle| self.moving.contains(&collider);
            // Between two links the impulses cancel; against the base or the floor they are the world's.
            let sign = match (moves(pair.collider1), moves(pair.collider2)) {
                (true, true) => 0.0,
                (false, _) => 1.0,
                (true, false) => -1.0,
            };
            for manifold in pair.manifolds() {
                for point in manifold
                    .points
                    .iter()
                    .filter(|point| point.dist < PREDICTION)
                {
                    candidates += 1;
                    if point.data.impulse > 0.0 {
                        carrying += 1;
                        // The normal points from 1 to 2; the tangential impulse is the one on 1.
                        let on_2 = manifold.data.normal * point.data.impulse
                            - point.data.warmstart_tangent_world;
                        impulse += sign * on_2;
                    }
                }
            }
        }
        (
            carrying,
            candidates,
            Vector3::new(impulse.x, impulse.y, impulse.z),
        )
    }
}

/// The floor's group; a link's is [`group`].
const FLOOR: Group = Group::GROUP_32;

fn group(link: Option<usize>) -> Group {
    Group::from_bits_truncate(1 << link.map_or(0, |i| i + 1))
}

fn groups(memberships: Group, filter: Group) -> InteractionGroups {
    InteractionGroups::new(memberships, filter, InteractionTestMode::And)
}

/// Which solids may touch which: every link the floor; with `self_collision`, the solids of two links (the base is one)
/// that are not neighbours and do not overlap at the start.
///
/// Neighbours are links with nothing solid between them: the links of a spherical wrist are all neighbours of the forearm
/// if only the last one has a solid.
fn touching<const N: usize>(
    robot: &Robot,
    solids: &[Solid],
    floor: Option<&(math::Pose, SharedShape)>,
    X_BL: &[Pose; N],
    self_collision: bool,
) -> Result<Vec<(usize, Option<usize>)>, PlantError> {
    let at: Vec<math::Pose> = solids.iter().map(|solid| placed(solid, X_BL)).collect();
    let mut pairs = Vec::new();
    if let Some(floor) = floor {
        for (k, solid) in solids.iter().enumerate() {
            let Some(i) = solid.link else { continue };
            if distance((&at[k], &solid.shape), (&floor.0, &floor.1)) == 0.0 {
                let link = robot.joints[i].link.clone();
                return Err(PlantError::StartInFloor {
                    link,
                    floor_m: floor.0.translation.z,
                });
            }
            pairs.push((k, None));
        }
    }
    if self_collision {
        let mut links: Vec<Option<usize>> = solids.iter().map(|solid| solid.link).collect();
        links.sort_unstable();
        links.dedup();
        let of = |link: Option<usize>| (0..solids.len()).filter(move |k| solids[*k].link == link);
        for (place, near) in links.iter().enumerate() {
            for far in links.iter().skip(place + 2) {
                let both: Vec<(usize, usize)> = of(*near)
                    .flat_map(|a| of(*far).map(move |b| (a, b)))
                    .collect();
                let apart = |&(a, b): &(usize, usize)| {
                    distance((&at[a], &solids[a].shape), (&at[b], &solids[b].shape)) > 0.0
                };
                if both.iter().all(apart) {
                    pairs.extend(both.into_iter().map(|(a, b)| (a, Some(b))));
                }
            }
        }
    }
    Ok(pairs)
}

/// The mass of a link as rapier3d can hold it.
///
/// rapier3d stores inverse inertias. A principal inertia of zero (a link of which only the part that its joint can feel was
/// measured) would make all three vanish, so each is raised to [`INERTIA_FLOOR`] of the largest. The master state does
/// not see this: it only enters how an impulse is shared between joints.
fn mass_properties(joint: &model::Joint) -> Result<MassProperties, PlantError> {
    let principal = joint.inertia.symmetric_eigenvalues();
    let (least, most) = (principal.min(), principal.max());
    if least < -INERTIA_FLOOR * most.abs() {
        return Err(PlantError::NotRealisable {
            link: joint.link.clone(),
            least,
        });
    }
    let floor = (INERTIA_FLOOR * most).max(NO_MASS);
    let inertia = joint.inertia + Matrix3::identity() * (floor - least).max(0.0);
    let column = |j: usize| math::Vector::new(inertia[(0, j)], inertia[(1, j)], inertia[(2, j)]);
    let com = math::Vector::new(joint.com.x, joint.com.y, joint.com.z);
    let inertia = math::Matrix::from_cols(column(0), column(1), column(2));
    Ok(MassProperties::with_inertia_matrix(
        com,
        joint.mass.max(NO_MASS),
        inertia,
    ))
}

/// Joint i's coordinate in the multibody, whose link 0 is the base.
fn coordinate(multibody: &Multibody, i: usize, sliding: bool) -> f64 {
    let axis = if sliding { 0 } else { 3 };
    multibody
        .link(i + 1)
        .map_or(f64::NAN, |link| link.joint().coords()[axis])
}

/// A rotation whose x axis is the unit vector `axis`.
fn x_to(axis: &Vector3<f64>) -> Matrix3<f64> {
    let mut e = Vector3::zeros();
    e[axis.iamin()] = 1.0;
    let y = (e - axis * axis.dot(&e)).normalize();
    Matrix3::from_columns(&[*axis, y, axis.cross(&y)])
}
