//! The arm, its path and the marks of its singularities at a tick, as paths of a drawing seen from far away, so that equal lengths are drawn equal. PURE.

use std::fmt::Write;

use glam::{Vec2, Vec3};

use super::recorded::Recorded;
use crate::eye::Room;
use crate::facts::Facts;
use crate::picture::Picture;
use crate::pose::Rgba;
use crate::strokes::strokes;
use crate::tint::{hex, on_paper, opacity, shaded};

/// Width of a drawing; units.
pub(super) const WIDTH: f32 = 1000.0;
/// Colour of the desired path, as in the viewer; and of the hand's way, which is white there.
const DESIRED: Rgba = 0x6eeb96ff;
const ACTUAL: &str = "#4a5160";
/// Colours of the limbs, in turn, and how thick they are over the arm's reach.
const LIMBS: [Rgba; 2] = [0xe4e2daff, 0xa8aeb6ff];
const RADIUS: f32 = 0.035;
/// Most points of a way in one drawing.
const WAY: usize = 200;

/// All that is needed to draw any tick of a run.
pub(super) struct Drawing<'a> {
    facts: &'a Facts<'a>,
    recorded: &'a Recorded,
    /// Axes of the page in the base's, units per metre, and the page's corner.
    axes: [Vec3; 3],
    scale: f32,
    corner: Vec2,
    pub(super) height: f32,
    /// Half the length of the mark of a singularity the arm is in; m.
    unit: f32,
    /// The attributes of a kind of path; each path names its own by its place here.
    pub(super) paints: Vec<String>,
}

/// The `d` of an SVG path through points, in whole units.
fn line(points: impl IntoIterator<Item = Vec2>) -> String {
    let mut path = String::new();
    for (i, point) in points.into_iter().enumerate() {
        let (point, letter) = (point.round().as_ivec2(), if i == 0 { "M" } else { "L" });
        let _ = write!(path, "{letter}{} {}", point.x, point.y);
    }
    path
}

fn stroke(colour: &str, width: f32, more: &str) -> String {
    format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{more}")
}

impl<'a> Drawing<'a> {
    /// `None` where the recording has no picture.
    pub(super) fn new(facts: &'a Facts, recorded: &'a Recorded) -> Option<Self> {
        let mut room = Room::default();
        room.push(facts, recorded.pictures.first()?);
        let eye = room.eye(facts, 1.0);
        let forward = (eye.look_at - eye.position).normalize_or(Vec3::Y);
        let right = forward.cross(eye.up).normalize_or(Vec3::X);
        let mut drawing = Self {
            facts,
            recorded,
            axes: [right, forward.cross(right), forward],
            scale: 1.0,
            corner: Vec2::ZERO,
            height: 0.0,
            unit: 0.2 * facts.body.reach,
            paints: Vec::new(),
        };
        drawing.frame();
        Some(drawing)
    }

    /// Frames the whole arm in some ticks, with room for a mark at the hand. Not narrower than three quarters of its height: captions stand below it.
    fn frame(&mut self) {
        let pictures = &self.recorded.pictures;
        let (mut low, mut high) = (Vec2::splat(f32::INFINITY), Vec2::splat(f32::NEG_INFINITY));
        for picture in pictures.iter().step_by((pictures.len() / 40).max(1)) {
            let round = |p: Vec3, by: f32| [self.place(p) - by, self.place(p) + by];
            let ends = self
                .limbs(picture)
                .into_iter()
                .flatten()
                .flat_map(|p| round(p, RADIUS * self.facts.body.reach));
            for at in ends
                .chain(round(picture.hand.translation, self.unit))
                .filter(|at| at.is_finite())
            {
                (low, high) = (low.min(at), high.max(at));
            }
        }
        let size = (high - low).max(Vec2::splat(1e-3)) * 1.06;
        let size = size.with_x(size.x.max(0.75 * size.y));
        self.scale = WIDTH / size.x;
        self.corner = ((low + high - size) / 2.0) * self.scale;
        self.height = (size.y * self.scale).round();
    }

