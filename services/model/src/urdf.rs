//! A serial chain out of a URDF.

use crate::error::{RobotError, list};
use crate::foreign::without_foreign;
use crate::joint::{Frame, Joint, JointKind};
use crate::pose::Pose;
use crate::rotation::rotation_exp;
use crate::shape::{Geometry, Shape};
use nalgebra::{Matrix3, Vector3};
use shared_types::MAX_DOF;
use std::collections::{BTreeMap, BTreeSet};
use urdf_rs::JointType;

/// The content of a URDF: a serial chain.
pub(crate) struct Chain {
    pub(crate) joints: Vec<Joint>,
    pub(crate) frames: Vec<Frame>,
    pub(crate) shapes: Vec<Shape>,
    /// The chain's last link.
    pub(crate) tip: String,
    pub(crate) notes: Vec<String>,
}

/// The part of a URDF that is the arm.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cut<'a> {
    /// The link that is the arm's base; the root if `None`.
    pub(crate) base: Option<&'a str>,
    /// The link that is its end; the end of the only chain there is if `None`.
    pub(crate) end: Option<&'a str>,
    /// Locked joints and their positions, rad (m for a sliding joint).
    pub(crate) locked: BTreeMap<&'a str, f64>,
}

/// Reads the part `cut` of `text` as a serial chain.
pub(crate) fn read(robot: &str, text: &str, cut: &Cut<'_>) -> Result<Chain, RobotError> {
    let refuse = |reason: String| RobotError::Urdf {
        robot: robot.to_owned(),
        reason,
    };
    let text = without_foreign(text).map_err(refuse)?;
    let urdf = urdf_rs::read_from_string(&text).map_err(|error| refuse(error.to_string()))?;
    Tree::new(robot, &urdf, cut)?.chain(cut.end)
}

/// Parts of the names of joints that open and close a gripper.
const GRIPPER: [&str; 4] = ["finger", "gripper", "jaw", "knuckle"];

/// The URDF's links and joints, by name.
struct Tree<'a> {
    robot: &'a str,
    links: BTreeMap<&'a str, &'a urdf_rs::Link>,
    /// Materials that links refer to by name.
    materials: &'a [urdf_rs::Material],
    /// The joints out of each link, in file order.
    children: BTreeMap<&'a str, Vec<&'a urdf_rs::Joint>>,
    /// The joint into each link.
    parent: BTreeMap<&'a str, &'a urdf_rs::Joint>,
    root: &'a str,
    /// Joints held by the description, with their displacements.
    locked: BTreeMap<&'a str, Pose>,
    /// Joints that other joints mimic.
    leaders: BTreeSet<&'a str>,
}

impl<'a> Tree<'a> {
    fn new(robot: &'a str, urdf: &'a urdf_rs::Robot, cut: &Cut<'_>) -> Result<Self, RobotError> {
        let refuse = |reason: String| {
            Err(RobotError::NotATree {
                robot: robot.to_owned(),
                reason,
            })
        };
        let mut links = BTreeMap::new();
        for link in &urdf.links {
            if links.insert(link.name.as_str(), link).is_some() {
                return refuse(format!("there are two links '{}'", link.name));
            }
        }
        let mut names = BTreeSet::new();
        let mut parent = BTreeMap::new();
        let mut children: BTreeMap<_, Vec<_>> = BTreeMap::new();
        for joint in &urdf.joints {
            let (from, to) = (joint.parent.link.as_str(), joint.child.link.as_str());
            if !names.insert(joint.name.as_str()) {
                return refuse(format!("there are two joints '{}'", joint.name));
            }
            if let Some(link) = [from, to]
                .into_iter()
                .find(|link| !links.contains_key(link))
            {
                return refuse(format!(
                    "joint '{}' names a link '{link}' that is missing",
                    joint.name
                ));
            }
            if parent.insert(to, joint).is_some() {
                return refuse(format!("link '{to}' is the child of two joints"));
            }
            children.entry(from).or_default().push(joint);
        }
        let roots: Vec<&str> = links
            .keys()
            .copied()
            .filter(|link| !parent.contains_key(link))
            .collect();
        let root = match roots[..] {
            [] => return refuse("no link is the base: the joints form a loop".to_owned()),
            [root] => root,
            _ => {
                return refuse(format!(
                    "links {} have no parent joint, and one base is needed",
                    list(roots)
                ));
            }
        };
        let leaders = urdf
            .joints
            .iter()
            .filter_map(|joint| Some(joint.mimic.as_ref()?.joint.as_str()))
            .collect();
        let mut tree = Self {
            robot,
            links,
            materials: &urdf.materials,
            children,
            parent,
            root,
            locked: BTreeMap::new(),
            leaders,
        };
        let reached = tree.below(root).len();
        if reached != tree.links.len() {
            return refuse(format!(
                "only {reached} of {} links hang on the base '{root}': the others form a loop",
                tree.links.len()
            ));
        }
        tree.lock(urdf, cut)?;
        if let Some(base) = cut.base {
            let Some((&base, _)) = tree.links.get_key_value(base) else {
                return Err(tree.unknown_frame(base));
            };
            tree.root = base;
        }
        Ok(tree)
    }

