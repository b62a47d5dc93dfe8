//! The marks of singularities: the lost direction ζ, what it has swept, and the lines that show why the arm is singular.

use glam::Vec3;
use nalgebra::SVector;
use re_sdk_types::archetypes::Transform3D;
use shared_types::MAX_DOF;
use shared_types::codes::{KIND_NUMERIC, MODE_REORIENT};

use super::Recording;
use super::picture::UNSEEN;
use super::shapes::{arrows, ghost3d, lettered, lines, mesh3d, tinted, words};
use crate::scene::{self, Look, Mark, Presence, dashed, glyph};
use crate::signals::TickRow;
use crate::solid::{Placement, Rgba};
use crate::tint::faded;
use crate::{entity, narration};

/// Cosine of 8°: how far ζ turns between two pictures of what it has swept.
const SWEEP_STEP: f32 = 0.9903;
/// So many directions of ζ, a few degrees, are worth no picture.
const FEW: usize = 2;
/// Degrees between two pictures of the rotation about the old ζ.
const TELL_STEP_DEG: f32 = 5.0;
/// Colour of a direction that is free again.
const FREE: Rgba = 0x5adc78ff;

/// The mark of a singularity as the present part has it.
#[derive(Default)]
pub(super) struct Shown {
    look: Look,
    /// Whether ζ turns, of a mark that has its meshes.
    drawn: Option<bool>,
    swept: Option<Swept>,
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

impl Named<'_> {
    /// A part of the mark.
    fn part(&self, part: &str) -> String {
        format!("{}{}/{part}", entity::SINGULARITY, self.name)
    }

    /// A picture of ζ: `sector` swept, its angle in `words`, ζ as it was at the `entry`.
    fn zeta(&self, part: &str) -> String {
        format!("/world/zeta/{}/{part}", self.name)
    }

    fn label(&self) -> String {
        format!("{}{}", entity::LABEL, self.name)
    }
}

impl Recording {
    /// Half the length of the mark of a singularity the arm is in; m.
    pub(super) fn mark_size(&self) -> f32 {
        0.2 * self.run.figure.reach
    }

    /// Lines of marks and of turned joints; m.
    pub(super) fn fine(&self) -> f32 {
        0.004 * self.run.figure.reach
    }

