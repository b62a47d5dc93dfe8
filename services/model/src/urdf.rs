//! A serial chain out of a URDF.

use crate::error::{Defect, list};
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
    /// A mass is NaN where the file has no inertia for what the joint moves.
    pub(crate) joints: Vec<Joint>,
    /// The names of all joints of the file.
    pub(crate) names: BTreeSet<String>,
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
pub(crate) fn read(text: &str, cut: &Cut<'_>) -> Result<Chain, Defect> {
    let own = without_foreign(text).map_err(Defect::Urdf)?;
    let urdf = urdf_rs::read_from_string(&own.text).map_err(|error| {
        let error = error.to_string();
        // The lines are those of the file, unless its prefixes have no names.
        let document =
            roxmltree::Document::parse(text).or_else(|_| roxmltree::Document::parse(&own.text));
        let place = document
            .ok()
            .and_then(|document| lacking(&document, &error).or_else(|| unreadable(&document)));
        Defect::Urdf(place.unwrap_or(error))
    })?;
    Tree::new(&urdf, &own.incomplete, cut)?.chain(cut.end)
}

/// Where an attribute is missing of which the parser's `error` gives the name, but not the place.
fn lacking(document: &roxmltree::Document<'_>, error: &str) -> Option<String> {
    /// Elements with the attributes that each of them needs.
    const NEEDED: [(&str, &[&str]); 6] = [
        ("joint", &["type"]),
        ("parent", &["link"]),
        ("child", &["link"]),
        ("cylinder", &["radius", "length"]),
        ("sphere", &["radius"]),
        ("mesh", &["filename"]),
    ];
    let attribute = error.split('`').nth(1)?;
    let is_lacking = |node: &roxmltree::Node<'_, '_>| {
        let tag = node.tag_name().name();
        let needs = |&(known, names): &(&str, &[&str])| known == tag && names.contains(&attribute);
        NEEDED.iter().any(needs) && node.attribute(attribute).is_none()
    };
    let node = document.descendants().find(is_lacking)?;
    Some(format!("{} has no `{attribute}`: add it", place(&node)))
}

/// Where a number is none, which the parser does not say.
fn unreadable(document: &roxmltree::Document<'_>) -> Option<String> {
    const NUMBERS: [&str; 20] = [
        "xyz", "rpy", "value", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "lower", "upper",
        "effort", "velocity", "radius", "length", "size", "scale", "damping", "friction", "rgba",
    ];
    let all = document
        .descendants()
        .flat_map(|node| node.attributes().map(move |one| (node, one)));
    let is_broken = |one: &roxmltree::Attribute<'_, '_>| {
        let mut words = one.value().split_whitespace();
        NUMBERS.contains(&one.name()) && words.any(|word| word.parse::<f64>().is_err())
    };
    let (node, attribute) = all.into_iter().find(|(_, one)| is_broken(one))?;
    let (name, value) = (attribute.name(), attribute.value());
    let remedy = match value.contains("${") {
        true => "run xacro on the file first",
        false => "give numbers, with points for decimals",
    };
    Some(format!(
        "{}: {name}=\"{value}\" is no number: {remedy}",
        place(&node)
    ))
}

/// An element as people find it.
fn place(node: &roxmltree::Node<'_, '_>) -> String {
    let owner = node.ancestors().find_map(|node| {
        let name = node.attribute("name")?;
        Some(format!(" of {} '{name}'", node.tag_name().name()))
    });
    let line = node.document().text_pos_at(node.range().start).row;
    format!(
        "line {line}: <{}>{}",
        node.tag_name().name(),
        owner.unwrap_or_default()
    )
}

/// Parts of the names of joints that open and close a gripper.
const GRIPPER: [&str; 4] = ["finger", "gripper", "jaw", "knuckle"];

/// The URDF's links and joints, by name.
struct Tree<'a> {
    urdf: &'a urdf_rs::Robot,
    /// Links whose mass or inertia is missing.
    incomplete: &'a BTreeSet<String>,
    links: BTreeMap<&'a str, &'a urdf_rs::Link>,
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

