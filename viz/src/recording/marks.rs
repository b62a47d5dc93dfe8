//! The marks of singularities: the lost direction ζ, what it has swept, and the lines that show why the arm is singular.

use glam::Vec3;
use nalgebra::SVector;
use re_sdk_types::archetypes::{Clear, LineStrips3D, Transform3D};
use shared_types::MAX_DOF;
use shared_types::codes::{KIND_NUMERIC, MODE_REORIENT};
use shared_types::messages::SingularityState;

use super::picture::UNSEEN;
use super::shapes::{arrows, ghost3d, lettered, lines, mesh3d, tinted, words};
use super::{Recording, Track};
use crate::scene::{self, Look, Mark, Presence, dashed, glyph};
use crate::signals::TickRow;
use crate::solid::{Placement, Rgba};
use crate::{entity, narration};

/// Cosine of 8°: how far ζ turns between two pictures of what it has swept.
const SWEEP_STEP: f32 = 0.9903;
/// Degrees between two pictures of the rotation about the old ζ.
const TELL_STEP_DEG: f32 = 5.0;
/// Colour of a direction that is free again.
const FREE: Rgba = [90, 220, 120, 255];

/// The mark of a singularity as the present part has it.
#[derive(Default)]
pub(super) struct Shown {
    look: Look,
    /// Whether ζ turns, of a mark that has its meshes.
    drawn: Option<bool>,
    swept: Option<Swept>,
    /// The links that show why.
    why: Vec<usize>,
}

/// The sector that ζ has swept since the arm entered.
struct Swept {
    /// ζ at successive steps, from entry on.
    directions: Vec<Vec3>,
    /// The hand when ζ had been turned.
    freed: Option<glam::Mat3>,
    /// Degrees of the rotation about the old ζ when last told.
    told_deg: f32,
    /// Whether the arm has left the singularity behind.
    is_over: bool,
}

/// A singularity's mark at a tick, and what the task does there.
struct Named<'a> {
    tick: u64,
    name: &'a str,
    tint: Rgba,
    look: Look,
    centre: Vec3,
    /// On the other side than the mark's label.
    zeta: Vec3,
    segment: usize,
    is_turning: bool,
}

/// A picture of ζ: `sector` swept, its angle in `words`, ζ as it was at the `entry`.
fn zeta_path(name: &str, part: &str) -> String {
    format!("/world/zeta/{name}/{part}")
}

impl Recording {
    /// Half the length of the mark of a singularity the arm is in; m.
    pub(super) fn mark_size(&self) -> f32 {
        0.2 * self.run.figure.reach
    }

