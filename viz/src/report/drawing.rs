//! The arm, its path and the marks of its singularities at a tick, as paths of a drawing. PURE.

use std::fmt::Write;

use glam::{IVec2, Vec2, Vec3};
use model::Robot;

use super::camera::Camera;
use super::recorded::{Named, Recorded, at, between};
use crate::arm::Figure;
use crate::blueprint::Subject;
use crate::meshes::Meshes;
use crate::recording::Room;
use crate::scene::reasons;
use crate::solid::{Placement, Rgba};
use crate::tint::{hex, on_paper, shaded};

/// Width of a drawing; units.
pub(super) const WIDTH: f32 = 1000.0;
/// Colour of the desired path, as in the viewer.
const DESIRED: Rgba = 0x6eeb96ff;
/// The hand's way, which is white in the viewer.
const ACTUAL: &str = "#4a5160";
/// The second of two axes that become one, which is white in the viewer.
const SECOND: &str = "#59606e";
/// Colours of the limbs, in turn, and how thick they are over the arm's reach.
const LIMBS: [Rgba; 2] = [0xe4e2daff, 0xa8aeb6ff];
const RADIUS: f32 = 0.035;
/// Most points of the hand's way in one drawing, and of the desired path.
const WAY: usize = 80;
const PATH: usize = 400;

/// Paths from the back to the front.
#[derive(Default)]
pub(super) struct Picture {
    /// The attributes of a kind of path; each path names its own by its place here.
    pub(super) paints: Vec<String>,
    pub(super) paths: Vec<(usize, String)>,
}

impl Picture {
    fn put(&mut self, paint: String, path: String) {
        if path.is_empty() {
            return;
        }
        let known = self.paints.iter().position(|known| *known == paint);
        let paint = known.unwrap_or_else(|| {
            self.paints.push(paint);
            self.paints.len() - 1
        });
        self.paths.push((paint, path));
    }
}

fn stroke(colour: &str, width: f32, more: &str) -> String {
    format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{more}")
}

/// The `d` of an SVG path through points, in whole units.
pub(super) fn path(points: impl IntoIterator<Item = Vec2>) -> String {
    let (mut text, mut last) = (String::new(), IVec2::ZERO);
    for (i, point) in points.into_iter().enumerate() {
        let point = point.round().as_ivec2();
        let step = point - last;
        // A minus parts numbers as well as a blank does.
        text.push_str(match i {
            0 => "M",
            1 => "l",
            _ if step.x < 0 => "",
            _ => " ",
        });
        let gap = if step.y < 0 && i > 0 { "" } else { " " };
        let _ = write!(text, "{}{gap}{}", step.x, step.y);
        last = point;
    }
    text
}

pub(super) fn polygon(points: impl IntoIterator<Item = Vec2>) -> String {
    path(points) + "z"
}

/// All that is needed to draw any tick of a run.
pub(super) struct Drawing<'a> {
    figure: Figure,
    recorded: &'a Recorded,
    camera: Camera,
    pub(super) height: f32,
    /// Half the length of the mark of a singularity the arm is in; m.
    unit: f32,
    floor_m: f32,
}

/// The arm as lines: from each joint to the next, the first from the floor.
fn limbs(figure: &Figure, bodies: &[Placement], floor_m: f32) -> impl Iterator<Item = [Vec3; 2]> {
    let origins = bodies.iter().skip(1).map(|at| at.p);
    let tip = bodies.last().and_then(|at| Some(at.of(figure.tip?)));
    let places: Vec<Vec3> = [Vec3::Z * floor_m]
        .into_iter()
        .chain(origins)
        .chain(tip)
        .collect();
    let pairs = (1..places.len()).map(move |i| [places[i - 1], places[i]]);
    // Joints whose frames coincide have none between them.
    pairs.filter(|[a, b]| a.distance(*b) > 1e-3)
}

/// Base and links at a tick.
fn bodies(recorded: &Recorded, tick: u64) -> Option<Vec<Placement>> {
    let links = recorded.links.iter().map(|link| Some(at(link, tick)?.1));
    std::iter::once(Some(Placement::IDENTITY))
        .chain(links)
        .collect()
}