/// A link and its pose in the first of those that move as one.
type Rigid<'a> = Vec<(&'a str, Pose)>;

impl<'a> Tree<'a> {
    fn new(
        urdf: &'a urdf_rs::Robot,
        incomplete: &'a BTreeSet<String>,
        cut: &Cut<'_>,
    ) -> Result<Self, Defect> {
        let refuse = |reason: String| Err(Defect::NotATree(reason));
        let mut tree = Self {
            urdf,
            incomplete,
            links: BTreeMap::new(),
            children: BTreeMap::new(),
            parent: BTreeMap::new(),
            root: "",
            locked: BTreeMap::new(),
            leaders: BTreeSet::new(),
        };
        for link in &urdf.links {
            if tree.links.insert(&link.name, link).is_some() {
                return refuse(format!("there are two links '{}'", link.name));
            }
        }
        let mut names = BTreeSet::new();
        for joint in &urdf.joints {
            let (name, from, to) = (&joint.name, &joint.parent.link, &joint.child.link);
            if !names.insert(name) {
                return refuse(format!("there are two joints '{name}'"));
            }
            let is_missing = |link: &&String| !tree.links.contains_key(link.as_str());
            if let Some(link) = [from, to].into_iter().find(is_missing) {
                return refuse(format!(
                    "joint '{name}' names a link '{link}' that is missing"
                ));
            }
            if tree.parent.insert(to, joint).is_some() {
                return refuse(format!("link '{to}' is the child of two joints"));
            }
            tree.children.entry(from).or_default().push(joint);
            let mimic = joint.mimic.iter();
            tree.leaders.extend(mimic.map(|mimic| &*mimic.joint));
        }
        let root = tree.only_root()?;
        tree.root = match cut.base {
            Some(base) => tree.known(base)?,
            None => root,
        };
        for (name, value) in &cut.locked {
            let (name, displacement) = tree.displacement(name, *value)?;
            tree.locked.insert(name, displacement);
        }
        Ok(tree)
    }

