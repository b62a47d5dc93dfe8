//! An arm's shape: one mesh per link, in the link's frame. PURE.

use std::collections::BTreeSet;

use glam::{Mat3, Vec3};
use model::{Factors, Geometry, Joint, JointKind, Pose, Robot, Shape};
use nalgebra::Vector3;

use crate::meshes::Meshes;
use crate::solid::{Mesh, Placement, Rgba, disc};

const UPRIGHT: Placement = Placement::IDENTITY;
const SHELL: Rgba = 0xe4e2daff;
const JOINT: Rgba = 0x606874ff;
const DARK: Rgba = 0x343942ff;
const METAL: Rgba = 0xa8aeb6ff;

/// The meshes of an arm: the base's in the base frame, then each link's in its own.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Figure {
    pub(crate) base: Mesh,
    pub(crate) links: Vec<Mesh>,
    /// Where turning about each joint's axis is shown; none for a joint that slides.
    pub(crate) rings: Vec<Option<Ring>>,
    /// Each joint's frame in the link before it, at zero.
    pub(crate) joints: Vec<Placement>,
    /// The end-effector in the last link's frame; m.
    pub(crate) tip: Option<Vec3>,
    /// Sum of the links' lengths, for framing the view and scaling marks; m.
    pub(crate) reach: f32,
    /// The outermost corners of the links, in their frames.
    pub(crate) ends: Vec<Vec<Vec3>>,
}

/// A circle about a joint's axis, in the link's frame; m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ring {
    pub(crate) axis: Vec3,
    pub(crate) centre: Vec3,
    /// From the centre to where there is least of the link: unit, across the axis.
    pub(crate) out: Vec3,
    pub(crate) radius: f32,
}

impl Ring {
    /// About the middle of what the link's figure has along its axis: joints whose frames coincide keep apart.
    fn of(joint: &Joint, mesh: &Mesh, radius: f32) -> Option<Self> {
        let axis = vec3(&joint.axis).normalize_or(Vec3::Z);
        let along = mesh.positions.iter().map(|p| p.dot(axis));
        let (low, high) = along.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| {
            (low.min(z), high.max(z))
        });
        let middle = if low.is_finite() {
            (low + high) / 2.0
        } else {
            0.0
        };
        let body = mesh
            .positions
            .iter()
            .map(|p| p.reject_from_normalized(axis))
            .sum::<Vec3>();
        let body = (body / mesh.positions.len().max(1) as f32).clamp_length_max(1.0);
        let out = if body.length() > 0.1 * radius {
            axis.cross(body).normalize()
        } else {
            axis.any_orthonormal_vector()
        };
        (joint.kind != JointKind::Prismatic).then_some(Self {
            axis,
            centre: axis * middle,
            out,
            radius,
        })
    }
}

impl Figure {
    /// The robot's own meshes; else a PUMA with the proportions of its joints, its own shapes, or capsules; `floor_m` is the floor's height in the base frame.
    pub(crate) fn new(robot: &Robot, floor_m: f32, meshes: &Meshes) -> Self {
        let joints: f64 = robot.joints.iter().map(|joint| joint.X_PJ.p.norm()).sum();
        let tool = robot
            .frame(&robot.default_frame)
            .map_or(0.0, |frame| frame.X_LF.p.norm());
        let reach = ((joints + tool) as f32).max(0.1);
        let (base, links) = match robot.factors {
            Factors::Puma { .. } if meshes.0.is_empty() => puma(robot, floor_m),
            _ if robot.shapes.iter().any(|shape| is_drawn(shape, meshes)) => {
                let (mut base, links) = shapes(robot, reach, meshes);
                // Some arms stand on a body of their own.
                let is_low = base.positions.iter().any(|p| p.z < -0.2 * reach);
                if robot.task.0[2] && floor_m < -0.05 && !is_low {
                    pedestal(&mut base, floor_m, 0.075 * reach);
                }
                (base, links)
            }
            _ => capsules(robot, reach),
        };
        let ends = links.iter().map(Mesh::ends).collect();
        let rings = robot
            .joints
            .iter()
            .zip(&links)
            .map(|(joint, mesh)| Ring::of(joint, mesh, 0.13 * reach))
            .collect();
        let joints = robot
            .joints
            .iter()
            .map(|joint| placement(&joint.X_PJ))
            .collect();
        let tip = robot
            .frame(&robot.default_frame)
            .map(|frame| vec3(&frame.X_LF.p));
        Self {
            base,
            links,
            rings,
            joints,
            tip,
            reach,
            ends,
        }
    }

