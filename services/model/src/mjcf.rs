//! An arm out of MJCF, MuJoCo's format, as the tree of links and joints that a URDF states.
//!
//! Bodies become links, and sites links fixed to them. What MuJoCo's compiler derives is derived
//! here: default classes, angles in degrees, limits from ranges, inertia from geoms. Source: MuJoCo documentation, "XML Reference".

mod inertia;
mod pose;
mod write;

use crate::error::Defect;
use crate::foreign::without_foreign;
use crate::pose::Pose;
use crate::rotation::rotation_exp;
use crate::urdf::{self, Chain, Cut};
use inertia::Body;
use nalgebra::Vector3;
use pose::Angles;
use roxmltree::{Document, Node};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use urdf_rs::{JointType, Vec3};

/// Elements that stand for others, or for bodies that are not rigid.
const REFUSED: [&str; 6] = [
    "include",
    "replicate",
    "attach",
    "composite",
    "flexcomp",
    "plugin",
];

/// Settings of the compiler that change masses.
const MASSES: [&str; 4] = [
    "balanceinertia",
    "boundmass",
    "boundinertia",
    "settotalmass",
];

/// Actuators that push a joint; their default classes are one.
const ACTUATORS: [&str; 5] = ["motor", "position", "velocity", "general", "intvelocity"];

/// Whether a text is MJCF rather than a URDF.
pub(crate) fn is_mjcf(text: &str) -> bool {
    let mut rest = text.trim_start_matches('\u{feff}').trim_start();
    for (open, close) in std::iter::repeat_n([("<?", "?>"), ("<!--", "-->")], 8).flatten() {
        let inside = rest.strip_prefix(open);
        if let Some((_, after)) = inside.and_then(|inside| inside.split_once(close)) {
            rest = after.trim_start();
        }
    }
    rest.starts_with("<mujoco")
}

/// Reads the part `cut` of `text` as a serial chain.
///
/// # Errors
/// [`Defect::Mjcf`] where the text is no MJCF, or has an element that is refused; as [`urdf::chain`].
pub(crate) fn read(text: &str, cut: &Cut<'_>) -> Result<Chain, Defect> {
    let text = without_foreign(text).map_err(Defect::Mjcf)?;
    let document = Document::parse(&text).map_err(|error| Defect::Mjcf(error.to_string()))?;
    let root = document.root_element();
    let names = root.descendants().map(|node| node.tag_name().name());
    if let Some(name) = names.into_iter().find(|name| REFUSED.contains(name)) {
        return Err(compiled(&format!("the element <{name}>")));
    }
    let mut reader = Reader::new(root)?;
    let place = reader.link("world");
    for world in children(root, "worldbody") {
        reader.contents(world, (place, "world"), &Pose::identity(), None)?;
    }
    reader.couple(root);
    reader.limit_efforts(root)?;
    let mut chain = urdf::chain(&reader.tree, cut)?;
    for joint in &mut chain.joints {
        joint.armature = reader.armatures.get(&joint.name).copied().unwrap_or(0.0);
    }
    chain.notes.extend(reader.notes);
    for option in children(root, "option") {
        chain.gravity = vector(option.attribute("gravity"), "gravity")?.unwrap_or(chain.gravity);
    }
    Ok(chain)
}

/// A file that MuJoCo has to compile first.
fn compiled(what: &str) -> Defect {
    Defect::Mjcf(format!(
        "armplane does not read {what}: give the file that MuJoCo makes of it (`mujoco.mj_saveLastXML`)"
    ))
}

fn children<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children()
        .filter(move |child| child.has_tag_name(name))
}

fn numbers(text: Option<&str>, what: &str) -> Result<Vec<f64>, Defect> {
    let text = text.unwrap_or_default();
    let numbers: Result<Vec<f64>, _> = text.split_whitespace().map(str::parse).collect();
    numbers.map_err(|_| Defect::Mjcf(format!("{what}=\"{text}\" is not a list of numbers")))
}