    /// Takes up the joints that the description holds.
    fn lock(&mut self, urdf: &'a urdf_rs::Robot, cut: &Cut<'_>) -> Result<(), RobotError> {
        for (&name, &value) in &cut.locked {
            let robot = || self.robot.to_owned();
            let Some(joint) = urdf.joints.iter().find(|joint| joint.name == name) else {
                let known = list(urdf.joints.iter().map(|joint| &joint.name));
                return Err(RobotError::UnknownJoint {
                    robot: robot(),
                    joint: name.to_owned(),
                    known,
                });
            };
            let axis = Vector3::from(joint.axis.xyz.0)
                .try_normalize(1e-9)
                .filter(|_| value.is_finite());
            let displacement = match (&joint.joint_type, axis) {
                (JointType::Revolute | JointType::Continuous, Some(axis)) => {
                    Pose::rotation(rotation_exp(&(axis * value)))
                }
                (JointType::Prismatic, Some(axis)) => Pose::translation(axis * value),
                _ => {
                    let (joint, value) = (name.to_owned(), value.to_string());
                    let remedy =
                        "lock a revolute, continuous or prismatic joint at a finite position";
                    return Err(RobotError::Joint {
                        robot: robot(),
                        joint,
                        what: "locked",
                        value,
                        remedy,
                    });
                }
            };
            self.locked.insert(joint.name.as_str(), displacement);
        }
        Ok(())
    }

    fn unknown_frame(&self, frame: &str) -> RobotError {
        RobotError::UnknownFrame {
            robot: self.robot.to_owned(),
            frame: frame.to_owned(),
            known: list(self.links.keys()),
        }
    }

    /// Whether a joint moves: neither fixed nor locked.
    fn is_movable(&self, joint: &urdf_rs::Joint) -> bool {
        joint.joint_type != JointType::Fixed && !self.locked.contains_key(joint.name.as_str())
    }

    /// Whether a joint opens or closes a gripper: it follows another joint, leads one, or is named so.
    fn is_gripper(&self, joint: &urdf_rs::Joint) -> bool {
        let name = joint.name.to_lowercase();
        joint.mimic.is_some()
            || self.leaders.contains(joint.name.as_str())
            || GRIPPER.iter().any(|part| name.contains(part))
    }

    /// The child link's frame in the parent link's, with the joint at zero or where it is locked.
    fn pose(&self, joint: &urdf_rs::Joint) -> Pose {
        let X = pose(&joint.origin);
        self.locked
            .get(joint.name.as_str())
            .map_or(X, |displacement| X * *displacement)
    }

    fn joints_of(&self, link: &str) -> &[&'a urdf_rs::Joint] {
        self.children.get(link).map_or(&[], Vec::as_slice)
    }