    /// The outermost corners of its links; base axes, m.
    pub(crate) fn corners(&self, links: &[Placement]) -> impl Iterator<Item = Vec3> {
        let places = self.ends.iter().zip(links);
        places.flat_map(|(ends, at)| ends.iter().map(|p| at.of(*p)))
    }
}

/// f64 to f32, for eyes.
pub(crate) fn vec3(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x as f32, v.y as f32, v.z as f32)
}

/// f64 to f32, for eyes.
pub(crate) fn placement(X: &Pose) -> Placement {
    Placement {
        R: Mat3::from_cols_slice(X.R.map(|x| x as f32).as_slice()),
        p: vec3(&X.p),
    }
}

/// The pose of a message: position and rotation matrix, column-major.
pub(crate) fn pose(p: &[f64; 3], R: &[f64; 9]) -> Placement {
    Placement {
        R: Mat3::from_cols_array(&R.map(|x| x as f32)),
        p: vec3(&(*p).into()),
    }
}

/// A solid's frame in the plane across `axis`: x stays x.
fn across(axis: Vec3) -> Placement {
    Placement::along(Vec3::ZERO, axis, Vec3::X)
}

/// The Unimation PUMA 560, in Craig's link frames: column, shoulder, upper arm, forearm, forked wrist, flange. Lengths come from the joints.
fn puma(robot: &Robot, floor: f32) -> (Mesh, Vec<Mesh>) {
    let origin = |i: usize| vec3(&robot.joints[i].X_PJ.p);
    let [fork, hub, flange] = puma_wrist();
    let links = vec![
        puma_shoulder(origin(1).y),
        puma_upper_arm(origin(2).x),
        puma_forearm(origin(2).z, origin(3)),
        fork,
        hub,
        flange,
    ];
    (puma_base(floor), links)
}

fn puma_base(floor: f32) -> Mesh {
    let mut base = Mesh::default();
    base.add_drum(UPRIGHT, 0.165, [floor, floor + 0.03], 0.008, DARK);
    base.add_cone(UPRIGHT, 0.125, 0.1, floor + 0.03, floor + 0.07, SHELL);
    base.add_drum(UPRIGHT, 0.1, [floor + 0.06, -0.175], 0.004, SHELL);
    base.add_drum(UPRIGHT, 0.112, [-0.2, -0.165], 0.006, JOINT);
    // The cable box at the back of the column.
    let behind = Placement::at(Vec3::new(-0.1, 0.0, floor + 0.2));
    base.add_box(behind, Vec3::new(0.09, 0.13, 0.26), DARK);
    base
}

fn puma_shoulder(offset: f32) -> Mesh {
    // The inner face of the upper arm; without a shoulder offset the arm sits on the trunk itself.
    let face = offset - 0.05;
    let (inner, outer) = ((face - 0.03).max(0.07), face.max(0.09));
    let lateral = across(Vec3::Y);
    let mut shoulder = Mesh::default();
    shoulder.add_drum(UPRIGHT, 0.1, [-0.16, 0.06], 0.02, SHELL);
    shoulder.add_drum(
        lateral,
        0.098,
        [-0.16, (face - 0.02).max(0.08)],
        0.02,
        SHELL,
    );
    shoulder.add_drum(lateral, 0.104, [inner, outer], 0.004, JOINT);
    shoulder
}