fn vector(text: Option<&str>, what: &str) -> Result<Option<Vector3<f64>>, Defect> {
    match numbers(text, what)?[..] {
        [] => Ok(None),
        [x, y, z] => Ok(Some(Vector3::new(x, y, z))),
        ref all => Err(Defect::Mjcf(format!(
            "{what} has {} numbers, not 3",
            all.len()
        ))),
    }
}

/// Attributes that a default class adds, by element and name.
type Class<'a> = BTreeMap<(&'a str, &'a str), &'a str>;

/// An element with its default class.
struct Element<'a, 'c> {
    node: Node<'a, 'a>,
    kind: &'a str,
    class: Option<&'c Class<'a>>,
}

impl<'a> Element<'a, '_> {
    fn text(&self, name: &'a str) -> Option<&'a str> {
        let own = self.node.attribute(name);
        own.or_else(|| self.class?.get(&(self.kind, name)).copied())
    }

    fn numbers(&self, name: &'a str) -> Result<Vec<f64>, Defect> {
        numbers(self.text(name), name)
    }

    fn number(&self, name: &'a str, default: f64) -> Result<f64, Defect> {
        Ok(self.numbers(name)?.first().copied().unwrap_or(default))
    }

    fn vector(&self, name: &'a str) -> Result<Option<Vector3<f64>>, Defect> {
        vector(self.text(name), name)
    }

    /// A range, where it limits: `flag` may say so, and a range does where limits are automatic.
    fn range(
        &self,
        name: &'a str,
        flag: &'a str,
        automatic: bool,
    ) -> Result<Option<[f64; 2]>, Defect> {
        let is_limited = match self.text(flag) {
            Some("true") => true,
            Some("false") => false,
            _ => automatic,
        };
        match self.numbers(name)?[..] {
            [lower, upper] if is_limited => Ok(Some([lower, upper])),
            _ => Ok(None),
        }
    }
}

fn kind_of(name: &str) -> &str {
    if ACTUATORS.contains(&name) {
        "actuator"
    } else {
        name
    }
}

struct Reader<'a> {
    tree: urdf_rs::Robot,
    armatures: BTreeMap<String, f64>,
    notes: Vec<String>,
    links: BTreeSet<String>,
    classes: BTreeMap<&'a str, Class<'a>>,
    angles: Angles<'a>,
    auto_limits: bool,
    /// `inertiafromgeom`: always, never, or where a body has no `<inertial>`.
    from_geoms: &'a str,
    assets: Assets<'a>,
}

/// Meshes and materials, which geoms name.
#[derive(Default)]
struct Assets<'a> {
    /// The file of a mesh, and its scale.
    meshes: BTreeMap<String, (String, Option<Vec3>)>,
    /// The colour of a material.
    materials: BTreeMap<&'a str, Vec<f64>>,
}

impl<'a> Reader<'a> {
    fn new(root: Node<'a, 'a>) -> Result<Self, Defect> {
        let mut reader = Self {
            tree: urdf_rs::Robot {
                name: root.attribute("model").unwrap_or("arm").to_owned(),
                version: None,
                links: vec![],
                joints: vec![],
                materials: vec![],
            },
            armatures: BTreeMap::new(),
            notes: vec![],
            links: BTreeSet::new(),
            classes: BTreeMap::new(),
            angles: Angles {
                in_degrees: true,
                sequence: "xyz",
            },
            auto_limits: true,
            from_geoms: "auto",
            assets: Assets::default(),
        };
        let mut folder = None;
        for compiler in children(root, "compiler") {
            reader.angles.in_degrees &= compiler.attribute("angle") != Some("radian");
            reader.angles.sequence = compiler
                .attribute("eulerseq")
                .unwrap_or(reader.angles.sequence);
            reader.auto_limits &= compiler.attribute("autolimits") != Some("false");
            reader.from_geoms = compiler
                .attribute("inertiafromgeom")
                .unwrap_or(reader.from_geoms);
            let named = ["meshdir", "assetdir"].map(|name| compiler.attribute(name));
            folder = named[0].or(named[1]).or(folder);
            let is_set = |name: &&str| {
                let stated = compiler.attribute(*name).unwrap_or("0");
                !["0", "false", "-1"].contains(&stated)
            };
            if let Some(name) = MASSES.into_iter().find(is_set) {
                return Err(compiled(&format!("<compiler {name}=…>")));
            }
        }
        for default in children(root, "default") {
            reader.class(default, &Class::new());
        }
        for asset in children(root, "asset").flat_map(|asset| asset.children()) {
            reader.asset(asset, folder.unwrap_or_default())?;
        }
        Ok(reader)
    }

