//! An arm's shape: the primitives and meshes of its URDF or MJCF. PURE.

use std::collections::BTreeSet;

use glam::{Affine3, Vec3};
use model::{Geometry, Joint, Robot, Shape};
use shared_types::scenario::Surface;

use crate::facts::slides;
use crate::meshes::Meshes;
use crate::pose::{Rgba, along, placement, span, vec3};

const SHELL: Rgba = 0xe4e2daff;
const JOINT: Rgba = 0x606874ff;
const DARK: Rgba = 0x343942ff;
const METAL: Rgba = 0xa8aeb6ff;
const SURFACE: Rgba = 0x6f80984c;

/// The form of a part, m, centred at its frame, with its long axis along z.
pub(crate) enum Form {
    /// Full side lengths.
    Box(Vec3),
    Cylinder {
        radius: f32,
        length: f32,
    },
    /// `length` is between the centres of its caps: 0 for a ball.
    Capsule {
        radius: f32,
        length: f32,
    },
    Mesh(Mesh),
}

/// Triangles of one colour.
#[derive(Default)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
}

/// A piece of a link, or of the base.
pub(crate) struct Part {
    pub(crate) link: Option<usize>,
    /// In the frame of its link.
    pub(crate) at: Affine3,
    pub(crate) form: Form,
    pub(crate) colour: Rgba,
}

impl Part {
    fn new(link: Option<usize>, at: Affine3, form: Form, colour: Rgba) -> Self {
        Self {
            link,
            at,
            form,
            colour,
        }
    }

    /// A surface that the hand may touch: a ball, or a slab under a plane, wide enough for an arm of this reach; m.
    pub(crate) fn surface(surface: &Surface, reach: f32) -> Self {
        let (point, normal) = (vec3(&surface.point_m.into()), vec3(&surface.normal.into()));
        let (form, at) = match surface.radius_m {
            Some(radius) => {
                let (radius, length) = (radius as f32, 0.0);
                (
                    Form::Capsule { radius, length },
                    Affine3::from_translation(point),
                )
            }
            None => {
                let size = reach * Vec3::new(0.5, 0.5, 0.01);
                let centre = point - normal.normalize_or(Vec3::Z) * (0.5 * size.z);
                (Form::Box(size), along(centre, normal))
            }
        };
        Self::new(None, at, form, SURFACE)
    }

    /// Corners of a box about it, in the frame of its link.
    fn corners(&self) -> [Vec3; 8] {
        let about = |half: Vec3| [-half, half];
        let box_of = match &self.form {
            Form::Box(size) => about(*size / 2.0),
            Form::Cylinder { radius, length } => about(Vec3::new(*radius, *radius, length / 2.0)),
            Form::Capsule { radius, length } => {
                about(Vec3::splat(*radius) + Vec3::Z * (length / 2.0))
            }
            Form::Mesh(mesh) => span(mesh.positions.iter().copied()).unwrap_or_default(),
        };
        let side = |k: usize| box_of[k & 1];
        std::array::from_fn(|k| {
            let corner = Vec3::new(side(k).x, side(k >> 1).y, side(k >> 2).z);
            self.at.transform_point3(corner)
        })
    }
}

/// A circle about a joint's axis, in the link's frame; m.
pub(crate) struct Ring {
    pub(crate) axis: Vec3,
    pub(crate) centre: Vec3,
    pub(crate) radius: f32,
}

/// An arm as it is drawn.
pub(crate) struct Body {
    pub(crate) parts: Vec<Part>,
    /// The place at which turning about each joint's axis is shown; none for a joint that slides.
    pub(crate) rings: Vec<Option<Ring>>,
    /// Each joint's frame in the link before it, at zero.
    pub(crate) joints: Vec<Affine3>,
    /// The end-effector in the last link's frame; m.
    pub(crate) tip: Option<Vec3>,
    /// Sum of the links' lengths, for framing the view and scaling marks; m.
    pub(crate) reach: f32,
}