/// z2 is the shoulder's axis; the forearm runs at z2 = the elbow's offset, inside the upper arm.
fn puma_upper_arm(length: f32) -> Mesh {
    let outer = 0.055;
    let hull = [
        disc(-0.2, 0.0, 0.085),
        disc(0.0, 0.0, 0.118),
        disc(length, 0.0, 0.082),
    ];
    let mut upper = Mesh::default();
    upper.add_extrusion(UPRIGHT, &hull, -0.045, outer, 0.014, SHELL);
    for (x, radius, high, bevel, colour) in [
        (0.0, 0.075, 0.014, 0.005, JOINT),
        (length, 0.055, 0.01, 0.004, JOINT),
        (-0.2, 0.055, 0.008, 0.004, METAL),
    ] {
        let cap = [disc(x, 0.0, radius)];
        upper.add_extrusion(UPRIGHT, &cap, outer - 0.002, outer + high, bevel, colour);
    }
    upper
}

/// Frame 3 sits at the elbow; the forearm runs along −y3, its motors stand out behind along +y3.
fn puma_forearm(elbow_offset: f32, wrist: Vec3) -> Mesh {
    let (forearm, shift, half) = (-wrist.y, wrist.x, 0.045f32);
    let (near, far) = match elbow_offset < 0.0 {
        true => (half, 1.1 * half),
        false => (-1.1 * half, -half),
    };
    let hull = [
        disc(shift * 0.5, 0.14, 0.052),
        disc(0.0, 0.0, 0.08),
        disc(shift, -(forearm - 0.13), 0.046),
    ];
    let roll = Placement::along(wrist, -Vec3::Y, Vec3::X);
    let mut fore = Mesh::default();
    fore.add_drum(UPRIGHT, 0.07, [near - 0.004, far + 0.004], 0.002, JOINT);
    fore.add_extrusion(UPRIGHT, &hull, -half, half, 0.014, SHELL);
    fore.add_drum(roll, 0.043, [-0.15, -0.092], 0.004, SHELL);
    fore
}

/// Frames 4 to 6 meet at the wrist centre: a fork along z4, a hub on z5 = y4 between its prongs, a flange on z6.
fn puma_wrist() -> [Mesh; 3] {
    let [mut fork, mut hub, mut flange] = <[Mesh; 3]>::default();
    fork.add_drum(UPRIGHT, 0.045, [-0.09, -0.062], 0.005, JOINT);
    // In this solid's plane x is x4 and y is −z4.
    let prong = Placement::along(Vec3::ZERO, Vec3::Y, Vec3::X);
    let hull = [disc(0.0, 0.068, 0.03), disc(0.0, 0.0, 0.03)];
    for ([a, b], [c, d]) in [
        ([-0.043, -0.026], [-0.049, -0.04]),
        ([0.026, 0.043], [0.04, 0.049]),
    ] {
        fork.add_extrusion(prong, &hull, a, b, 0.004, METAL);
        fork.add_drum(prong, 0.017, [c, d], 0.002, DARK);
    }
    hub.add_drum(UPRIGHT, 0.03, [-0.0245, 0.0245], 0.003, DARK);
    hub.add_drum(across(-Vec3::Y), 0.022, [0.0, 0.036], 0.002, DARK);
    flange.add_drum(UPRIGHT, 0.034, [0.036, 0.05625], 0.003, METAL);
    hand(&mut flange, Placement::at(Vec3::Z * 0.05625), 1.0);
    [fork, hub, flange]
}

/// The pedestal of an arm whose base is above the floor.
fn pedestal(base: &mut Mesh, floor: f32, radius: f32) {
    base.add_drum(UPRIGHT, 1.7 * radius, [floor, floor + 0.02], 0.006, DARK);
    base.add_drum(UPRIGHT, radius, [floor + 0.01, -0.01], 0.004, JOINT);
    base.add_drum(UPRIGHT, 1.35 * radius, [-0.025, -0.001], 0.004, DARK);
}