    /// Takes in a mesh, whose file is in `folder`, or a material.
    fn asset(&mut self, node: Node<'a, 'a>, folder: &str) -> Result<(), Defect> {
        let element = self.element(node, None);
        let (name, file) = (element.text("name"), element.text("file"));
        match (node.tag_name().name(), file) {
            ("mesh", Some(file)) => {
                let path = Path::new(file);
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                let name = name.map_or(stem.into_owned(), str::to_owned);
                let file = Path::new(folder).join(file).display().to_string();
                let scale = element.vector("scale")?.map(|scale| Vec3(scale.into()));
                self.assets.meshes.insert(name, (file, scale));
            }
            ("material", _) => {
                let rgba = element.numbers("rgba")?;
                self.assets.materials.insert(name.unwrap_or_default(), rgba);
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes in a default class, which inherits from the one around it.
    fn class(&mut self, node: Node<'a, 'a>, around: &Class<'a>) {
        let mut class = around.clone();
        for element in node
            .children()
            .filter(|child| child.is_element() && !child.has_tag_name("default"))
        {
            let kind = kind_of(element.tag_name().name());
            class.extend(
                element
                    .attributes()
                    .map(|one| ((kind, one.name()), one.value())),
            );
        }
        for inner in children(node, "default") {
            self.class(inner, &class);
        }
        self.classes
            .insert(node.attribute("class").unwrap_or("main"), class);
    }

    fn element(&self, node: Node<'a, 'a>, childclass: Option<&'a str>) -> Element<'a, '_> {
        let class = node.attribute("class").or(childclass).unwrap_or("main");
        Element {
            node,
            kind: kind_of(node.tag_name().name()),
            class: self.classes.get(class),
        }
    }

    /// Adds a link; its place in the tree.
    fn link(&mut self, name: &str) -> usize {
        self.links.insert(name.to_owned());
        self.tree.links.push(urdf_rs::Link {
            name: name.to_owned(),
            inertial: urdf_rs::Inertial::default(),
            visual: vec![],
            collision: vec![],
        });
        self.tree.links.len() - 1
    }

    fn fix(&mut self, parent: &str, child: &str, X_PC: &Pose) {
        self.tree.joints.push(joint(
            &format!("to {child}"),
            JointType::Fixed,
            [parent, child],
            X_PC,
        ));
    }

    /// Reads the contents of a body, the world or a frame in them, seen from the link in a place of the tree; the masses of its geoms.
    fn contents(
        &mut self,
        node: Node<'a, 'a>,
        (place, link): (usize, &str),
        X_LF: &Pose,
        class: Option<&'a str>,
    ) -> Result<Body, Defect> {
        let mut body = Body::default();
        for child in node.children().filter(Node::is_element) {
            let element = self.element(child, class);
            let within = child.attribute("childclass").or(class);
            match child.tag_name().name() {
                "frame" => {
                    let X_LF = *X_LF * self.angles.pose(&element)?;
                    body.add(self.contents(child, (place, link), &X_LF, within)?);
                }
                "body" => self.body(child, link, X_LF, within)?,
                "site" => {
                    let X_LS = *X_LF * self.angles.pose(&element)?;
                    if let Some(name) = child.attribute("name") {
                        let is_taken = self.links.contains(name);
                        let name = if is_taken {
                            format!("{name} (site)")
                        } else {
                            name.to_owned()
                        };
                        self.link(&name);
                        self.fix(link, &name, &X_LS);
                    }
                }
                "geom" if link != "world" => {
                    let geom = inertia::Geom::read(&element, &self.angles, X_LF)?;
                    geom.draw(&mut self.tree.links[place], &self.assets);
                    body.geoms.push(geom);
                }
                _ => {}
            }
        }
        Ok(body)
    }

    fn body(
        &mut self,
        node: Node<'a, 'a>,
        parent: &str,
        X_PF: &Pose,
        class: Option<&'a str>,
    ) -> Result<(), Defect> {
        let name = match node.attribute("name") {
            Some(name) => name.to_owned(),
            None => format!("body{}", self.tree.links.len()),
        };
        if self.links.contains(&name) {
            return Err(Defect::Mjcf(format!(
                "there are two bodies or sites '{name}'"
            )));
        }
        let X_PB = *X_PF * self.angles.pose(&self.element(node, class))?;
        let joints = node
            .children()
            .filter(|child| ["joint", "freejoint"].contains(&child.tag_name().name()));
        match joints.collect::<Vec<_>>()[..] {
            [] => self.fix(parent, &name, &X_PB),
            [one] => self.hinge(one, class, [parent, &name], &X_PB)?,
            ref several => {
                return Err(Defect::Mjcf(format!(
                    "body '{name}' has {} joints: give each a body of its own, with inertia",
                    several.len()
                )));
            }
        }
        let place = self.link(&name);
        let geoms = self.contents(node, (place, &name), &Pose::identity(), class)?;
        let stated = children(node, "inertial")
            .next()
            .filter(|_| self.from_geoms != "true");
        self.tree.links[place].inertial = match stated {
            Some(stated) => inertia::stated(&self.element(stated, None), &self.angles)?,
            None if self.from_geoms == "false" => return Ok(()),
            None => geoms.inertial(&name, &mut self.notes),
        };
        if node.attribute("gravcomp").is_some_and(|share| share != "0") {
            self.notes.push(format!(
                "the gravity compensation of body '{name}' is left out"
            ));
        }
        Ok(())
    }

    /// The joint of a body: the joint's frame is a link of its own where it lies beside the body's.
    fn hinge(
        &mut self,
        node: Node<'a, 'a>,
        class: Option<&'a str>,
        [parent, body]: [&str; 2],
        X_PB: &Pose,
    ) -> Result<(), Defect> {
        let stated = node.attribute("name").map(str::to_owned);
        let joint = stated.unwrap_or_else(|| format!("joint of {body}"));
        let anchor = self.element(node, class).vector("pos")?.unwrap_or_default();
        let X_PJ = *X_PB * Pose::translation(anchor);
        if anchor == Vector3::zeros() {
            return self.joint(node, class, (&joint, [parent, body]), &X_PJ);
        }
        let link = format!("{joint} of {body}");
        self.joint(node, class, (&joint, [parent, &link]), &X_PJ)?;
        self.link(&link);
        self.fix(&link, body, &Pose::translation(-anchor));
        Ok(())
    }

    fn joint(
        &mut self,
        node: Node<'a, 'a>,
        class: Option<&'a str>,
        (name, links): (&str, [&str; 2]),
        X_PJ: &Pose,
    ) -> Result<(), Defect> {
        let element = self.element(node, class);
        let kind = match (
            node.tag_name().name(),
            element.text("type").unwrap_or("hinge"),
        ) {
            ("freejoint", _) | (_, "free") => JointType::Floating,
            (_, "ball") => JointType::Spherical,
            (_, "slide") => JointType::Prismatic,
            _ => JointType::Revolute,
        };
        let unit = match kind {
            JointType::Revolute => self.angles.unit(),
            _ => 1.0,
        };
        let axis = element.vector("axis")?.unwrap_or(Vector3::z());
        // The posture that the file draws is not q = 0 but q = ref.
        let back =
            axis.try_normalize(1e-9).unwrap_or_default() * (-unit * element.number("ref", 0.0)?);
        let at_zero = match kind {
            JointType::Prismatic => Pose::translation(back),
            _ => Pose::rotation(rotation_exp(&back)),
        };
        let range = element.range("range", "limited", self.auto_limits)?;
        let mut made = joint(name, kind, links, &(*X_PJ * at_zero));
        if made.joint_type == JointType::Revolute && range.is_none() {
            made.joint_type = JointType::Continuous;
        }
        let [lower, upper] = range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let force = element.range("actuatorfrcrange", "actuatorfrclimited", self.auto_limits)?;
        made.limit = urdf_rs::JointLimit {
            lower: lower * unit,
            upper: upper * unit,
            effort: force.map_or(f64::INFINITY, either_way),
            velocity: f64::INFINITY,
            ..urdf_rs::JointLimit::default()
        };
        made.axis.xyz = Vec3(axis.into());
        made.dynamics = Some(urdf_rs::Dynamics {
            damping: element.number("damping", 0.0)?,
            friction: element.number("frictionloss", 0.0)?,
        });
        let (armature, stiffness) = (
            element.number("armature", 0.0)?,
            element.number("stiffness", 0.0)?,
        );
        self.armatures.insert(name.to_owned(), armature);
        if stiffness != 0.0 {
            self.notes
                .push(format!("the spring of joint '{name}' is left out"));
        }
        self.tree.joints.push(made);
        Ok(())
    }

    /// Joints that follow others: `<equality><joint>`.
    fn couple(&mut self, root: Node<'a, 'a>) {
        for one in children(root, "equality").flat_map(|all| children(all, "joint")) {
            let (Some(follower), Some(leader)) = (one.attribute("joint1"), one.attribute("joint2"))
            else {
                continue;
            };
            if let Some(joint) = self
                .tree
                .joints
                .iter_mut()
                .find(|joint| joint.name == follower)
            {
                joint.mimic = Some(urdf_rs::Mimic {
                    joint: leader.to_owned(),
                    multiplier: None,
                    offset: None,
                });
            }
        }
    }

    /// The force of its actuators, through their gears, limits a joint.
    fn limit_efforts(&mut self, root: Node<'a, 'a>) -> Result<(), Defect> {
        let mut efforts: BTreeMap<&str, f64> = BTreeMap::new();
        for node in children(root, "actuator").flat_map(|all| all.children()) {
            let element = self.element(node, None);
            let Some(joint) = node.attribute("joint").or(node.attribute("jointinparent")) else {
                continue;
            };
            let mut force = element
                .range("forcerange", "forcelimited", self.auto_limits)?
                .map_or(f64::INFINITY, either_way);
            let is_direct = match node.tag_name().name() {
                "motor" => true,
                "general" => ["biastype", "dyntype"]
                    .iter()
                    .all(|one| [None, Some("none")].contains(&element.text(one))),
                _ => false,
            };
            if is_direct
                && let Some(control) =
                    element.range("ctrlrange", "ctrllimited", self.auto_limits)?
            {
                let gain = if element.kind == node.tag_name().name() {
                    1.0
                } else {
                    element.number("gainprm", 1.0)?
                };
                force = force.min(either_way(control) * gain.abs());
            }
            *efforts.entry(joint).or_default() += force * element.number("gear", 1.0)?.abs();
        }
        for joint in &mut self.tree.joints {
            if let Some(effort) = efforts.get(joint.name.as_str()) {
                joint.limit.effort = joint.limit.effort.min(*effort);
            }
        }
        Ok(())
    }
}

/// The part of a range that both directions have.
fn either_way([lower, upper]: [f64; 2]) -> f64 {
    (-lower).min(upper)
}

fn joint(
    name: &str,
    joint_type: JointType,
    [parent, child]: [&str; 2],
    X_PJ: &Pose,
) -> urdf_rs::Joint {
    urdf_rs::Joint {
        name: name.to_owned(),
        joint_type,
        origin: pose::to_urdf(X_PJ),
        parent: urdf_rs::LinkName {
            link: parent.to_owned(),
        },
        child: urdf_rs::LinkName {
            link: child.to_owned(),
        },
        axis: urdf_rs::Axis::default(),
        limit: urdf_rs::JointLimit::default(),
        calibration: None,
        dynamics: None,
        mimic: None,
        safety_controller: None,
    }
}