    /// Marks change their looks rarely; their places go with the picture.
    pub(super) fn write_marks(
        &mut self,
        row: &TickRow,
        q: &[f64; MAX_DOF],
        marks: &[Mark],
        hand: &Placement,
    ) {
        let is_inside = |shown: &Shown| shown.look.presence == Presence::Inside;
        let shown = self.part.marks.iter().map(is_inside);
        if marks
            .iter()
            .zip(shown.clone())
            .any(|(mark, shown)| mark.is_inside() && !shown)
        {
            // Labels that stand keep their sides.
            let sides = self.story.sides.iter_mut().zip(scene::label_sides(marks));
            for ((known, side), _) in sides.zip(shown).filter(|(_, shown)| !shown) {
                *known = side;
            }
        }
        let singularities = self.subject.singularities.clone();
        let all = row.singularities().iter().zip(marks).zip(&singularities);
        for (i, ((one, mark), (name, tint))) in all.enumerate() {
            let command = row.control_state;
            let named = Named {
                tick: row.tick,
                name,
                tint: *tint,
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
                self.write_why(&named, one.kind, q);
            }
            shown.swept = self.write_swept(shown.swept.take(), &named, hand);
            self.part.marks[i] = shown;
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame and the words.
    fn write_look(&mut self, shown: &mut Shown, mark: &Named, edge: f32, text: &str) {
        let (tick, unit) = (mark.tick, self.mark_size());
        let Look { presence, angular } = mark.look;
        let [solid, rings] = ["glyph", "edge"].map(|part| mark.part(part));
        // Meshes are large: they are written once, later changes are their tint and their size.
        if shown.drawn != Some(angular) && presence != Presence::Hidden {
            shown.drawn = Some(angular);
            self.log(tick, &solid, &mesh3d(&glyph(angular, mark.tint)));
            let edge = scene::rings(edge, unit, 0xffffffff);
            self.log(tick, &rings, &ghost3d(&edge, 0xffffffff));
        }
        let scale = |scale: f32| Transform3D::update_fields().with_scale(scale);
        let tints = match presence {
            Presence::Hidden => None,
            Presence::Near => Some((0xffffff46, 0xbec3cdff)),
            Presence::Inside => Some((0xffffffff, 0xff6e6eff)),
        };
        if let Some((inner, rim)) = tints {
            self.log(tick, &solid, &tinted(inner));
            self.log(tick, &rings, &tinted(rim));
            self.log(tick, &rings, &scale(1.0));
        } else {
            self.log(tick, &solid, &scale(UNSEEN));
            self.log(tick, &rings, &scale(UNSEEN));
        }
        if presence == Presence::Inside {
            let axes = [Vec3::Y, Vec3::Z].map(|axis| 0.5 * unit * axis);
            let axes = arrows(Vec3::ZERO, axes, 0xc8d0dcff, 0.012 * unit);
            self.draw(tick, mark.part("axes"), &axes);
            self.draw(tick, mark.label(), &words(Vec3::ZERO, mark.tint, text));
        } else {
            self.clear(tick, [mark.part("axes"), mark.label()]);
        }
    }

    /// Axes and bones that fall into one line, on the links they belong to: they move with the arm and cost nothing per tick.
    fn write_why(&mut self, mark: &Named, kind: u32, q: &[f64; MAX_DOF]) {
        let (joints, reach) = (self.subject.joints, self.run.figure.reach);
        let path = |link: usize| format!("{}/why_{}", entity::link(entity::LINK, link), mark.name);
        if mark.look.presence == Presence::Hidden {
            return self.clear(mark.tick, (0..joints).map(path));
        }
        if (0..joints).any(|link| self.part.drawn.contains(&path(link))) {
            return;
        }
        let dependent = match kind {
            KIND_NUMERIC if joints <= 6 => {
                let J = self.run.arm.jacobian(&SVector::from(*q));
                scene::dependent_joints(&J, joints, f64::from(0.4 * reach))
            }
            _ => Vec::new(),
        };
        for (link, strips, is_second) in scene::reasons(kind, &self.run.figure, &dependent) {
            let drawn = if is_second { 0xf5f5faff } else { mark.tint };
            let strips = lines(strips, drawn, 0.0045 * reach);
            self.draw(mark.tick, path(link), &strips);
        }
    }

    /// The sector that ζ has swept since the arm entered, with its angle; the old ζ, green and with its own angle once it is free again.
    fn write_swept(
        &mut self,
        swept: Option<Swept>,
        mark: &Named,
        hand: &Placement,
    ) -> Option<Swept> {
        let is_inside = mark.look.presence == Presence::Inside;
        let begin = || Swept {
            directions: vec![mark.zeta],
            freed: None,
            told_deg: 0.0,
            is_over: false,
        };
        let mut swept = swept.or_else(|| is_inside.then(begin))?;
        if !is_inside && swept.freed.is_none() {
            // It left as it came.
            self.clear(
                mark.tick,
                ["sector", "words", "entry"].map(|part| mark.zeta(part)),
            );
            return None;
        }
        let last = *swept.directions.last()?;
        if is_inside && swept.freed.is_none() && last.dot(mark.zeta) < SWEEP_STEP {
            // ζ is a line: its sign may be either.
            let sign = if last.dot(mark.zeta) < -0.5 {
                -1.0
            } else {
                1.0
            };
            swept.directions.push(sign * mark.zeta);
            self.write_sector(mark, &swept.directions);
        } else if swept.directions.len() > FEW {
            self.write_freed(mark, &mut swept, hand);
            if mark.look.presence == Presence::Hidden && !swept.is_over {
                // The old ζ stays to be seen until the arm enters again.
                swept.is_over = true;
                self.clear(mark.tick, ["sector", "words"].map(|part| mark.zeta(part)));
            } else if is_inside && swept.is_over {
                self.clear(mark.tick, [mark.zeta("entry")]);
                return None;
            }
        }
        Some(swept)
    }

    /// The sector through successive directions.
    fn write_sector(&mut self, mark: &Named, directions: &[Vec3]) {
        if directions.len() <= FEW {
            return;
        }
        let unit = self.mark_size();
        let steps = directions.windows(2);
        let turned: f32 = steps.map(|pair| pair[0].angle_between(pair[1])).sum();
        let goal = self.run.segments.get(mark.segment);
        let goal = goal.and_then(|one| one.reorient.as_ref());
        let goal = goal.filter(|turn| turn.singularity == mark.name);
        let goal = of(goal.map(|turn| turn.by_deg));
        let text = format!("ζ turned {:.0}°{goal}", turned.to_degrees());
        let arc = directions
            .iter()
            .map(|zeta| mark.centre + *zeta * 0.97 * unit);
        let arc = lettered(vec![(arc.collect(), mark.tint, text)], self.fine());
        let sector = scene::sector(mark.centre, directions, 0.95 * unit);
        self.draw(
            mark.tick,
            mark.zeta("sector"),
            &ghost3d(&sector, faded(mark.tint, 90)),
        );
        self.draw(mark.tick, mark.zeta("words"), &arc);
        if directions.len() == FEW + 1 {
            self.write_old_zeta(mark, directions[0], faded(mark.tint, 200), String::new());
        }
    }

    /// Turned far enough, and the task goes on with another segment: what was lost is free, and the hand may rotate about it.
    fn write_freed(&mut self, mark: &Named, swept: &mut Swept, hand: &Placement) {
        let first = swept.directions[0];
        let Some(R_0) = swept.freed else {
            if first.dot(mark.zeta).abs() < 0.72 && !mark.is_turning {
                swept.freed = Some(hand.R);
                self.write_old_zeta(mark, first, FREE, "old ζ: free again".to_owned());
            }
            return;
        };
        let (axis, angle) = glam::Quat::from_mat3(&(hand.R * R_0.transpose())).to_axis_angle();
        let about_deg = (angle * axis.dot(first)).to_degrees().abs();
        if about_deg <= swept.told_deg + TELL_STEP_DEG {
            return;
        }
        swept.told_deg = about_deg;
        let wanted = self.run.segments.get(mark.segment);
        let wanted = wanted.and_then(|one| one.turn.as_ref());
        let wanted = of(wanted.map(|turn| turn.by_deg));
        let text = format!("free again: {about_deg:.0}°{wanted}");
        self.write_old_zeta(mark, first, FREE, text);
        if mark.look.presence == Presence::Inside {
            self.clear(mark.tick, [mark.zeta("words")]);
        }
    }

    /// ζ as it was when the arm entered, dashed, with words at its upper end.
    fn write_old_zeta(&mut self, mark: &Named, zeta: Vec3, colour: Rgba, text: String) {
        let unit = self.mark_size();
        let end = 1.15 * unit * zeta;
        let dashes = dashed(mark.centre - end, mark.centre + end, 15, 0).into_iter();
        let up = if zeta.z < 0.0 { -zeta } else { zeta };
        let tip = mark.centre + 1.2 * unit * up;
        let tip = vec![tip, tip + 0.02 * unit * up];
        let dashes = dashes.map(|dash| (dash.to_vec(), colour, String::new()));
        let all = dashes.chain([(tip, colour, text)]).collect();
        self.draw(mark.tick, mark.zeta("entry"), &lettered(all, self.fine()));
    }

    /// Where the marks are, how large, and where their words stand.
    pub(super) fn place_marks(&mut self, tick: u64, marks: &[Mark]) {
        let (unit, mut labels) = (self.mark_size(), 0.0);
        for (i, mark) in marks
            .iter()
            .enumerate()
            .take(self.subject.singularities.len())
        {
            // Hidden entities need no pose.
            if mark.look.presence == Presence::Hidden {
                continue;
            }
            let name = self.subject.singularities[i].0.clone();
            let path = format!("{}{name}", entity::SINGULARITY);
            let sizes = &mut self.track(format!("{path}/glyph"), tick).sizes;
            sizes.push([unit * mark.size; 3]);
            self.place(path, tick, mark.X_BS);
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
            let R = glam::Mat3::IDENTITY;
            let p = mark.X_BS.p + end + Vec3::Z * (unit * (above - 0.75 * labels));
            labels += 1.0;
            self.place(format!("{}{name}", entity::LABEL), tick, Placement { R, p });
        }
    }
}

/// The part of words that names a goal.
fn of(goal: Option<f64>) -> String {
    goal.map_or(String::new(), |by_deg| format!(" of {:.0}°", by_deg.abs()))
}
