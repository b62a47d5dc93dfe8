//! Mass and inertia of a body: as stated, or of its geoms.

use super::pose::{along, to_urdf};
use super::{Angles, Assets, Element};
use crate::error::Defect;
use crate::pose::Pose;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// Density of a geom that states neither mass nor density, kg/m³.
const DENSITY: f64 = 1000.0;

/// A geom in its body's frame.
pub(super) struct Geom {
    shape: Shape,
    X_BG: Pose,
    mass: f64,
    colour: Option<[f64; 4]>,
    material: Option<String>,
    /// Whether it is there for collisions, not for the eye.
    collides: bool,
}

/// Radii and half lengths, m.
enum Shape {
    Ellipsoid(Vector3<f64>),
    Capsule(f64, f64),
    Cylinder(f64, f64),
    Box(Vector3<f64>),
    /// In a file of its own.
    Mesh(String),
    /// A plane or a height field, which no arm is made of.
    None,
}

/// The geoms of a body.
#[derive(Default)]
pub(super) struct Body {
    pub(super) geoms: Vec<Geom>,
}

impl Geom {
    pub(super) fn read(
        element: &Element<'_, '_>,
        angles: &Angles<'_>,
        X_BF: &Pose,
    ) -> Result<Self, Defect> {
        let mut X = angles.pose(element)?;
        let mut size = element.numbers("size")?;
        size.resize(3, 0.0);
        if let [a, b, c, d, e, f] = element.numbers("fromto")?[..] {
            let (from, to) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            (X.p, X.R) = ((from + to) * 0.5, along(&(to - from)));
            let half = 0.5 * (to - from).norm();
            size = match element.text("type") {
                Some("box" | "ellipsoid") => vec![size[0], size[0], half],
                _ => vec![size[0], half, 0.0],
            };
        }
        let mesh = element.text("mesh").unwrap_or_default().to_owned();
        let shape = match element.text("type").unwrap_or("sphere") {
            "sphere" if mesh.is_empty() => Shape::Ellipsoid(Vector3::repeat(size[0])),
            "ellipsoid" => Shape::Ellipsoid(Vector3::from_column_slice(&size[..3])),
            "capsule" => Shape::Capsule(size[0], size[1]),
            "cylinder" => Shape::Cylinder(size[0], size[1]),
            "box" => Shape::Box(Vector3::from_column_slice(&size[..3])),
            "mesh" | "sphere" => Shape::Mesh(mesh),
            _ => Shape::None,
        };
        let density = element.number("density", DENSITY)?;
        let mass = element.number("mass", density * shape.volume())?;
        let colour = element.numbers("rgba")?.try_into().ok();
        let touches = |name| Ok::<_, Defect>(element.number(name, 1.0)? != 0.0);
        let collides = touches("contype")? || touches("conaffinity")?;
        // MuJoCo's viewer shows the groups 0 to 2, and a mesh is seldom drawn for collisions alone.
        let is_seen = matches!(shape, Shape::Mesh(_)) && element.number("group", 0.0)? < 3.0;
        Ok(Self {
            shape,
            X_BG: *X_BF * X,
            mass,
            colour,
            material: element.text("material").map(str::to_owned),
            collides: collides && !is_seen,
        })
    }

    /// Adds the shape to its link.
    pub(super) fn draw(&self, link: &mut urdf_rs::Link, assets: &Assets<'_>) {
        let geometry = match self.shape {
            Shape::Ellipsoid(radii) if radii == Vector3::repeat(radii.x) => {
                urdf_rs::Geometry::Sphere { radius: radii.x }
            }
            Shape::Capsule(radius, half) => urdf_rs::Geometry::Capsule {
                radius,
                length: 2.0 * half,
            },
            Shape::Cylinder(radius, half) => urdf_rs::Geometry::Cylinder {
                radius,
                length: 2.0 * half,
            },
            Shape::Box(half) => urdf_rs::Geometry::Box {
                size: urdf_rs::Vec3((half * 2.0).into()),
            },
            Shape::Mesh(ref name) => match assets.meshes.get(name) {
                Some((file, scale)) => urdf_rs::Geometry::Mesh {
                    filename: file.clone(),
                    scale: *scale,
                },
                None => return,
            },
            Shape::Ellipsoid(_) | Shape::None => return,
        };
        let origin = to_urdf(&self.X_BG);
        if self.collides {
            link.collision.push(urdf_rs::Collision {
                name: None,
                origin,
                geometry,
            });
        } else {
            let material = self.material.as_deref();
            let material = material.and_then(|name| assets.materials.get(name));
            let material = material.and_then(|rgba| rgba.as_slice().try_into().ok());
            let color = self.colour.or(material).map(|rgba| urdf_rs::Color {
                rgba: urdf_rs::Vec4(rgba),
            });
            let material = urdf_rs::Material {
                name: String::new(),
                color,
                texture: None,
            };
            link.visual.push(urdf_rs::Visual {
                name: None,
                origin,
                geometry,
                material: Some(material),
            });
        }
    }
}