    /// The one link without a parent, on which all the others hang.
    fn only_root(&self) -> Result<&'a str, Defect> {
        if self.links.is_empty() {
            let sentence = "it has no <link>: give a URDF (<robot>), or MuJoCo's MJCF in a file that ends in .xml";
            return Err(Defect::Urdf(sentence.to_owned()));
        }
        let roots = self.links.keys().copied();
        let roots: Vec<&str> = roots
            .filter(|link| !self.parent.contains_key(link))
            .collect();
        let [root] = roots[..] else {
            return Err(Defect::NotATree(format!(
                "one link without a parent joint is needed as the base, and there are {}: {}",
                roots.len(),
                list(roots)
            )));
        };
        let (reached, all) = (self.rigid(root, |_| true).len(), self.links.len());
        if reached != all {
            return Err(Defect::NotATree(format!(
                "only {reached} of {all} links hang on the base '{root}': the others form a loop"
            )));
        }
        Ok(root)
    }

    fn known(&self, frame: &str) -> Result<&'a str, Defect> {
        let unknown = || Defect::UnknownFrame {
            frame: frame.to_owned(),
            known: list(self.links.keys()),
        };
        let (name, _) = self.links.get_key_value(frame).ok_or_else(unknown)?;
        Ok(name)
    }

    /// A joint that the description holds at `value`, and its displacement.
    fn displacement(&self, name: &str, value: f64) -> Result<(&'a str, Pose), Defect> {
        let joints = &self.urdf.joints;
        let unknown = || Defect::UnknownJoint {
            joint: name.to_owned(),
            known: list(joints.iter().map(|joint| &joint.name)),
        };
        let joint = joints.iter().find(|joint| joint.name == name);
        let joint = joint.ok_or_else(unknown)?;
        let by = Vector3::from(joint.axis.xyz.0)
            .try_normalize(1e-9)
            .map(|axis| axis * value)
            .filter(|_| value.is_finite());
        let displacement = match (&joint.joint_type, by) {
            (JointType::Revolute | JointType::Continuous, Some(by)) => {
                Pose::rotation(rotation_exp(&by))
            }
            (JointType::Prismatic, Some(by)) => Pose::translation(by),
            _ => {
                let remedy = "lock a revolute, continuous or prismatic joint at a finite position";
                return Err(Defect::of_joint(name, "locked", value, remedy));
            }
        };
        Ok((&joint.name, displacement))
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

    fn joints_of(&self, link: &str) -> &[&'a urdf_rs::Joint] {
        self.children.get(link).map_or(&[], Vec::as_slice)
    }

    /// The links that move as one with `link` where the joints that `holds` names do not move, and their poses in it: the joints at zero, or where they
    /// are locked.
    fn rigid(&self, link: &'a str, holds: impl Fn(&urdf_rs::Joint) -> bool) -> Rigid<'a> {
        let mut found = vec![(link, Pose::identity())];
        let mut next = 0;
        while let Some(&(link, X)) = found.get(next) {
            for joint in self.joints_of(link).iter().filter(|joint| holds(joint)) {
                let displacement = self.locked.get(joint.name.as_str());
                let X = X * pose(&joint.origin) * displacement.copied().unwrap_or(Pose::identity());
                found.push((&joint.child.link, X));
            }
            next += 1;
        }
        found
    }

    /// The movable joints from the base to `end`.
    fn way_to(&self, end: &'a str) -> Result<Vec<&'a urdf_rs::Joint>, Defect> {
        let (mut joints, mut link) = (Vec::new(), end);
        while link != self.root {
            let Some(&joint) = self.parent.get(link) else {
                return Err(Defect::NotATree(format!(
                    "'{end}' does not hang on the base '{}'",
                    self.root
                )));
            };
            if self.is_movable(joint) {
                joints.push(joint);
            }
            link = &joint.parent.link;
        }
        joints.reverse();
        Ok(joints)
    }

    /// The last link of the only chain there is: where fixed joints lead to from the last moving link, if they lead to one place.
    fn only_end(&self) -> Result<&'a str, Defect> {
        let mut link = self.root;
        loop {
            let fixed = self.rigid(link, |joint| !self.is_movable(joint));
            let out = fixed.iter().flat_map(|(link, _)| self.joints_of(link));
            // A gripper is at the end of an arm; a joint that is named so before any other is an arm's all the same.
            let is_arm = |joint: &&urdf_rs::Joint| {
                self.is_movable(joint) && (link == self.root || !self.is_gripper(joint))
            };
            let out: Vec<_> = out.copied().filter(is_arm).collect();
            match out[..] {
                [] => {
                    let is_leaf = |link: &&str| self.joints_of(link).is_empty();
                    let mut leaves = fixed.iter().map(|(link, _)| *link).filter(is_leaf);
                    let only = leaves.next().filter(|_| leaves.next().is_none());
                    return Ok(only.unwrap_or(link));
                }
                [joint] => link = &joint.child.link,
                _ => {
                    return Err(Defect::Branches {
                        link: link.to_owned(),
                        joints: list(out.iter().map(|joint| &joint.name)),
                    });
                }
            }
        }
    }

    fn chain(&self, end: Option<&str>) -> Result<Chain, Defect> {
        let tip = end.map_or_else(|| self.only_end(), |end| self.known(end))?;
        let (movable, tip) = (self.way_to(tip)?, tip.to_owned());
        match movable.len() {
            0 => return Err(Defect::NoMovableJoint { frame: tip }),
            1..=MAX_DOF => {}
            more => return Err(Defect::TooManyJoints(more)),
        }
        let in_chain: BTreeSet<&str> = movable.iter().map(|joint| joint.name.as_str()).collect();
        let held = |joint: &urdf_rs::Joint| !in_chain.contains(joint.name.as_str());
        let mut chain = Chain {
            joints: vec![],
            frames: vec![],
            shapes: vec![],
            tip,
            names: self
                .urdf
                .joints
                .iter()
                .map(|one| one.name.clone())
                .collect(),
            notes: vec![],
        };
        // The link moved by the last joint and all links rigid with it: the candidates for the next joint's parent.
        let mut carrier = self.rigid(self.root, held);
        self.attach(&mut chain, &carrier)?;
        for joint in movable {
            let parent = carrier.iter().find(|(link, _)| *link == joint.parent.link);
            let (_, X_PM) = parent.expect("the chain's joints follow one another");
            let X_PJ = *X_PM * pose(&joint.origin);
            carrier = self.rigid(&joint.child.link, held);
            chain.joints.push(self.joint(joint, X_PJ, &carrier)?);
            self.attach(&mut chain, &carrier)?;
        }
        Ok(chain)
    }

    /// Frames, shapes and notes of the links that move with the last joint so far.
    fn attach(&self, chain: &mut Chain, rigid: &Rigid<'a>) -> Result<(), Defect> {
        let joint = chain.joints.len().checked_sub(1);
        for &(name, X_LF) in rigid {
            check_finite(&X_LF, || format!("the pose of link '{name}'"))?;
            chain.frames.push(Frame {
                name: name.to_owned(),
                joint,
                X_LF,
            });
            let link = self.links[name];
            let shape = |form, origin, colour, stands_in, touches| Shape {
                joint,
                X_LS: X_LF * pose(origin),
                geometry: geometry(form),
                colour,
                stands_in,
                touches,
            };
            let is_mesh = |form: &_| matches!(form, urdf_rs::Geometry::Mesh { .. });
            let closed = link.collision.iter().filter(|one| !is_mesh(&one.geometry));
            let closed: Vec<_> = closed.collect();
            chain.shapes.extend(link.visual.iter().map(|visual| {
                let colour = self.colour(visual.material.as_ref());
                let (form, touches) = (&visual.geometry, closed.is_empty());
                shape(form, &visual.origin, colour, false, touches)
            }));
            let instead = !link.visual.is_empty();
            let closed = closed.into_iter();
            chain
                .shapes
                .extend(closed.map(|one| shape(&one.geometry, &one.origin, None, instead, true)));
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
        let mut named = self.urdf.materials.iter();
        let named = named.find(|known| known.name == material.name);
        let color = material.color.as_ref().or_else(|| named?.color.as_ref());
        let in_range = |rgba: &[f64; 4]| rgba.iter().all(|part| (0.0..=1.0).contains(part));
        color.map(|color| color.rgba.0).filter(in_range)
    }

    fn joint(
        &self,
        joint: &urdf_rs::Joint,
        X_PJ: Pose,
        rigid: &Rigid<'a>,
    ) -> Result<Joint, Defect> {
        let name = joint.name.clone();
        if let Some(mimic) = &joint.mimic {
            let (joint, leader) = (name, mimic.joint.clone());
            return Err(Defect::Mimic { joint, leader });
        }
        let kind = match joint.joint_type {
            JointType::Revolute => JointKind::Revolute,
            JointType::Continuous => JointKind::Continuous,
            JointType::Prismatic => JointKind::Prismatic,
            ref other => {
                let kind = format!("{other:?}").to_lowercase();
                return Err(Defect::UnsupportedJoint { joint: name, kind });
            }
        };
        let axis = joint.axis.xyz.0;
        let unit = Vector3::from(axis).try_normalize(1e-9);
        let Some(unit) = unit.filter(|unit| unit.norm() > 0.5) else {
            let remedy = "give a direction, such as xyz=\"0 0 1\"";
            let value = format!("{axis:?}");
            return Err(Defect::of_joint(&name, "axis", value, remedy));
        };
        check_finite(&X_PJ, || format!("the pose of joint '{name}'"))?;
        let (mass, com, inertia) = self.lump(rigid)?;
        let dynamics = joint.dynamics.clone().unwrap_or_default();
        let mut limit = joint.limit.clone();
        if kind == JointKind::Continuous {
            (limit.lower, limit.upper) = (f64::NEG_INFINITY, f64::INFINITY);
            // A continuous joint needs no <limit>; the parser then gives zero.
            for most in [&mut limit.effort, &mut limit.velocity] {
                if *most == 0.0 {
                    *most = f64::INFINITY;
                }
            }
        }
        Ok(Joint {
            name,
            kind,
            X_PJ,
            axis: unit,
            mass,
            com,
            inertia,
            armature: 0.0,
            viscous_friction: dynamics.damping,
            coulomb_friction: dynamics.friction,
            lower: limit.lower,
            upper: limit.upper,
            effort: limit.effort,
            velocity: limit.velocity,
            torque_rate: f64::INFINITY,
            link: joint.child.link.clone(),
        })
    }

    /// Mass, centre of mass, and inertia about it, of links that a joint moves as one, in the first one's frame; NaN where none of them has any,
    /// or one lacks a part of it.
    fn lump(&self, rigid: &Rigid<'a>) -> Result<(f64, Vector3<f64>, Matrix3<f64>), Defect> {
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
            let what = || format!("the inertia of link '{name}'");
            check_finite(&X, what)?;
            if !(mass.is_finite() && I.iter().all(|x| x.is_finite())) {
                return Err(Defect::NotFinite(what()));
            }
            if mass < 0.0 {
                return Err(impossible(name, mass, &I));
            }
            // A link may have inertia without mass: its part in a body that others give mass.
            if mass > 0.0 || I != Matrix3::zeros() {
                bodies.push((mass, X.p, X.R * I * X.R.transpose()));
            }
        }
        let name = rigid[0].0;
        let mass: f64 = bodies.iter().map(|(m, ..)| m).sum();
        let is_incomplete = |(name, _): &(&str, Pose)| self.incomplete.contains(*name);
        if mass <= 0.0 || rigid.iter().any(is_incomplete) {
            let unknown = f64::NAN;
            return Ok((unknown, Vector3::repeat(unknown), Matrix3::repeat(unknown)));
        }
        let (com, inertia) = match bodies[..] {
            // One body alone keeps its numbers to the last bit.
            [(_, com, inertia)] => (com, inertia),
            _ => {
                let com = bodies.iter().map(|(m, c, _)| *m * c).sum::<Vector3<f64>>() / mass;
                let about_com = |(m, c, I): &(f64, Vector3<f64>, Matrix3<f64>)| {
                    let r = c - com;
                    I + *m * (Matrix3::from_diagonal_element(r.dot(&r)) - r * r.transpose())
                };
                (com, bodies.iter().map(about_com).sum())
            }
        };
        let inertia = 0.5 * (inertia + inertia.transpose());
        let d = inertia.symmetric_eigenvalues();
        // Published values are rounded: the triangle inequality may miss by that much.
        let realisable = d.min() > 0.0 && d.sum() - 2.0 * d.max() >= -1e-6 * d.sum();
        if !realisable {
            return Err(impossible(name, mass, &inertia));
        }
        Ok((mass, com, inertia))
    }
}

fn impossible(link: &str, mass: f64, inertia: &Matrix3<f64>) -> Defect {
    let mut moments: [f64; 3] = inertia.symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    Defect::Inertia {
        link: link.to_owned(),
        mass,
        moments,
    }
}

fn pose(origin: &urdf_rs::Pose) -> Pose {
    Pose::from_xyz_rpy(origin.xyz.0, origin.rpy.0)
}

fn check_finite(X: &Pose, what: impl Fn() -> String) -> Result<(), Defect> {
    if X.p.iter().chain(X.R.iter()).all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(Defect::NotFinite(what()))
}

fn geometry(geometry: &urdf_rs::Geometry) -> Geometry {
    match *geometry {
        urdf_rs::Geometry::Box { size } => Geometry::Box {
            size: size.0.into(),
        },
        urdf_rs::Geometry::Cylinder { radius, length } => Geometry::Cylinder { radius, length },
        urdf_rs::Geometry::Sphere { radius } => Geometry::Sphere { radius },
        urdf_rs::Geometry::Capsule { radius, length } => Geometry::Capsule { radius, length },
        urdf_rs::Geometry::Mesh {
            ref filename,
            scale,
        } => Geometry::Mesh {
            file: filename.clone(),
            scale: scale.map_or(Vector3::repeat(1.0), |scale| scale.0.into()),
        },
    }
}