impl Body {
    /// The robot's own shapes; a capsule for a link that lacks them, a hand where the arm ends in a flange, and a base to stand on; `floor_m` is the
    /// floor's height in the base frame.
    pub(crate) fn new(robot: &Robot, floor_m: f32, meshes: &Meshes) -> Self {
        let joints: Vec<Affine3> = robot
            .joints
            .iter()
            .map(|joint| placement(&joint.X_PJ))
            .collect();
        let frame = robot.frame(&robot.default_frame);
        let tip = frame.map(|frame| vec3(&frame.X_LF.p));
        let reach = joints
            .iter()
            .map(|X_PJ| X_PJ.translation)
            .chain(tip)
            .map(Vec3::length)
            .sum::<f32>()
            .max(0.1);
        let mut body = Self {
            parts: Vec::new(),
            rings: Vec::new(),
            joints,
            tip,
            reach,
        };
        let shapes = robot.shapes.iter();
        let lacking: BTreeSet<Option<usize>> = shapes
            .filter(|shape| !meshes.has(&shape.geometry))
            .map(|shape| shape.joint)
            .collect();
        for shape in &robot.shapes {
            if !shape.stands_in || lacking.contains(&shape.joint) {
                body.add(shape, meshes);
            }
        }
        body.fill(robot, &lacking);
        if robot.task.0[2] {
            let last = Some(robot.dof() - 1);
            if let Some(frame) = frame.filter(|frame| frame.joint == last) {
                body.hand(last, &placement(&frame.X_LF));
            }
            body.stand(floor_m);
        }
        let ring = |(i, joint): (usize, &Joint)| {
            let axis = vec3(&joint.axis).normalize_or(Vec3::Z);
            // In the middle of its link along the axis: joints whose frames coincide keep apart.
            let [low, high] = body
                .corners_of(Some(i))
                .map(|p| p.dot(axis))
                .fold([0.0f32; 2], |[low, high], z| [low.min(z), high.max(z)]);
            (!slides(joint)).then_some(Ring {
                axis,
                centre: axis * (low + high) / 2.0,
                radius: 0.13 * reach,
            })
        };
        body.rings = robot.joints.iter().enumerate().map(ring).collect();
        body
    }

    /// The parts of a link, or of the base.
    pub(crate) fn of(&self, link: Option<usize>) -> impl Iterator<Item = &Part> {
        self.parts.iter().filter(move |part| part.link == link)
    }

    /// Corners of boxes about the parts of a link, in its frame.
    fn corners_of(&self, link: Option<usize>) -> impl Iterator<Item = Vec3> {
        self.of(link).flat_map(Part::corners)
    }

    /// The outermost corners of its links; base axes, m.
    pub(crate) fn corners(&self, links: &[Affine3]) -> impl Iterator<Item = Vec3> {
        let parts = self
            .parts
            .iter()
            .filter_map(|part| Some((part, links.get(part.link?)?)));
        parts.flat_map(|(part, link)| part.corners().map(|p| link.transform_point3(p)))
    }

    /// A shape in its own colour, or in its link's.
    fn add(&mut self, shape: &Shape, meshes: &Meshes) {
        let packed =
            |rgba: [f64; 4]| u32::from_be_bytes(rgba.map(|part| (255.0 * part).round() as u8));
        let own = shape.colour.map(packed);
        let usual = shape
            .joint
            .map_or(DARK, |i| if i % 2 == 0 { SHELL } else { METAL });
        let at = placement(&shape.X_LS);
        let capsule = |radius: f64, length: f64| Form::Capsule {
            radius: radius as f32,
            length: length as f32,
        };
        let form = match &shape.geometry {
            Geometry::Box { size } => Form::Box(vec3(size)),
            Geometry::Cylinder { radius, length } => Form::Cylinder {
                radius: *radius as f32,
                length: *length as f32,
            },
            Geometry::Sphere { radius } => capsule(*radius, 0.0),
            Geometry::Capsule { radius, length } => capsule(*radius, *length),
            Geometry::Mesh { file, scale } => {
                for (mesh, theirs) in meshes.of_file(file, vec3(scale)) {
                    let theirs = theirs.map(|rgba| packed(rgba.map(f64::from)));
                    let (form, colour) = (Form::Mesh(mesh), own.or(theirs));
                    let colour = colour.unwrap_or(usual);
                    self.parts.push(Part::new(shape.joint, at, form, colour));
                }
                return;
            }
        };
        let part = Part::new(shape.joint, at, form, own.unwrap_or(usual));
        // A shape without extent is none: its link would not be seen.
        let corners = part.corners();
        if corners[0].distance(corners[7]) > 1e-4 * self.reach {
            self.parts.push(part);
        }
    }

