//! The lines and areas that a picture has besides the arm: marks of singularities, why the arm is singular, what ζ has swept, null-space motion. The viewer
//! and the report draw the same ones. PURE.

use std::f32::consts::TAU;

use glam::{Affine3, Vec3};
use nalgebra::SVector;
use shared_types::codes::KIND_NUMERIC;

use crate::blueprint::JOINTS;
use crate::facts::Facts;
use crate::picture::{FEW, Picture, Sign};
use crate::pose::Rgba;
use crate::scene::{dashed, dependent_joints, most, reasons, turning};
use crate::story::Named;
use crate::tint::faded;

/// Colour of a direction that is free again, of the second of two axes that become one, and of the rings at the edge of a neighbourhood.
const FREE: Rgba = 0x4fd07aff;
const SECOND: Rgba = 0x9aa4b4ff;
/// Lines of a curve.
const PIECES: usize = 24;

/// The frame in which strips are given.
pub(crate) enum Frame {
    Base,
    Link(usize),
    /// Base axes at the centre of a singularity; and its own, x along ζ.
    Centre(usize),
    Singular(usize),
}

/// Lines of one colour, or the area within one.
pub(crate) struct Stroke {
    pub(crate) name: String,
    pub(crate) frame: Frame,
    pub(crate) strips: Vec<Vec<Vec3>>,
    pub(crate) colour: Rgba,
    /// None of an area.
    pub(crate) radius: Option<f32>,
}

impl Stroke {
    /// The place of its frame in a picture.
    pub(crate) fn place(&self, picture: &Picture) -> Affine3 {
        match self.frame {
            Frame::Base => Affine3::IDENTITY,
            Frame::Link(i) => picture.links[i],
            Frame::Centre(i) => Affine3::from_translation(picture.signs[i].mark.X_BS.translation),
            Frame::Singular(i) => picture.signs[i].mark.X_BS,
        }
    }
}

/// All of a picture, from the back to the front. `unit`: half the length of the mark of a singularity that the arm is in; m.
pub(crate) fn strokes(facts: &Facts, all: &[Named], picture: &Picture, unit: f32) -> Vec<Stroke> {
    let mut out = Vec::new();
    for (i, (named, sign)) in all.iter().zip(&picture.signs).enumerate() {
        if sign.mark.is_seen {
            why(facts, named, sign, picture, &mut out);
        }
        swept(facts, i, named, sign, unit, &mut out);
        if sign.mark.is_seen {
            glyph(i, named, sign, unit, &mut out);
        }
    }
    for (i, angle) in most(&picture.turned) {
        if let Some(Some(ring)) = facts.body.rings.get(i) {
            out.push(Stroke {
                name: format!("null_motion/turned{}", i + 1),
                frame: Frame::Base,
                strips: vec![turning(ring, &picture.links[i], angle as f32)],
                colour: JOINTS[i],
                radius: Some(0.003 * facts.body.reach),
            });
        }
    }
    out
}

/// Axes and bones that fall into one line, on the links they belong to.
fn why(facts: &Facts, named: &Named, sign: &Sign, picture: &Picture, out: &mut Vec<Stroke>) {
    let (joints, reach) = (facts.joints(), facts.body.reach);
    let dependent = match named.kind {
        KIND_NUMERIC if joints <= 6 && sign.mark.is_inside => {
            let J = facts.arm.jacobian(&SVector::from(picture.q));
            dependent_joints(&J, joints, f64::from(0.4 * reach))
        }
        _ => Vec::new(),
    };
    for (link, strips, is_second) in reasons(named.kind, &facts.body, &dependent) {
        out.push(Stroke {
            name: format!("why_{}", named.name),
            frame: Frame::Link(link),
            strips,
            colour: if is_second { SECOND } else { named.colour },
            radius: Some(0.0025 * reach),
        });
    }
}

/// The sector that ζ has swept since the arm entered; the old ζ, dashed, green once it is free again.
fn swept(facts: &Facts, i: usize, named: &Named, sign: &Sign, unit: f32, out: &mut Vec<Stroke>) {
    if sign.swept.len() <= FEW {
        return;
    }
    let rim = sign.swept.iter().map(|zeta| *zeta * (0.95 * unit));
    let outline = std::iter::once(Vec3::ZERO).chain(rim).collect();
    out.push(Stroke {
        name: format!("zeta/{}/sector", named.name),
        frame: Frame::Centre(i),
        strips: vec![outline],
        colour: faded(named.colour, 90),
        radius: None,
    });
    let end = sign.swept[0] * (1.15 * unit);
    out.push(Stroke {
        name: format!("zeta/{}/entry", named.name),
        frame: Frame::Centre(i),
        strips: dashed(-end, end, 15, 0),
        colour: if sign.is_free { FREE } else { named.colour },
        radius: Some(0.003 * facts.body.reach),
    });
}

/// A circle, or a part of it, across x at a place on it.
fn circle(x: f32, radius: f32, turn: f32) -> Vec<Vec3> {
    let point = |k: usize| {
        let (sin, cos) = (turn * k as f32 / PIECES as f32).sin_cos();
        Vec3::new(x, radius * cos, radius * sin)
    };
    (0..=PIECES).map(point).collect()
}

/// ζ along x, as large as `size`: an axis with a turning arc for a rotation, a double arrow that ends at stops for a translation.
fn axis(is_angular: bool, size: f32) -> Vec<Vec<Vec3>> {
    let mut strips = vec![vec![Vec3::X * -size, Vec3::X * size]];
    let barb =
        |tip: Vec3, back: Vec3, aside: Vec3| vec![tip + back + aside, tip, tip + back - aside];
    if is_angular {
        let arc = circle(0.0, 0.72 * size, 4.7);
        for (tip, behind) in [(arc[0], arc[2]), (arc[PIECES], arc[PIECES - 2])] {
            strips.push(barb(tip, (behind - tip) * 0.7, Vec3::X * (0.11 * size)));
        }
        strips.push(arc);
    } else {
        for end in [Vec3::X * size, Vec3::X * -size] {
            let sides = [Vec3::Y, Vec3::Z].map(|side| side * (0.1 * size));
            strips.extend(sides.map(|side| barb(0.97 * end, -0.23 * end, side)));
            strips.push(circle(end.x, 0.13 * size, TAU));
        }
    }
    strips
}

/// ζ, and two rings at the edge of the neighbourhood, through which its ends pass as the arm enters.
fn glyph(i: usize, named: &Named, sign: &Sign, unit: f32, out: &mut Vec<Stroke>) {
    let mark = &sign.mark;
    // In steps, so that it is not another one at each tick.
    let size = unit * (24.0 * mark.size).round() / 24.0;
    let is_inside = mark.is_inside;
    let (tint, rim) = if is_inside {
        (named.colour, named.colour)
    } else {
        (faded(named.colour, 0x60), faded(SECOND, 0xb0))
    };
    let edges = [-unit * mark.edge, unit * mark.edge];
    let rings = edges.map(|x| circle(x, 0.19 * unit, TAU));
    let axes = [Vec3::Y, Vec3::Z].map(|axis| vec![Vec3::ZERO, 0.5 * unit * axis]);
    for (part, strips, colour, radius) in [
        ("edge", rings.into(), rim, 0.01),
        ("axes", axes.into(), SECOND, 0.012),
        ("glyph", axis(mark.is_angular, size), tint, 0.022),
    ] {
        if is_inside || part != "axes" {
            out.push(Stroke {
                name: format!("singularity/{}/{part}", named.name),
                frame: Frame::Singular(i),
                strips,
                colour,
                radius: Some(radius * unit),
            });
        }
    }
}