/// Whether a shape can be drawn.
fn is_drawn(shape: &Shape, meshes: &Meshes) -> bool {
    match &shape.geometry {
        Geometry::Mesh { file, .. } => meshes.0.contains_key(file),
        _ => true,
    }
}

/// The longest side, of a mesh that has been read without end; m.
fn extent(geometry: &Geometry) -> f64 {
    match geometry {
        Geometry::Box { size } => size.amax(),
        Geometry::Cylinder { radius, length } | Geometry::Capsule { radius, length } => {
            length.max(2.0 * radius)
        }
        Geometry::Sphere { radius } => 2.0 * radius,
        Geometry::Mesh { .. } => f64::INFINITY,
    }
}

/// The robot's own visual geometry; a capsule for a link that lacks it, and a hand where the arm ends in a flange.
fn shapes(robot: &Robot, reach: f32, meshes: &Meshes) -> (Mesh, Vec<Mesh>) {
    let mut base = Mesh::default();
    let mut links = vec![Mesh::default(); robot.joints.len()];
    let lacking = robot.shapes.iter().filter(|shape| !is_drawn(shape, meshes));
    let lacking: BTreeSet<Option<usize>> = lacking.map(|shape| shape.joint).collect();
    // A shape without extent is none: its link would not be seen.
    for shape in robot
        .shapes
        .iter()
        .filter(|shape| extent(&shape.geometry) > 1e-4 * f64::from(reach))
        .filter(|shape| !shape.stands_in || lacking.contains(&shape.joint))
    {
        let (mesh, colour) = match shape.joint {
            None => (&mut base, DARK),
            Some(i) => (&mut links[i], if i % 2 == 0 { SHELL } else { METAL }),
        };
        add_shape(mesh, shape, colour, meshes);
    }
    let radius = 0.035 * reach;
    if base.positions.is_empty() && lacking.contains(&None) {
        bone(&mut base, vec3(&robot.joints[0].X_PJ.p), radius);
    }
    // Also where what is drawn, such as the fingers of a hand, hangs in the air without what is not.
    let is_apart = |link: &Mesh| link.positions.iter().all(|p| p.length() > 2.0 * radius);
    for (i, link) in links.iter_mut().enumerate() {
        if link.positions.is_empty() || lacking.contains(&Some(i)) && is_apart(link) {
            capsule(link, robot, i, radius);
        }
    }
    if let (Some(frame), Some(last)) = (robot.frame(&robot.default_frame), links.last_mut())
        && robot.task.0[2]
        && frame
            .joint
            .is_some_and(|joint| joint + 1 == robot.joints.len())
    {
        let E = placement(&frame.X_LF);
        let beyond = |p: &Vec3| (*p - E.p).dot(E.R.z_axis);
        if last.positions.iter().all(|p| beyond(p) < 0.02) {
            hand(last, E, reach.min(1.0));
        }
    }
    (base, links)
}

/// Adds a shape in its own colour, or in `colour` where it has none.
fn add_shape(mesh: &mut Mesh, shape: &Shape, colour: u32, meshes: &Meshes) {
    let packed = |rgba: [f64; 4]| u32::from_be_bytes(rgba.map(|part| (255.0 * part).round() as u8));
    let own = shape.colour.map(packed);
    let painted = own.unwrap_or(colour);
    let at = placement(&shape.X_LS);
    match &shape.geometry {
        Geometry::Mesh { file, scale } => {
            if let Some(scene) = meshes.0.get(file) {
                for (part, material) in scene.meshes.iter().zip(&scene.materials) {
                    let theirs = material.color.diffuse;
                    let theirs = theirs.map(|rgba| packed(rgba.map(f64::from)));
                    let colour = own.or(theirs).unwrap_or(colour);
                    mesh.add_triangles(at, vec3(scale), part, colour);
                }
            }
        }
        Geometry::Box { size } => mesh.add_box(at, vec3(size), painted),
        Geometry::Cylinder { radius, length } => {
            let (radius, half) = (*radius as f32, *length as f32 / 2.0);
            let bevel = (0.16 * radius).min(0.5 * half);
            mesh.add_drum(at, radius, [-half, half], bevel, painted);
        }
        Geometry::Sphere { radius } => mesh.add_sphere(at, *radius as f32, painted),
        Geometry::Capsule { radius, length } => {
            mesh.add_capsule(at, *radius as f32, *length as f32, painted)
        }
    }
}