    /// `link` and all links that hang on it.
    fn below(&self, link: &'a str) -> Vec<&'a str> {
        let mut found = vec![link];
        let mut next = 0;
        while let Some(&link) = found.get(next) {
            found.extend(
                self.joints_of(link)
                    .iter()
                    .map(|joint| joint.child.link.as_str()),
            );
            next += 1;
        }
        found
    }

    /// Links that move as one with `link`, with their poses in it, following fixed and locked joints only.
    fn fixed_to(&self, link: &'a str) -> Vec<(&'a str, Pose)> {
        self.rigid(link, |joint| !self.is_movable(joint))
    }

    fn rigid(
        &self,
        link: &'a str,
        holds: impl Fn(&urdf_rs::Joint) -> bool,
    ) -> Vec<(&'a str, Pose)> {
        let mut found = vec![(link, Pose::identity())];
        let mut next = 0;
        while let Some(&(link, X)) = found.get(next) {
            for joint in self.joints_of(link) {
                if holds(joint) {
                    found.push((joint.child.link.as_str(), X * self.pose(joint)));
                }
            }
            next += 1;
        }
        found
    }

    /// The movable joints of the chain, from the base outwards.
    fn movable(&self, end: Option<&str>) -> Result<Vec<&'a urdf_rs::Joint>, RobotError> {
        if let Some(end) = end {
            if !self.links.contains_key(end) {
                return Err(self.unknown_frame(end));
            }
            let mut joints = Vec::new();
            let mut link = end;
            while link != self.root
                && let Some(&joint) = self.parent.get(link)
            {
                if self.is_movable(joint) {
                    joints.push(joint);
                }
                link = &joint.parent.link;
            }
            if link != self.root {
                let reason = format!("'{end}' does not hang on the base '{}'", self.root);
                return Err(RobotError::NotATree {
                    robot: self.robot.to_owned(),
                    reason,
                });
            }
            joints.reverse();
            return Ok(joints);
        }
        let mut joints: Vec<&urdf_rs::Joint> = Vec::new();
        let mut link = self.root;
        loop {
            let out: Vec<&urdf_rs::Joint> = self
                .fixed_to(link)
                .iter()
                .flat_map(|(link, _)| self.joints_of(link))
                .copied()
                .filter(|joint| self.is_movable(joint))
                .collect();
            let arm: Vec<&urdf_rs::Joint> = out
                .iter()
                .copied()
                .filter(|joint| !self.is_gripper(joint))
                .collect();
            // A gripper is at the end of an arm; a joint that is named so before any other is an arm's all the same.
            let out = if joints.is_empty() { out } else { arm };
            match out[..] {
                [] => return Ok(joints),
                [joint] => {
                    joints.push(joint);
                    link = &joint.child.link;
                }
                _ => {
                    return Err(RobotError::Branches {
                        robot: self.robot.to_owned(),
                        link: link.to_owned(),
                        joints: list(out.iter().map(|joint| &joint.name)),
                    });
                }
            }
        }
    }

    fn chain(&self, end: Option<&str>) -> Result<Chain, RobotError> {
        let movable = self.movable(end)?;
        let robot = || self.robot.to_owned();
        let tip = match end {
            Some(end) => end.to_owned(),
            None => self.tip(movable.last().map_or(self.root, |joint| &joint.child.link)),
        };
        if movable.is_empty() {
            return Err(RobotError::NoMovableJoint {
                robot: robot(),
                frame: tip,
            });
        }
        if movable.len() > MAX_DOF {
            return Err(RobotError::TooManyJoints {
                robot: robot(),
                actual: movable.len(),
            });
        }

        let in_chain: BTreeSet<&str> = movable.iter().map(|joint| joint.name.as_str()).collect();
        let held = |joint: &urdf_rs::Joint| !in_chain.contains(joint.name.as_str());
        let mut chain = Chain {
            joints: vec![],
            frames: vec![],
            shapes: vec![],
            tip,
            notes: vec![],
        };

        let base = self.rigid(self.root, held);
        self.attach(&mut chain, None, &base)?;
        // The link moved by the last joint and all links rigid with it: the candidates for the next joint's parent.
        let mut carrier = base;
        for (i, joint) in movable.iter().enumerate() {
            let X_PM = carrier
                .iter()
                .find(|(link, _)| *link == joint.parent.link)
                .map(|(_, X)| *X)
                .expect("the chain's joints follow one another");
            carrier = self.rigid(&joint.child.link, held);
            self.attach(&mut chain, Some(i), &carrier)?;
            let joint = self.joint(joint, X_PM, &carrier)?;
            chain.joints.push(joint);
        }
        Ok(chain)
    }

    /// The last link: where fixed joints lead to from the last moving link, if they lead to one place.
    fn tip(&self, last: &'a str) -> String {
        let fixed = self.fixed_to(last);
        let leaves: Vec<&str> = fixed
            .iter()
            .map(|(link, _)| *link)
            .filter(|link| self.joints_of(link).is_empty())
            .collect();
        if let [leaf] = leaves[..] { leaf } else { last }.to_owned()
    }

