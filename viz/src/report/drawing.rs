//! The arm, its path and the marks of its singularities at a tick, as paths of a drawing. PURE.

use glam::{Vec2, Vec3};
use model::Robot;
use shared_types::codes::{KIND_NUMERIC, KINDS};

use super::camera::Camera;
use super::path::Path;
use super::poses::{MarkTrack, Poses, swept};
use super::solids::Solids;
use crate::arm::Figure;
use crate::blueprint::Subject;
use crate::narration::colour_of;
use crate::recording::Room;
use crate::scene::reasons;
use crate::solid::{Placement, Rgba};
use crate::tint::{hex, on_paper, shaded};

/// Width of a drawing; units.
pub(super) const WIDTH: f32 = 1000.0;
/// Colour of the desired path, as in the viewer.
const DESIRED: Rgba = [110, 235, 150, 255];
/// The hand's way, which is white in the viewer.
const ACTUAL: &str = "#4a5160";
/// The second of two axes that become one, which is white in the viewer.
const SECOND: &str = "#59606e";
/// Most points of the hand's way in one drawing.
const WAY: usize = 80;

/// A singularity, as the report names it.
#[derive(Clone, Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) kind: u32,
    pub(super) colour: Rgba,
}

impl Named {
    pub(super) fn all(names: &[String]) -> Vec<Self> {
        let of = |(index, name): (usize, &String)| {
            let kind = KINDS
                .iter()
                .find(|(_, known)| known == name)
                .map_or(KIND_NUMERIC, |(kind, _)| *kind);
            Self {
                name: name.clone(),
                kind,
                colour: colour_of(kind, index),
            }
        };
        names.iter().enumerate().map(of).collect()
    }
}

/// All that is needed to draw any tick of a run.
pub(super) struct Drawing<'a> {
    figure: Figure,
    solids: Solids,
    poses: &'a Poses,
    singularities: &'a [Named],
    camera: Camera,
    pub(super) height: f32,
    /// The attributes of a kind of path; each drawn path names its own by its place here.
    pub(super) paints: Vec<String>,
    /// Ticks for which a place of the picture holds.
    hold: u64,
    /// Half the length of the mark of a singularity the arm is in; m.
    unit: f32,
}

impl<'a> Drawing<'a> {
    /// `None` where the recording has no picture.
    pub(super) fn new(
        robot: &Robot,
        floor_m: f32,
        poses: &'a Poses,
        singularities: &'a [Named],
        ticks: &[u64],
    ) -> Option<Self> {
        let figure = Figure::new(robot, floor_m);
        if poses.links.len() != figure.links.len() {
            return None;
        }
        let solids = Solids::new(std::iter::once(&figure.base).chain(&figure.links));
        let unit = 0.2 * figure.reach;
        let mut drawing = Self {
            figure,
            solids,
            poses,
            singularities,
            camera: Camera::framing(&Default::default(), std::iter::empty(), WIDTH).0,
            height: WIDTH,
            paints: Vec::new(),
            hold: ticks
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .min()
                .unwrap_or(1)
                * 3
                / 2,
            unit,
        };
        let first = drawing.bodies(*ticks.first()?)?;
        let places: Vec<Vec3> = first[1..].iter().map(|at| at.p).collect();
        let subject = Subject {
            floor_m,
            ..Subject::default()
        };
        let from = Room::of(places).eye(unit, &subject, !robot.task.0[2]);
        // The whole arm in some ticks, with room for a mark at the hand.
        let some = ticks
            .iter()
            .step_by((ticks.len() / 40).max(1))
            .filter_map(|tick| drawing.bodies(*tick));
        let mut points: Vec<Vec3> = Vec::new();
        for bodies in some {
            points.extend(drawing.solids.points(&bodies));
            let tip = drawing.figure.tip.unwrap_or(Vec3::ZERO);
            let hand = bodies.last().map_or(Vec3::ZERO, |at| at.R * tip + at.p);
            points.extend(
                [Vec3::X, Vec3::Y, Vec3::Z]
                    .into_iter()
                    .flat_map(|axis| [hand + unit * axis, hand - unit * axis]),
            );
        }
        (drawing.camera, drawing.height) = Camera::framing(&from, points.iter().copied(), WIDTH);
        Some(drawing)
    }