/// A two-finger hand on a flange, drawn only: it shows how the flange is turned. `size`: 1 for an arm of a metre.
fn hand(mesh: &mut Mesh, flange: Placement, size: f32) {
    let mut part = |x: f32, z: f32, sides: [f32; 3], colour| {
        let at = Placement {
            R: flange.R,
            p: flange.of(size * Vec3::new(x, 0.0, z)),
        };
        mesh.add_box(at, size * Vec3::from(sides), colour);
    };
    part(0.0, 0.014, [0.085, 0.034, 0.028], DARK);
    for x in [-0.032, 0.032] {
        part(x, 0.052, [0.012, 0.024, 0.055], METAL);
    }
}

/// A capsule from each joint to the next, and a drum on each joint's axis.
fn capsules(robot: &Robot, reach: f32) -> (Mesh, Vec<Mesh>) {
    let radius = 0.035 * reach;
    let mut base = Mesh::default();
    let heights = [-1.5 * radius, -0.9 * radius];
    base.add_drum(UPRIGHT, 2.2 * radius, heights, 0.1 * radius, DARK);
    bone(&mut base, vec3(&robot.joints[0].X_PJ.p), radius);
    let links = (0..robot.joints.len()).map(|i| {
        let mut mesh = Mesh::default();
        capsule(&mut mesh, robot, i, radius);
        mesh
    });
    (base, links.collect())
}

/// The link of joint `i` as a drum on its axis and a capsule to the next joint, or to the end-effector frame.
fn capsule(mesh: &mut Mesh, robot: &Robot, i: usize, radius: f32) {
    let tip = robot
        .frame(&robot.default_frame)
        .map_or(Vec3::ZERO, |frame| vec3(&frame.X_LF.p));
    let end = robot
        .joints
        .get(i + 1)
        .map_or(tip, |next| vec3(&next.X_PJ.p));
    let axis = Placement::along(Vec3::ZERO, vec3(&robot.joints[i].axis), Vec3::X);
    let heights = [-1.25 * radius, 1.25 * radius];
    mesh.add_drum(axis, 1.3 * radius, heights, 0.15 * radius, JOINT);
    bone(mesh, end, radius);
}

/// A capsule from the origin to a place beyond its radius.
fn bone(mesh: &mut Mesh, end: Vec3, radius: f32) {
    let length = end.length();
    if length > radius {
        let at = Placement::along(end / 2.0, end, Vec3::X);
        mesh.add_capsule(at, radius, length, SHELL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_arm_has_a_figure() {
        for name in Robot::builtin_names() {
            let mut robot = Robot::builtin(name).expect("built in");
            // Shapes without extent are none: their link is seen all the same.
            for shape in robot
                .shapes
                .iter_mut()
                .filter(|shape| shape.joint == Some(1))
            {
                shape.geometry = Geometry::Box {
                    size: Vector3::zeros(),
                };
            }
            let figure = Figure::new(&robot, -0.6, &Meshes::default());
            assert_eq!(figure.links.len(), robot.dof());
            for mesh in figure.links.iter().chain([&figure.base]) {
                let vertices = mesh.positions.len() as u32;
                assert!(
                    mesh.triangles
                        .iter()
                        .flatten()
                        .all(|corner| *corner < vertices)
                );
                let is_near = |p: &Vec3| p.is_finite() && p.length() < 4.0;
                assert!(mesh.positions.iter().all(is_near), "{name}");
            }
            assert!(figure.links[1].positions.len() > 50, "{name}");
        }
    }
}