    /// A drum on the joint's axis and a capsule to the next joint where a link would not be seen, or where its fingers hang in the air without it.
    fn fill(&mut self, robot: &Robot, lacking: &BTreeSet<Option<usize>>) {
        let radius = 0.035 * self.reach;
        if self.of(None).next().is_none() {
            self.bone(None, self.joints[0].translation, radius);
        }
        for (i, joint) in robot.joints.iter().enumerate() {
            let link = Some(i);
            let is_apart = |p: Vec3| p.length() > 2.0 * radius;
            if self.of(link).next().is_none()
                || lacking.contains(&link) && self.corners_of(link).all(is_apart)
            {
                let axis = along(Vec3::ZERO, vec3(&joint.axis));
                let drum = Form::Cylinder {
                    radius: 1.3 * radius,
                    length: 2.5 * radius,
                };
                self.parts.push(Part::new(link, axis, drum, JOINT));
                let next = self.joints.get(i + 1).map(|X_PJ| X_PJ.translation);
                self.bone(link, next.or(self.tip).unwrap_or_default(), radius);
            }
        }
    }

    /// A capsule from the origin to a place beyond its radius.
    fn bone(&mut self, link: Option<usize>, end: Vec3, radius: f32) {
        let length = end.length();
        if length > radius {
            let (at, form) = (along(end / 2.0, end), Form::Capsule { radius, length });
            self.parts.push(Part::new(link, at, form, SHELL));
        }
    }

    /// A two-finger hand where nothing is beyond the flange: it shows how the flange is turned.
    fn hand(&mut self, link: Option<usize>, flange: &Affine3) {
        let is_beyond = |p: Vec3| (p - flange.translation).dot(flange.matrix3.z_axis) > 0.02;
        if self.corners_of(link).any(is_beyond) {
            return;
        }
        let size = self.reach.min(1.0);
        for (x, z, sides, colour) in [
            (0.0, 0.014, [0.085, 0.034, 0.028], DARK),
            (-0.032, 0.052, [0.012, 0.024, 0.055], METAL),
            (0.032, 0.052, [0.012, 0.024, 0.055], METAL),
        ] {
            let at = *flange * Affine3::from_translation(size * Vec3::new(x, 0.0, z));
            let form = Form::Box(size * Vec3::from(sides));
            self.parts.push(Part::new(link, at, form, colour));
        }
    }

    /// A foot under the base, on a pedestal where the floor is further below; some arms have one of their own.
    fn stand(&mut self, floor_m: f32) {
        let lowest = self.corners_of(None).map(|p| p.z).fold(0.0, f32::min);
        let (radius, floor) = (0.075 * self.reach, floor_m.min(0.0));
        let mut drum = |radius, low: f32, high: f32, colour| {
            let (at, length) = (
                Affine3::from_translation(Vec3::Z * (low + high) / 2.0),
                high - low,
            );
            let form = Form::Cylinder { radius, length };
            self.parts.push(Part::new(None, at, form, colour));
        };
        if lowest > -0.2 * radius / 0.075 {
            drum(1.35 * radius, lowest - 0.024, lowest - 0.001, DARK);
            if floor < lowest - 0.05 {
                drum(1.7 * radius, floor, floor + 0.02, DARK);
                drum(radius, floor + 0.01, lowest - 0.01, JOINT);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_link_of_every_built_in_arm_is_seen() {
        for name in Robot::builtin_names() {
            let mut robot = Robot::builtin(name).expect("built in");
            // Shapes without extent are none: their link is seen all the same.
            let second = robot
                .shapes
                .iter_mut()
                .filter(|shape| shape.joint == Some(1));
            second.for_each(|shape| {
                shape.geometry = Geometry::Box {
                    size: nalgebra::Vector3::zeros(),
                }
            });
            let body = Body::new(&robot, -0.6, &Meshes::default());
            for link in (0..robot.dof()).map(Some).chain([None]) {
                assert!(body.of(link).next().is_some(), "{name}: {link:?}");
            }
            let is_near = |p: Vec3| p.is_finite() && p.length() < 4.0;
            assert!(
                body.parts.iter().flat_map(Part::corners).all(is_near),
                "{name}"
            );
        }
    }
}