    /// Marks change their looks rarely; their places go with the picture.
    pub(super) fn write_marks(
        &mut self,
        row: &TickRow,
        q: &[f64; MAX_DOF],
        marks: &[Mark],
        hand: &Placement,
    ) {
        let is_new = |i: usize, mark: &Mark| {
            mark.is_inside() && self.part.marks[i].look.presence != Presence::Inside
        };
        if marks.iter().enumerate().any(|(i, mark)| is_new(i, mark)) {
            // Labels that stand keep their sides.
            for (i, side) in scene::label_sides(marks).into_iter().enumerate() {
                if self.part.marks[i].look.presence != Presence::Inside {
                    self.story.sides[i] = side;
                }
            }
        }
        for (i, (one, mark)) in row.singularities().iter().zip(marks).enumerate() {
            let Some((name, tint)) = self.subject.singularities.get(i).cloned() else {
                return;
            };
            let command = row.control_state;
            let named = Named {
                tick: row.tick,
                name: &name,
                tint,
                look: mark.look,
                centre: mark.X_BS.p,
                zeta: -self.story.sides[i] * mark.zeta(),
                segment: command.map_or(0, |state| state.segment as usize),
                is_turning: command.is_some_and(|state| state.mode[i] == MODE_REORIENT),
            };
            // Taken out while it changes: the rest of the recording is read then.
            let mut shown = std::mem::take(&mut self.part.marks[i]);
            if shown.look != mark.look {
                shown.look = mark.look;
                self.write_look(&mut shown, &named, mark.edge, &narration::label(one, i));
                self.write_why(&mut shown, &named, one, q);
            }
            shown.swept = self.write_swept(shown.swept.take(), &named, hand);
            self.part.marks[i] = shown;
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame and the words.
    fn write_look(&self, shown: &mut Shown, mark: &Named, edge: f32, text: &str) {
        let Named {
            tick,
            name,
            tint: [r, g, b, _],
            look,
            ..
        } = *mark;
        let part = |part: &str| format!("{}{name}/{part}", entity::SINGULARITY);
        let (solid, rings, unit) = (part("glyph"), part("edge"), self.mark_size());
        // Meshes are large: they are written once, later changes are their tint and their size.
        if shown.drawn != Some(look.angular) && look.presence != Presence::Hidden {
            shown.drawn = Some(look.angular);
            self.log(
                tick,
                solid.as_str(),
                &mesh3d(&glyph(look.angular, [r, g, b, 255])),
            );
            let edge = scene::rings(edge, unit, [255; 4]);
            self.log(tick, rings.as_str(), &ghost3d(&edge, [255; 4]));
        }
        let scale = |scale: f32| Transform3D::update_fields().with_scale(scale);
        let (opacity, rim) = match look.presence {
            Presence::Hidden => {
                self.log(tick, solid, &scale(UNSEEN));
                self.log(tick, rings, &scale(UNSEEN));
                return self.clear(tick, [part("axes"), format!("{}{name}", entity::LABEL)]);
            }
            Presence::Near => (70, [190, 195, 205, 255]),
            Presence::Inside => (255, [255, 110, 110, 255]),
        };
        self.log(tick, solid, &tinted([255, 255, 255, opacity]));
        self.log(tick, rings.as_str(), &tinted(rim));
        self.log(tick, rings, &scale(1.0));
        let label = format!("{}{name}", entity::LABEL);
        if look.presence == Presence::Near {
            return self.clear(tick, [part("axes"), label]);
        }
        let axes = [Vec3::Y, Vec3::Z].map(|axis| 0.5 * unit * axis);
        self.log(
            tick,
            part("axes"),
            &arrows(axes, [0xc8, 0xd0, 0xdc, 0xff], 0.012 * unit),
        );
        self.log(tick, label, &words(Vec3::ZERO, mark.tint, text));
    }

    /// Axes and bones that fall into one line, on the links they belong to: they move with the arm and cost nothing per tick.
    fn write_why(
        &self,
        shown: &mut Shown,
        mark: &Named,
        one: &SingularityState,
        q: &[f64; MAX_DOF],
    ) {
        let path = |link: usize| format!("{}/why_{}", entity::link(entity::LINK, link), mark.name);
        if mark.look.presence == Presence::Hidden {
            return self.clear(
                mark.tick,
                std::mem::take(&mut shown.why).into_iter().map(path),
            );
        }
        if !shown.why.is_empty() {
            return;
        }
        let (joints, reach) = (self.subject.joints, self.run.figure.reach);
        let dependent = match one.kind {
            KIND_NUMERIC if joints <= 6 => {
                let J = self.run.arm.jacobian(&SVector::from(*q));
                scene::dependent_joints(&J, joints, f64::from(0.4 * reach))
            }
            _ => Vec::new(),
        };
        for (link, strips, is_second) in scene::reasons(one.kind, &self.run.figure, &dependent) {
            let drawn = if is_second {
                [245, 245, 250, 255]
            } else {
                mark.tint
            };
            self.log(mark.tick, path(link), &lines(strips, drawn, 0.0045 * reach));
            shown.why.push(link);
        }
    }

    /// The sector that ζ has swept since the arm entered, with its angle; the old ζ, green and with its own angle once it is free again.
    fn write_swept(&self, swept: Option<Swept>, mark: &Named, hand: &Placement) -> Option<Swept> {
        let is_inside = mark.look.presence == Presence::Inside;
        let begin = || Swept {
            directions: vec![mark.zeta],
            freed: None,
            told_deg: 0.0,
            is_over: false,
        };
        let mut swept = swept.or_else(|| is_inside.then(begin))?;
        let (first, last) = (*swept.directions.first()?, *swept.directions.last()?);
        let path = |part: &str| zeta_path(mark.name, part);
        // A few degrees are worth no picture.
        let is_drawn = swept.directions.len() > 2;
        if !is_inside && swept.freed.is_none() {
            // It left as it came.
            self.clear(
                mark.tick,
                ["sector", "words", "entry"]
                    .map(path)
                    .into_iter()
                    .filter(|_| is_drawn),
            );
            return None;
        }
        if is_inside && swept.freed.is_none() && last.dot(mark.zeta) < SWEEP_STEP {
            // ζ is a line: its sign may be either.
            let sign = if last.dot(mark.zeta) < -0.5 {
                -1.0
            } else {
                1.0
            };
            swept.directions.push(sign * mark.zeta);
            self.write_sector(mark, &swept.directions);
        } else if is_drawn {
            self.write_freed(mark, &mut swept, first, hand);
            if mark.look.presence == Presence::Hidden && !swept.is_over {
                // The old ζ stays to be seen until the arm enters again.
                swept.is_over = true;
                self.clear(mark.tick, ["sector", "words"].map(path));
            } else if is_inside && swept.is_over {
                self.clear(mark.tick, [path("entry")]);
                return None;
            }
        }
        Some(swept)
    }

    fn clear(&self, tick: u64, paths: impl IntoIterator<Item = String>) {
        paths
            .into_iter()
            .for_each(|path| self.log(tick, path, &Clear::flat()));
    }

    /// The sector through successive directions, from the third on.
    fn write_sector(&self, mark: &Named, directions: &[Vec3]) {
        if directions.len() < 3 {
            return;
        }
        let (unit, [r, g, b, _]) = (self.mark_size(), mark.tint);
        let steps = directions.windows(2);
        let turned: f32 = steps.map(|pair| pair[0].angle_between(pair[1])).sum();
        let goal = self
            .run
            .segments
            .get(mark.segment)
            .and_then(|one| one.reorient.as_ref());
        let goal = goal.filter(|turn| turn.singularity == mark.name);
        let text = format!(
            "ζ turned {:.0}°{}",
            turned.to_degrees(),
            of(goal.map(|turn| turn.by_deg))
        );
        let arc = directions
            .iter()
            .map(|zeta| (mark.centre + *zeta * 0.97 * unit).to_array());
        let arc = lettered(
            vec![(arc.collect(), mark.tint, text)],
            0.004 * self.run.figure.reach,
        );
        let sector = scene::sector(mark.centre, directions, 0.95 * unit);
        self.log(
            mark.tick,
            zeta_path(mark.name, "sector"),
            &ghost3d(&sector, [r, g, b, 90]),
        );
        self.log(mark.tick, zeta_path(mark.name, "words"), &arc);
        if directions.len() == 3 {
            let dashes = self.old_zeta(mark, directions[0], [r, g, b, 200], String::new());
            self.log(mark.tick, zeta_path(mark.name, "entry"), &dashes);
        }
    }

    /// Turned far enough, and the task goes on with another segment: what was lost is free, and the hand may rotate about it.
    fn write_freed(&self, mark: &Named, swept: &mut Swept, first: Vec3, hand: &Placement) {
        let entry = zeta_path(mark.name, "entry");
        let Some(R_0) = swept.freed else {
            if first.dot(mark.zeta).abs() < 0.72 && !mark.is_turning {
                swept.freed = Some(hand.R);
                let dashes = self.old_zeta(mark, first, FREE, "old ζ: free again".to_owned());
                self.log(mark.tick, entry, &dashes);
            }
            return;
        };
        let (axis, angle) = glam::Quat::from_mat3(&(hand.R * R_0.transpose())).to_axis_angle();
        let about_deg = (angle * axis.dot(first)).to_degrees().abs();
        if about_deg <= swept.told_deg + TELL_STEP_DEG {
            return;
        }
        swept.told_deg = about_deg;
        let wanted = self
            .run
            .segments
            .get(mark.segment)
            .and_then(|one| one.turn.as_ref());
        let text = format!(
            "free again: {about_deg:.0}°{}",
            of(wanted.map(|turn| turn.by_deg))
        );
        self.log(mark.tick, entry, &self.old_zeta(mark, first, FREE, text));
        if mark.look.presence == Presence::Inside {
            self.clear(mark.tick, [zeta_path(mark.name, "words")]);
        }
    }

    /// ζ as it was when the arm entered, dashed, with words at its upper end.
    fn old_zeta(&self, mark: &Named, zeta: Vec3, colour: Rgba, text: String) -> LineStrips3D {
        let unit = self.mark_size();
        let end = 1.15 * unit * zeta;
        let dashes = dashed(mark.centre - end, mark.centre + end, 15, 0).into_iter();
        let up = if zeta.z < 0.0 { -zeta } else { zeta };
        let tip = mark.centre + 1.2 * unit * up;
        let tip = vec![tip.to_array(), (tip + 0.02 * unit * up).to_array()];
        let dashes = dashes.map(|dash| (dash.to_vec(), colour, String::new()));
        lettered(
            dashes.chain([(tip, colour, text)]).collect(),
            0.004 * self.run.figure.reach,
        )
    }

    /// Where the marks are, how large, and where their words stand.
    pub(super) fn place_marks(&mut self, tick: u64, marks: &[Mark]) {
        let (unit, mut labels) = (self.mark_size(), 0.0);
        for (i, (mark, (name, _))) in marks.iter().zip(&self.subject.singularities).enumerate() {
            // Hidden entities need no pose.
            if mark.look.presence == Presence::Hidden {
                continue;
            }
            let path = format!("{}{name}", entity::SINGULARITY);
            let size = Some([unit * mark.size; 3]);
            Track::put(&mut self.tracks, format!("{path}/glyph"), tick, None, size);
            Track::put(&mut self.tracks, path, tick, Some(&mark.X_BS), None);
            if !mark.is_inside() {
                continue;
            }
            // Beside the end of its axis: above it, or below where the axis points down; nearer to C, and higher, the more it lies: words
            // are wide, and hang from their place. Each below the one before: seen from far they would overlap.
            let up = mark.zeta().z.abs();
            let end = mark.zeta() * (self.story.sides[i] * (0.85 + 0.2 * up) * unit);
            let above = if end.z < -0.3 * unit {
                -0.25
            } else {
                0.25 + 0.45 * (1.0 - up)
            };
            let p =
                mark.X_BS.p + end + Vec3::Z * (above * unit) + Vec3::NEG_Z * (0.75 * unit * labels);
            labels += 1.0;
            let at = Placement {
                p,
                ..Placement::IDENTITY
            };
            Track::put(
                &mut self.tracks,
                format!("{}{name}", entity::LABEL),
                tick,
                Some(&at),
                None,
            );
        }
    }
}

/// The part of words that names a goal.
fn of(goal: Option<f64>) -> String {
    goal.map_or(String::new(), |by_deg| format!(" of {:.0}°", by_deg.abs()))
}