    /// Frames, shapes and notes of the links that move with joint `i`.
    fn attach(
        &self,
        chain: &mut Chain,
        joint: Option<usize>,
        rigid: &[(&'a str, Pose)],
    ) -> Result<(), RobotError> {
        for &(name, X_LF) in rigid {
            if !is_finite(&X_LF) {
                return Err(self.not_finite(format!("the pose of link '{name}'")));
            }
            chain.frames.push(Frame {
                name: name.to_owned(),
                joint,
                X_LF,
            });
            let link = self.links[name];
            let before = chain.shapes.len();
            for visual in &link.visual {
                match geometry(&visual.geometry) {
                    Ok(geometry) => {
                        let colour = self.colour(visual.material.as_ref());
                        chain.shapes.push(Shape {
                            joint,
                            X_LS: X_LF * pose(&visual.origin),
                            geometry,
                            colour,
                        });
                    }
                    Err(file) => chain.notes.push(format!(
                        "the mesh '{file}' of link '{name}' is not shown: meshes are not read"
                    )),
                }
            }
            if chain.shapes.len() == before {
                // Collision geometry is often simpler than visual geometry.
                let shapes = link.collision.iter().filter_map(|collision| {
                    let geometry = geometry(&collision.geometry).ok()?;
                    Some(Shape {
                        joint,
                        X_LS: X_LF * pose(&collision.origin),
                        geometry,
                        colour: None,
                    })
                });
                chain.shapes.extend(shapes);
            }
            for child in self.joints_of(name) {
                let is_held = rigid.iter().any(|(link, _)| *link == child.child.link);
                if is_held && self.is_movable(child) {
                    let why = if self.is_gripper(child) {
                        "is named as a gripper's, or mimics, or is mimicked"
                    } else {
                        "leads elsewhere"
                    };
                    chain.notes.push(format!(
                        "joint '{}' {why}: it is held at zero, its link part of '{}'; the arm ends in '{}', and `default_frame = \"LINK\"` in its \
                         description names another end",
                        child.name, rigid[0].0, chain.tip
                    ));
                }
            }
        }
        Ok(())
    }

    /// A material's colour: its own, or that of the one it names.
    fn colour(&self, material: Option<&urdf_rs::Material>) -> Option<[f64; 4]> {
        let material = material?;
        let named = || {
            self.materials
                .iter()
                .find(|known| known.name == material.name)?
                .color
                .as_ref()
        };
        material
            .color
            .as_ref()
            .or_else(named)
            .map(|color| color.rgba.0)
            .filter(|rgba| rgba.iter().all(|part| (0.0..=1.0).contains(part)))
    }

    fn joint(
        &self,
        joint: &urdf_rs::Joint,
        X_PM: Pose,
        rigid: &[(&'a str, Pose)],
    ) -> Result<Joint, RobotError> {
        let robot = || self.robot.to_owned();
        if let Some(mimic) = &joint.mimic {
            return Err(RobotError::Mimic {
                robot: robot(),
                joint: joint.name.clone(),
                leader: mimic.joint.clone(),
            });
        }
        let kind = match joint.joint_type {
            JointType::Revolute => JointKind::Revolute,
            JointType::Continuous => JointKind::Continuous,
            JointType::Prismatic => JointKind::Prismatic,
            ref other => {
                return Err(RobotError::UnsupportedJoint {
                    robot: robot(),
                    joint: joint.name.clone(),
                    kind: format!("{other:?}").to_lowercase(),
                });
            }
        };
        let axis = Vector3::from(joint.axis.xyz.0);
        let norm = axis.norm();
        if !(norm > 1e-9 && norm.is_finite()) {
            return Err(RobotError::Joint {
                robot: robot(),
                joint: joint.name.clone(),
                what: "axis",
                value: format!("{:?}", joint.axis.xyz.0),
                remedy: "give a direction, such as xyz=\"0 0 1\"",
            });
        }
        let X_PJ = X_PM * pose(&joint.origin);
        if !is_finite(&X_PJ) {
            return Err(self.not_finite(format!("the pose of joint '{}'", joint.name)));
        }
        let (mass, com, inertia) = self.lump(rigid)?;
        let (damping, friction) = joint
            .dynamics
            .as_ref()
            .map_or((0.0, 0.0), |d| (d.damping, d.friction));
        let mut limit = joint.limit.clone();
        if kind == JointKind::Continuous {
            (limit.lower, limit.upper) = (f64::NEG_INFINITY, f64::INFINITY);
            // A continuous joint needs no <limit>; the parser then gives zero.
            if limit.effort == 0.0 {
                limit.effort = f64::INFINITY;
            }
            if limit.velocity == 0.0 {
                limit.velocity = f64::INFINITY;
            }
        }
        Ok(Joint {
            name: joint.name.clone(),
            kind,
            X_PJ,
            axis: axis / norm,
            mass,
            com,
            inertia,
            armature: 0.0,
            viscous_friction: damping,
            coulomb_friction: friction,
            lower: limit.lower,
            upper: limit.upper,
            effort: limit.effort,
            velocity: limit.velocity,
            torque_rate: f64::INFINITY,
            link: joint.child.link.clone(),
        })
    }

    /// Mass, centre of mass, and inertia about it, of links that move as one, in the first one's frame.
    fn lump(
        &self,
        rigid: &[(&'a str, Pose)],
    ) -> Result<(f64, Vector3<f64>, Matrix3<f64>), RobotError> {
        let mut bodies = Vec::new();
        for &(name, X_LF) in rigid {
            let inertial = &self.links[name].inertial;
            let I = &inertial.inertia;
            #[rustfmt::skip]
            let I = Matrix3::new(
                I.ixx, I.ixy, I.ixz,
                I.ixy, I.iyy, I.iyz,
                I.ixz, I.iyz, I.izz,
            );
            let X = X_LF * pose(&inertial.origin);
            let mass = inertial.mass.value;
            if !(mass.is_finite() && is_finite(&X) && I.iter().all(|x| x.is_finite())) {
                return Err(self.not_finite(format!("the inertia of link '{name}'")));
            }
            if mass < 0.0 {
                return Err(self.impossible(name, mass, &I));
            }
            // A link may have inertia without mass: its part in a body that others give mass.
            if mass > 0.0 || I != Matrix3::zeros() {
                bodies.push((mass, X.p, X.R * I * X.R.transpose()));
            }
        }
        let name = rigid[0].0;
        if !bodies.iter().any(|(mass, ..)| *mass > 0.0) {
            return Err(RobotError::NoInertia {
                robot: self.robot.to_owned(),
                link: name.to_owned(),
            });
        }
        let (mass, com, inertia) = match bodies[..] {
            // One body alone keeps its numbers to the last bit.
            [body] => body,
            _ => {
                let mass: f64 = bodies.iter().map(|(m, ..)| m).sum();
                let com = bodies.iter().map(|(m, c, _)| *m * c).sum::<Vector3<f64>>() / mass;
                let about_com = |(m, c, I): &(f64, Vector3<f64>, Matrix3<f64>)| {
                    let r = c - com;
                    I + *m * (Matrix3::from_diagonal_element(r.dot(&r)) - r * r.transpose())
                };
                (mass, com, bodies.iter().map(about_com).sum())
            }
        };
        let inertia = 0.5 * (inertia + inertia.transpose());
        let d = inertia.symmetric_eigenvalues();
        // Published values are rounded: the triangle inequality may miss by that much.
        let realisable = d.min() > 0.0 && d.sum() - 2.0 * d.max() >= -1e-6 * d.sum();
        if !realisable {
            return Err(self.impossible(name, mass, &inertia));
        }
        Ok((mass, com, inertia))
    }

    fn impossible(&self, link: &str, mass: f64, inertia: &Matrix3<f64>) -> RobotError {
        let mut moments: [f64; 3] = inertia.symmetric_eigenvalues().into();
        moments.sort_by(f64::total_cmp);
        RobotError::Inertia {
            robot: self.robot.to_owned(),
            link: link.to_owned(),
            mass,
            moments,
        }
    }

    fn not_finite(&self, what: String) -> RobotError {
        RobotError::NotFinite {
            robot: self.robot.to_owned(),
            what,
        }
    }
}

fn pose(origin: &urdf_rs::Pose) -> Pose {
    Pose::from_xyz_rpy(origin.xyz.0, origin.rpy.0)
}

fn is_finite(X: &Pose) -> bool {
    X.p.iter().chain(X.R.iter()).all(|x| x.is_finite())
}

/// The shape, or the name of the mesh file it is in.
fn geometry(geometry: &urdf_rs::Geometry) -> Result<Geometry, &str> {
    Ok(match *geometry {
        urdf_rs::Geometry::Box { size } => Geometry::Box {
            size: size.0.into(),
        },
        urdf_rs::Geometry::Cylinder { radius, length } => Geometry::Cylinder { radius, length },
        urdf_rs::Geometry::Sphere { radius } => Geometry::Sphere { radius },
        urdf_rs::Geometry::Capsule { radius, length } => Geometry::Capsule { radius, length },
        urdf_rs::Geometry::Mesh { ref filename, .. } => return Err(filename),
    })
}