    /// Base and links at a tick.
    fn bodies(&self, tick: u64) -> Option<Vec<Placement>> {
        std::iter::once(Some(Placement::IDENTITY))
            .chain(self.poses.links.iter().map(|link| link.at(tick).copied()))
            .collect()
    }

    /// The place of some attributes among the paints.
    fn paint(&mut self, attributes: String) -> usize {
        self.paints
            .iter()
            .position(|known| *known == attributes)
            .unwrap_or_else(|| {
                self.paints.push(attributes);
                self.paints.len() - 1
            })
    }

    fn stroke(&mut self, colour: &str, width: f32, more: &str) -> usize {
        self.paint(format!(
            "fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\"{more}"
        ))
    }

    /// The desired path, which is behind everything, over the whole run.
    pub(super) fn ground(&mut self) -> Vec<(usize, Path)> {
        let rows = self.poses.target.between(0, u64::MAX);
        let green = self.stroke(&hex(on_paper(DESIRED)), 9.0, " stroke-opacity=\".7\"");
        way(rows, &self.camera, 400)
            .map(|path| (green, path))
            .into_iter()
            .collect()
    }

    /// All that is drawn at a tick, from the back to the front.
    pub(super) fn at(&mut self, tick: u64) -> Vec<(usize, Path)> {
        let mut out = Vec::new();
        let Some(bodies) = self.bodies(tick) else {
            return out;
        };
        let colours = self.solids.colours.clone();
        let paints: Vec<[usize; 2]> = colours
            .iter()
            .map(|colour| {
                let edge = hex(shaded(*colour, 0.5));
                [0.87, 1.0].map(|light| {
                    self.paint(format!(
                        "fill=\"{}\" stroke=\"{edge}\" stroke-width=\"2\"",
                        hex(shaded(*colour, light))
                    ))
                })
            })
            .collect();
        self.solids
            .paint(&bodies, &self.camera, |colour, is_end, path| {
                out.push((paints[colour][usize::from(is_end)], path))
            });
        let grey = self.stroke(ACTUAL, 4.0, "");
        out.extend(
            way(self.poses.hand.between(0, tick), &self.camera, WAY).map(|path| (grey, path)),
        );
        let (poses, singularities) = (self.poses, self.singularities);
        for one in singularities {
            if let Some(mark) = poses.marks.get(&one.name)
                && let Some(frame) = mark.frame.fresh(tick, self.hold)
            {
                let is_inside = mark.label.fresh(tick, self.hold).is_some();
                self.mark(&mut out, one, mark, frame, tick, is_inside, &bodies[1..]);
            }
        }
        out
    }