    fn place(&self, point: Vec3) -> Vec2 {
        let [right, down, _] = self.axes;
        Vec2::new(point.dot(right), point.dot(down)) * self.scale - self.corner
    }

    fn line(&self, points: impl IntoIterator<Item = Vec3>) -> String {
        line(points.into_iter().map(|point| self.place(point)))
    }

    /// The place of a kind of path among them.
    fn paint(&mut self, paint: String) -> usize {
        let mut known = self.paints.iter();
        known.position(|known| *known == paint).unwrap_or_else(|| {
            self.paints.push(paint);
            self.paints.len() - 1
        })
    }

    /// The arm as lines: from each joint to the next, the first from the floor.
    fn limbs(&self, picture: &Picture) -> Vec<[Vec3; 2]> {
        let links = &picture.links[..self.facts.joints()];
        let tip = links
            .last()
            .and_then(|at| Some(at.transform_point3(self.facts.body.tip?)));
        let places = [Vec3::Z * self.facts.floor_m].into_iter();
        let places: Vec<Vec3> = places
            .chain(links.iter().map(|at| at.translation))
            .chain(tip)
            .collect();
        // Joints whose frames coincide have none between them.
        places
            .windows(2)
            .map(|pair| [pair[0], pair[1]])
            .filter(|[a, b]| a.distance(*b) > 1e-3)
            .collect()
    }

    /// The desired path, which is behind everything, over the whole run.
    pub(super) fn ground(&mut self) -> Vec<(usize, String)> {
        let path = self.way(u64::MAX, |picture| Some(picture.desired?.translation));
        let paint = stroke(&hex(on_paper(DESIRED)), 9.0, " stroke-opacity=\".7\"");
        vec![(self.paint(paint), path)]
    }

    /// All that is drawn at a tick, from the back to the front.
    pub(super) fn at(&mut self, picture: &Picture) -> Vec<(usize, String)> {
        let mut limbs: Vec<_> = self
            .limbs(picture)
            .into_iter()
            .zip(LIMBS.iter().cycle())
            .collect();
        let far = |limb: &[Vec3; 2]| (limb[0] + limb[1]).dot(self.axes[2]);
        limbs.sort_by(|a, b| far(&b.0).total_cmp(&far(&a.0)));
        let width = 2.0 * self.scale * RADIUS * self.facts.body.reach;
        let mut paths = Vec::new();
        for (limb, colour) in limbs {
            // Its edge, and what is within.
            for (light, width) in [(0.5, width + 4.0), (0.95, width)] {
                let paint = stroke(&hex(shaded(*colour, light)), width.round(), "");
                paths.push((self.paint(paint), self.line(limb)));
            }
        }
        let way = self.way(picture.tick, |picture| Some(picture.hand.translation));
        paths.push((self.paint(stroke(ACTUAL, 4.0, "")), way));
        for one in strokes(self.facts, &self.recorded.named, picture, self.unit) {
            let at = one.place(picture);
            let strips = one.strips.iter();
            let path = strips
                .map(|strip| self.line(strip.iter().map(|p| at.transform_point3(*p))))
                .collect();
            let (colour, opacity) = (hex(on_paper(one.colour)), opacity(one.colour));
            let paint = match one.radius {
                None => format!("fill=\"{colour}\" fill-opacity=\"{opacity:.2}\""),
                Some(radius) => {
                    let width = (2.0 * radius * self.scale).round().max(4.0);
                    stroke(&colour, width, &format!(" stroke-opacity=\"{opacity:.2}\""))
                }
            };
            paths.push((self.paint(paint), path));
        }
        paths
    }

    /// A path through some of the places up to a tick, the last among them.
    fn way(&self, until: u64, place: impl Fn(&Picture) -> Option<Vec3>) -> String {
        let mut places: Vec<Vec2> = self
            .recorded
            .pictures
            .iter()
            .take_while(|one| one.tick <= until)
            .filter_map(place)
            .map(|p| self.place(p).round())
            .collect();
        places.dedup();
        let some = places.iter().step_by(places.len().div_ceil(WAY).max(1));
        line(some.chain(places.last()).copied())
    }
}
