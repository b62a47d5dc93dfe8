//! The arm and its floor in rapier3d: what constraints do to the arm in one sub-step.
//!
//! Everything that rapier3d needs special care for is here (and nowhere else):
//! a multibody's root is a free joint until the first `forward_kinematics(_, true)`; joints are damped by default;
//! torques persist until they are reset; there is no generalised force, so that a joint's torque is applied as equal and
//! opposite torques on its two links; `num_solver_iterations` counts sub-steps, not iterations; user-set multibody
//! coordinates reach the colliders only through `set_position`.

use crate::error::PlantError;
use crate::smooth::State;
use crate::solids::{FLOOR, Solid, distance, floor, matrix, placed, solids, to_rapier, vector};
use model::{Joint, JointKind, Pose, Robot};
use nalgebra::{Matrix3, SVector, Vector3};
use rapier3d::dynamics::{
    GenericJoint, GenericJointBuilder, IntegrationParameters, JointAxesMask, JointAxis,
    MassProperties, Multibody, MultibodyJointHandle, RigidBodyBuilder, RigidBodyHandle,
    SpringCoefficients,
};
use rapier3d::geometry::{
    ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode,
};
use rapier3d::math;
use rapier3d::pipeline::PhysicsWorld;
use shared_types::scenario::Plant as Options;

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

/// A joint and its link in rapier3d.
struct Jointed {
    link: RigidBodyHandle,
    /// Link axes.
    axis: math::Vector,
    slides: bool,
    /// Limits; rad, m.
    lower: f64,
    upper: f64,
}