impl Shape {
    /// m³; of what is not read, 0.
    fn volume(&self) -> f64 {
        match *self {
            Self::Ellipsoid(radii) => 4.0 / 3.0 * PI * radii.product(),
            Self::Capsule(radius, half) => PI * radius * radius * (2.0 * half + 4.0 / 3.0 * radius),
            Self::Cylinder(radius, half) => PI * radius * radius * 2.0 * half,
            Self::Box(half) => 8.0 * half.product(),
            Self::Mesh(_) | Self::None => 0.0,
        }
    }

    /// Principal moments over the mass, m².
    fn moments(&self) -> Vector3<f64> {
        let across =
            |squares: Vector3<f64>, share: f64| squares.map(|own| (squares.sum() - own) * share);
        let round = |cross: f64, axial: f64| Vector3::new(cross, cross, axial);
        match *self {
            Self::Ellipsoid(radii) => across(radii.component_mul(&radii), 0.2),
            Self::Box(half) => across(half.component_mul(&half), 1.0 / 3.0),
            Self::Cylinder(radius, half) => round(
                radius * radius / 4.0 + half * half / 3.0,
                radius * radius / 2.0,
            ),
            Self::Capsule(radius, half) => {
                // A cylinder and the two halves of a sphere, whose centres of mass lie 3/8 of the radius beyond its ends.
                let (tube, ball) = (2.0 * half, 4.0 / 3.0 * radius);
                let (tube, ball) = (tube / (tube + ball), ball / (tube + ball));
                let square = radius * radius;
                let cross = tube * (square / 4.0 + half * half / 3.0)
                    + ball * (0.4 * square + half * half + 0.75 * half * radius);
                round(cross, tube * square / 2.0 + ball * 0.4 * square)
            }
            Self::Mesh(_) | Self::None => Vector3::zeros(),
        }
    }
}

impl Body {
    pub(super) fn add(&mut self, other: Self) {
        self.geoms.extend(other.geoms);
    }

    /// The inertia of all geoms. A mesh is not read, and what it would weigh is noted.
    pub(super) fn inertial(&self, body: &str, notes: &mut Vec<String>) -> urdf_rs::Inertial {
        for geom in &self.geoms {
            if let Shape::Mesh(file) = &geom.shape
                && geom.mass == 0.0
            {
                notes.push(format!("body '{body}' has no <inertial>, and the mass of its mesh '{file}' is not read: it counts as zero"));
            }
        }
        let massive = || self.geoms.iter().filter(|geom| geom.mass > 0.0);
        let mass: f64 = massive().map(|geom| geom.mass).sum();
        if mass == 0.0 {
            return urdf_rs::Inertial::default();
        }
        let com = massive()
            .map(|geom| geom.X_BG.p * geom.mass)
            .sum::<Vector3<f64>>()
            / mass;
        let about_com = |geom: &Geom| {
            let (R, r) = (&geom.X_BG.R, geom.X_BG.p - com);
            let own = R * Matrix3::from_diagonal(&geom.shape.moments()) * R.transpose();
            (own + Matrix3::from_diagonal_element(r.dot(&r)) - r * r.transpose()) * geom.mass
        };
        inertial(
            mass,
            &Pose::translation(com),
            &massive().map(about_com).sum(),
        )
    }
}

/// The inertia that a body states.
pub(super) fn stated(
    element: &Element<'_, '_>,
    angles: &Angles<'_>,
) -> Result<urdf_rs::Inertial, Defect> {
    let full = match element.numbers("fullinertia")?[..] {
        [xx, yy, zz, xy, xz, yz] => Some(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)),
        _ => None,
    };
    let diagonal = element.vector("diaginertia")?.unwrap_or_default();
    let I = full.unwrap_or_else(|| Matrix3::from_diagonal(&diagonal));
    Ok(inertial(
        element.number("mass", 0.0)?,
        &angles.pose(element)?,
        &I,
    ))
}

fn inertial(mass: f64, X: &Pose, I: &Matrix3<f64>) -> urdf_rs::Inertial {
    urdf_rs::Inertial {
        origin: to_urdf(X),
        mass: urdf_rs::Mass { value: mass },
        inertia: urdf_rs::Inertia {
            ixx: I.m11,
            ixy: I.m12,
            ixz: I.m13,
            iyy: I.m22,
            iyz: I.m23,
            izz: I.m33,
        },
    }
}