    #[expect(clippy::too_many_arguments, reason = "one mark, where it is and when")]
    fn mark(
        &mut self,
        out: &mut Vec<(usize, Path)>,
        one: &Named,
        mark: &MarkTrack,
        frame: &Placement,
        tick: u64,
        is_inside: bool,
        links: &[Placement],
    ) {
        let colour = hex(on_paper(one.colour));
        let faint = if is_inside {
            ""
        } else {
            " stroke-opacity=\".35\""
        };
        self.why(out, one, (&colour, faint), links);
        let (centre, unit) = (frame.p, self.unit);
        if is_inside {
            self.sector(out, &colour, mark, tick, centre);
        }
        let (zeta, paint) = (frame.R.x_axis, self.stroke(&colour, 9.0, faint));
        let solid = self.paint(format!(
            "fill=\"{colour}\"{}",
            if is_inside {
                ""
            } else {
                " fill-opacity=\".35\""
            }
        ));
        let ends = [1.0, -1.0].map(|side| self.camera.place(centre + side * unit * zeta));
        out.push((paint, Path::line(ends)));
        let along = (ends[0] - ends[1]).normalize_or_zero();
        if mark.is_angular(tick) {
            let point = |turn: f32| {
                let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
                self.camera
                    .place(centre + 0.72 * unit * (frame.R.y_axis * cos + frame.R.z_axis * sin))
            };
            let (from, to) = (0.05, 0.78);
            let turns: Vec<Vec2> = (0..=36)
                .map(|k| point(from + (to - from) * k as f32 / 36.0))
                .collect();
            out.push((paint, Path::line(turns.iter().copied())));
            for [behind, tip] in [[turns[1], turns[0]], [turns[35], turns[36]]] {
                out.push((solid, head(tip, (tip - behind).normalize_or_zero())));
            }
        } else {
            let aside = 20.0 * along.perp();
            for (tip, out_of) in [(ends[0], along), (ends[1], -along)] {
                out.push((solid, head(tip - 26.0 * out_of, out_of)));
                out.push((paint, Path::line([tip + aside, tip - aside])));
            }
        }
    }

    /// The lines on links that show why the arm is singular.
    fn why(
        &mut self,
        out: &mut Vec<(usize, Path)>,
        one: &Named,
        (colour, faint): (&str, &str),
        links: &[Placement],
    ) {
        for (link, strips, is_second) in reasons(one.kind, &self.figure, &[]) {
            let Some(at) = links.get(link) else { continue };
            let paint = self.stroke(if is_second { SECOND } else { colour }, 5.0, faint);
            let ends = |strip: &[[f32; 3]; 2]| {
                Path::line(strip.map(|p| self.camera.place(at.R * Vec3::from_array(p) + at.p)))
            };
            out.push((
                paint,
                strips
                    .iter()
                    .map(ends)
                    .reduce(Path::and)
                    .unwrap_or_default(),
            ));
        }
    }

    /// The sector that ζ has swept since the arm entered.
    fn sector(
        &mut self,
        out: &mut Vec<(usize, Path)>,
        colour: &str,
        mark: &MarkTrack,
        tick: u64,
        centre: Vec3,
    ) {
        let (directions, turned) = swept(mark.since_entry(tick, self.hold));
        let Some(first) = directions.first().copied().filter(|_| turned > 5.0) else {
            return;
        };
        let rim = directions
            .iter()
            .map(|zeta| self.camera.place(centre + 0.9 * self.unit * *zeta));
        let outline: Vec<Vec2> = std::iter::once(self.camera.place(centre))
            .chain(rim)
            .collect();
        let entry = [1.05, -1.05].map(|side| self.camera.place(centre + side * self.unit * first));
        let filled = self.paint(format!("fill=\"{colour}\" fill-opacity=\".3\""));
        let dashed = self.stroke(colour, 5.0, " stroke-dasharray=\"22 16\"");
        out.extend([
            (filled, Path::polygon(outline)),
            (dashed, Path::line(entry)),
        ]);
    }
}

/// An arrow head from a point on.
fn head(tip: Vec2, along: Vec2) -> Path {
    let aside = along.perp();
    Path::polygon([tip + 30.0 * along, tip + 17.0 * aside, tip - 17.0 * aside])
}

/// A path through some of the places, the last among them; none where nothing moves.
fn way(rows: &[(u64, Placement)], camera: &Camera, most: usize) -> Option<Path> {
    let mut points: Vec<Vec2> = rows
        .iter()
        .step_by(rows.len().div_ceil(most).max(1))
        .map(|(_, at)| camera.place(at.p).round())
        .collect();
    points.extend(rows.last().map(|(_, at)| camera.place(at.p).round()));
    points.dedup();
    (points.len() > 1).then(|| Path::line(points))
}