pub(crate) struct World {
    physics: PhysicsWorld,
    /// The same before its first contact.
    fresh: PhysicsWorld,
    /// The last joint, which leads to the multibody of all.
    arm: MultibodyJointHandle,
    /// The arm's own joints: absent ones are none of rapier's.
    joints: Vec<Jointed>,
    /// The floor is the last, where there is one.
    solids: Vec<Solid>,
    /// Which solids may touch which.
    pairs: Vec<(usize, usize)>,
    /// Colliders on links.
    moving: Vec<ColliderHandle>,
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

/// rapier3d's settings; a sub-step brings its length.
fn parameters() -> IntegrationParameters {
    let softness = SpringCoefficients::new(CONTACT_FREQUENCY, 1.0);
    IntegrationParameters {
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

impl World {
    /// The arm at `q`, its floor and what may touch what.
    ///
    /// # Errors
    /// [`PlantError`] for an arm in the floor, or a link whose inertia is none.
    pub(crate) fn new<const N: usize>(
        robot: &Robot,
        q: &SVector<f64, N>,
        X_BL: &[Pose; N],
        options: &Options,
        tick_s: f64,
    ) -> Result<Self, PlantError> {
        let mut solids = solids(robot);
        solids.extend(options.floor_m.map(floor));
        let mut physics = PhysicsWorld {
            gravity: vector(&robot.gravity),
            integration_parameters: parameters(),
            ..PhysicsWorld::default()
        };
        let pairs = touching(robot, &solids, X_BL, options.self_collision)?;
        let base = physics.bodies.insert(RigidBodyBuilder::fixed());
        let (mut joints, mut arm) = (Vec::new(), None);
        for joint in &robot.joints {
            let link = RigidBodyBuilder::dynamic()
                .can_sleep(false)
                .additional_mass_properties(mass_properties(joint)?);
            let link = physics.bodies.insert(link);
            let parent = joints.last().map_or(base, |last: &Jointed| last.link);
            arm = (physics.multibody_joints).insert(parent, link, jointed(joint), true);
            joints.push(Jointed {
                link,
                axis: vector(&joint.axis),
                slides: joint.kind == JointKind::Prismatic,
                lower: joint.lower,
                upper: joint.upper,
            });
        }
        let arm = arm.expect("a model has joints, and each a link of its own");
        let (multibody, _) = (physics.multibody_joints.get_mut(arm)).expect("it was inserted");
        multibody.forward_kinematics(&physics.bodies, true);
        multibody.damping_mut().fill(0.0);
        for (i, joint) in robot.joints.iter().enumerate() {
            multibody.armature_mut()[i] = joint.armature;
            let dry = joint.coulomb_friction;
            multibody.frictions_mut()[i] = if options.friction { dry } else { 0.0 };
        }
        let mut world = Self {
            physics,
            fresh: PhysicsWorld::default(),
            arm,
            joints,
            solids,
            pairs,
            moving: Vec::new(),
        };
        world.collide(base);
        // Pairs with the floor are found once and for all, in one order, whatever is stepped later.
        let h = tick_s / f64::from(options.substeps);
        world.step(&State::at_rest(*q), &SVector::zeros(), h);
        std::mem::swap(&mut world.physics, &mut world.fresh);
        world.forget();
        Ok(world)
    }

    /// Forgets all contacts: what it computes then follows from the state of the arm alone.
    pub(crate) fn forget(&mut self) {
        let fresh = &self.fresh;
        self.physics = PhysicsWorld {
            gravity: fresh.gravity,
            integration_parameters: fresh.integration_parameters,
            islands: fresh.islands.clone(),
            broad_phase: fresh.broad_phase.clone(),
            narrow_phase: fresh.narrow_phase.clone(),
            bodies: fresh.bodies.clone(),
            colliders: fresh.colliders.clone(),
            multibody_joints: fresh.multibody_joints.clone(),
            ..PhysicsWorld::default()
        };
    }

    /// Gives each solid a collider that meets its partners alone.
    fn collide(&mut self, base: RigidBodyHandle) {
        for (k, solid) in self.solids.iter().enumerate() {
            let partners = self.pairs.iter().filter_map(|&(a, b)| match (a, b) {
                (a, b) if a == k => Some(self.solids[b].group),
                (a, b) if b == k => Some(self.solids[a].group),
                _ => None,
            });
            let filter = partners.fold(Group::NONE, |all, group| all | group);
            let groups = InteractionGroups::new(solid.group, filter, InteractionTestMode::And);
            let collider = ColliderBuilder::new(solid.shape.clone())
                .position(to_rapier(&solid.X_LS))
                .density(0.0)
                .friction(CONTACT_FRICTION)
                .collision_groups(groups);
            let (bodies, colliders) = (&mut self.physics.bodies, &mut self.physics.colliders);
            let carrier = solid.link.map_or(base, |i| self.joints[i].link);
            let handle = if solid.group == FLOOR {
                colliders.insert(collider)
            } else {
                colliders.insert_with_parent(collider, carrier, bodies)
            };
            if solid.link.is_some() {
                self.moving.push(handle);
            }
        }
    }

    /// Least distance between any two solids that may touch; m. ∞ if none may.
    pub(crate) fn clearance<const N: usize>(&self, X_BL: &[Pose; N]) -> f64 {
        let between = |&(a, b): &(usize, usize)| {
            let [a, b] = [a, b].map(|k| &self.solids[k]);
            distance((&placed(a, X_BL), a), (&placed(b, X_BL), b))
        };
        self.pairs.iter().map(between).fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// One sub-step of `h` s from `x` with joint torques `tau`, rapier's way.
    ///
    /// Allocates: rapier3d does, a few small matrices a step.
    pub(crate) fn step<const N: usize>(
        &mut self,
        x: &State<N>,
        tau: &SVector<f64, N>,
        h: f64,
    ) -> Response<N> {
        self.physics.integration_parameters.dt = h;
        self.load(x);
        self.push(tau);
        self.physics.step();
        let (contacts, candidates, impulse) = self.contacts();
        let Some((multibody, _)) = self.physics.multibody_joints.get(self.arm) else {
            unreachable!("the arm is never removed from the world")
        };
        let velocity = multibody.generalized_velocity();
        let acceleration = multibody.generalized_acceleration();
        let (mut state, mut free) = (*x, x.qdot);
        for (i, joint) in self.joints.iter().enumerate() {
            state.q[i] = coordinate(multibody, i, joint.slides);
            state.qdot[i] = velocity[i];
            free[i] = x.qdot[i] + h * acceleration[i];
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
    fn load<const N: usize>(&mut self, x: &State<N>) {
        let (physics, joints) = (&mut self.physics, &self.joints);
        let Some((multibody, _)) = physics.multibody_joints.get_mut(self.arm) else {
            unreachable!("the arm is never removed from the world")
        };
        // Coordinates can only be displaced. A displacement rounds, but less each time: a − b is exact for a ≈ b
        // (Sterbenz), so that the second or third one lands exactly.
        for _ in 0..4 {
            let mut displacement = [0.0; N];
            for (i, joint) in joints.iter().enumerate() {
                displacement[i] = x.q[i] - coordinate(multibody, i, joint.slides);
            }
            if displacement == [0.0; N] {
                break;
            }
            multibody.apply_displacements(&displacement[..joints.len()]);
        }
        // rapier makes a constraint of each limited joint, which is solved in every iteration and does nothing within the limits.
        for (i, joint) in joints.iter().enumerate() {
            if let Some(link) = multibody.link_mut(i + 1) {
                let is_beyond = x.q[i] < joint.lower || x.q[i] > joint.upper;
                link.joint.data.limit_axes = match (is_beyond, joint.slides) {
                    (false, _) => JointAxesMask::empty(),
                    (true, true) => JointAxesMask::LIN_X,
                    (true, false) => JointAxesMask::ANG_X,
                };
            }
        }
        let velocity = &x.qdot.as_slice()[..joints.len()];
        multibody
            .generalized_velocity_mut()
            .copy_from_slice(velocity);
        multibody.forward_kinematics(&physics.bodies, false);
        for (i, joint) in joints.iter().enumerate() {
            let body = physics.bodies.get_mut(joint.link);
            if let (Some(body), Some(at)) = (body, multibody.link(i + 1)) {
                body.set_position(*at.local_to_world(), false);
            }
        }
    }

    /// Applies joint torques as equal and opposite torques (forces, for a sliding joint) on the links they join.
    fn push<const N: usize>(&mut self, tau: &SVector<f64, N>) {
        let bodies = &mut self.physics.bodies;
        for joint in &self.joints {
            bodies[joint.link].reset_forces(false);
            bodies[joint.link].reset_torques(false);
        }
        let mut parent: Option<RigidBodyHandle> = None;
        for (i, joint) in self.joints.iter().enumerate() {
            let child = &mut bodies[joint.link];
            let effort = *child.rotation() * joint.axis * tau[i];
            let at = child.center_of_mass();
            if joint.slides {
                child.add_force(effort, false);
            } else {
                child.add_torque(effort, false);
            }
            let parent = parent.replace(joint.link).map(|link| &mut bodies[link]);
            match (parent, joint.slides) {
                (None, _) => {}
                (Some(parent), true) => parent.add_force_at_point(-effort, at, false),
                (Some(parent), false) => parent.add_torque(-effort, false),
            }
        }
    }

    /// Contact points that carry force, those that were looked at, and the sum of the impulses from the world on the arm.
    fn contacts(&self) -> (u32, u32, Vector3<f64>) {
        let (mut carrying, mut candidates, mut impulse) = (0, 0, math::Vector::ZERO);
        for pair in self.physics.narrow_phase.contact_pairs() {
            let moves = |collider: ColliderHandle| self.moving.contains(&collider);
            // Between two links the impulses cancel; against the base or the floor they are the world's.
            let sign = match (moves(pair.collider1), moves(pair.collider2)) {
                (true, true) => 0.0,
                (false, _) => 1.0,
                (true, false) => -1.0,
            };
            for manifold in pair.manifolds() {
                let points = manifold.points.iter();
                for point in points.filter(|point| point.dist < PREDICTION) {
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
        (carrying, candidates, impulse.to_array().into())
    }
}

/// Which solids may touch which: every link the floor; with `self_collision`, the solids of two links (the base is one)
/// that are not neighbours and do not overlap at the start.
///
/// Neighbours are links with nothing solid between them: the links of a spherical wrist are all neighbours of the forearm
/// if only the last one has a solid.
fn touching<const N: usize>(
    robot: &Robot,
    solids: &[Solid],
    X_BL: &[Pose; N],
    self_collision: bool,
) -> Result<Vec<(usize, usize)>, PlantError> {
    let at: Vec<math::Pose> = solids.iter().map(|solid| placed(solid, X_BL)).collect();
    let is_apart = |a: usize, b: usize| distance((&at[a], &solids[a]), (&at[b], &solids[b])) > 0.0;
    let mut pairs = Vec::new();
    let is_floor = |solid: &Solid| solid.group == FLOOR;
    let floor = solids.iter().position(is_floor).unwrap_or(solids.len());
    for (k, solid) in solids.iter().enumerate() {
        let (Some(i), true) = (solid.link, floor < solids.len()) else {
            continue;
        };
        if !is_apart(k, floor) {
            let link = robot.joints[i].link.clone();
            let floor_m = solids[floor].X_LS.p.z;
            return Err(PlantError::StartInFloor { link, floor_m });
        }
        pairs.push((k, floor));
    }
    if self_collision {
        let mut links: Vec<Option<usize>> =
            solids[..floor].iter().map(|solid| solid.link).collect();
        links.sort_unstable();
        links.dedup();
        let of = |link: Option<usize>| (0..floor).filter(move |k| solids[*k].link == link);
        for (place, near) in links.iter().enumerate() {
            for far in links.iter().skip(place + 2) {
                let both: Vec<(usize, usize)> = of(*near)
                    .flat_map(|a| of(*far).map(move |b| (a, b)))
                    .collect();
                if both.iter().all(|&(a, b)| is_apart(a, b)) {
                    pairs.extend(both);
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
    Ok(MassProperties::with_inertia_matrix(
        vector(&joint.com),
        joint.mass.max(NO_MASS),
        matrix(&inertia),
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