impl<'a> Drawing<'a> {
    /// `None` where the recording has no picture.
    pub(super) fn new(robot: &Robot, floor_m: f32, recorded: &'a Recorded) -> Option<Self> {
        let figure = Figure::new(robot, floor_m, &Meshes::default());
        let pictures = recorded.links.first()?;
        let first = bodies(recorded, pictures.first()?.0)?;
        if recorded.links.len() != figure.links.len() {
            return None;
        }
        let unit = 0.2 * figure.reach;
        let subject = Subject {
            floor_m,
            ..Subject::default()
        };
        let places: Vec<Vec3> = first[1..].iter().map(|at| at.p).collect();
        let from = Room::of(&places).eye(unit, &subject, !robot.task.0[2]);
        // The whole arm in some ticks, with room for a mark at the hand.
        let mut points: Vec<Vec3> = Vec::new();
        for (tick, _) in pictures.iter().step_by((pictures.len() / 40).max(1)) {
            let Some(bodies) = bodies(recorded, *tick) else {
                continue;
            };
            // Each end of a limb with its roundness.
            let radius = RADIUS * figure.reach;
            let ends = limbs(&figure, &bodies, floor_m).flatten();
            points.extend(ends.flat_map(|p| [p - radius, p + radius]));
            let tip = figure.tip.unwrap_or(Vec3::ZERO);
            let hand = bodies.last().map_or(Vec3::ZERO, |at| at.of(tip));
            points.extend(
                Vec3::AXES
                    .into_iter()
                    .flat_map(|axis| [hand + unit * axis, hand - unit * axis]),
            );
        }
        let (camera, height) = Camera::framing(&from, points.iter().copied(), WIDTH);
        Some(Self {
            figure,
            recorded,
            camera,
            height,
            unit,
            floor_m,
        })
    }

    fn line(&self, points: impl IntoIterator<Item = Vec3>) -> String {
        path(points.into_iter().map(|point| self.camera.place(point)))
    }

    /// The desired path, which is behind everything, over the whole run.
    pub(super) fn ground(&self, out: &mut Picture) {
        let green = stroke(&hex(on_paper(DESIRED)), 9.0, " stroke-opacity=\".7\"");
        out.put(green, self.way(&self.recorded.target, PATH));
    }

    /// All that is drawn at a tick, from the back to the front.
    pub(super) fn at(&self, tick: u64, out: &mut Picture) {
        let Some(bodies) = bodies(self.recorded, tick) else {
            return;
        };
        let mut limbs: Vec<_> = limbs(&self.figure, &bodies, self.floor_m)
            .zip(LIMBS.iter().cycle())
            .collect();
        let depth = |([a, b], _): &([Vec3; 2], _)| self.camera.depth((*a + *b) / 2.0);
        limbs.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        let width = 2.0 * self.camera.units(RADIUS * self.figure.reach);
        for (limb, colour) in limbs {
            // Its edge, and what is within.
            for (light, width) in [(0.5, width + 4.0), (0.95, width)] {
                let colour = hex(shaded(*colour, light));
                out.put(stroke(&colour, width.round(), ""), self.line(limb));
            }
        }
        let hand = between(&self.recorded.hand, 0, tick);
        out.put(stroke(ACTUAL, 4.0, ""), self.way(hand, WAY));
        // Several locks share a centre: each mark is smaller than the one before, and none is drawn that is only near.
        let all = self.recorded.singularities.iter();
        let (inside, near): (Vec<_>, Vec<_>) = all.partition(|one| one.entered(tick).is_some());
        let shown = if inside.is_empty() { near } else { inside };
        for (one, unit) in shown.into_iter().zip([1.0, 0.62, 0.38, 0.24]) {
            if let Some(frame) = self.recorded.fresh(&one.frame, tick) {
                self.mark(one, frame, tick, unit * self.unit, &bodies[1..], out);
            }
        }
    }

    fn mark(
        &self,
        one: &Named,
        frame: &Placement,
        tick: u64,
        unit: f32,
        links: &[Placement],
        out: &mut Picture,
    ) {
        let colour = hex(on_paper(one.colour));
        let is_inside = one.entered(tick).is_some();
        let [faint, pale] = match is_inside {
            true => [""; 2],
            false => [" stroke-opacity=\".35\"", " fill-opacity=\".35\""],
        };
        // The lines on links that show why the arm is singular.
        let reasons = reasons(one.kind, &self.figure, &[]).into_iter();
        for (link, strips, is_second) in reasons.filter(|_| unit == self.unit) {
            let Some(at) = links.get(link) else { continue };
            let strips = strips.iter();
            let strips = strips.map(|strip| self.line(strip.map(|p| at.of(p))));
            let colour = if is_second { SECOND } else { &colour };
            out.put(stroke(colour, 5.0, faint), strips.collect());
        }
        if is_inside {
            self.sector(one, &colour, tick, (frame.p, unit), out);
        }
        let (line, solid) = (
            stroke(&colour, 9.0, faint),
            format!("fill=\"{colour}\"{pale}"),
        );
        let point = |x: f32, y: f32, z: f32| self.camera.place(frame.of(unit * Vec3::new(x, y, z)));
        let ends = [1.0, -1.0].map(|side| point(side, 0.0, 0.0));
        out.put(line.clone(), path(ends));
        if one.is_angular(tick) {
            let turn = |k: u8| {
                let (sin, cos) =
                    (std::f32::consts::TAU * (0.05 + 0.73 * f32::from(k) / 36.0)).sin_cos();
                point(0.0, 0.72 * cos, 0.72 * sin)
            };
            let turns: Vec<Vec2> = (0..=36).map(turn).collect();
            out.put(line, path(turns.iter().copied()));
            for [behind, tip] in [[turns[1], turns[0]], [turns[35], turns[36]]] {
                out.put(solid.clone(), head(tip, (tip - behind).normalize_or_zero()));
            }
        } else {
            let along = (ends[0] - ends[1]).normalize_or_zero();
            let aside = 20.0 * along.perp();
            for (tip, out_of) in [(ends[0], along), (ends[1], -along)] {
                out.put(solid.clone(), head(tip - 26.0 * out_of, out_of));
                out.put(line.clone(), path([tip + aside, tip - aside]));
            }
        }
    }

    /// The sector that ζ has swept since the arm entered.
    fn sector(
        &self,
        one: &Named,
        colour: &str,
        tick: u64,
        (centre, unit): (Vec3, f32),
        out: &mut Picture,
    ) {
        let (directions, turned) = self.recorded.swept(one, tick);
        let Some(first) = directions.first().copied().filter(|_| turned > 5.0) else {
            return;
        };
        let rim = directions.iter().map(|zeta| centre + 0.9 * unit * *zeta);
        let outline = std::iter::once(centre).chain(rim);
        out.put(
            format!("fill=\"{colour}\" fill-opacity=\".3\""),
            self.line(outline) + "z",
        );
        let entry = [1.05, -1.05].map(|side| centre + side * unit * first);
        out.put(
            stroke(colour, 5.0, " stroke-dasharray=\"22 16\""),
            self.line(entry),
        );
    }

    /// A path through some of the places, the last among them; none where nothing moves.
    fn way(&self, rows: &[(u64, Placement)], most: usize) -> String {
        let some = rows.iter().step_by(rows.len().div_ceil(most).max(1));
        let places = some
            .chain(rows.last())
            .map(|(_, at)| self.camera.place(at.p).round());
        let mut places: Vec<Vec2> = places.collect();
        places.dedup();
        if places.len() > 1 {
            path(places)
        } else {
            String::new()
        }
    }
}

/// An arrow head from a point on.
fn head(tip: Vec2, along: Vec2) -> String {
    let aside = along.perp();
    polygon([tip + 30.0 * along, tip + 17.0 * aside, tip - 17.0 * aside])
}
