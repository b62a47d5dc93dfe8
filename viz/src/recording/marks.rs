//! The marks of singularities: the lost direction ζ, what it has swept, the lines that show why the arm is singular, and two captions.

use glam::{Mat3, Vec3};
use nalgebra::SVector;
use re_sdk_types::archetypes::Transform3D;
use shared_types::MAX_DOF;
use shared_types::codes::{KIND_NUMERIC, MODE_REORIENT, reason_text, singularity_name};

use super::Recording;
use super::picture::UNSEEN;
use super::shapes::{arrows, ghost3d, lines, mesh3d, tinted, words};
use crate::scene::{self, Look, Mark, Presence, dashed, glyph};
use crate::signals::TickRow;
use crate::solid::{Placement, Rgba};
use crate::tint::faded;
use crate::{entity, narration};

/// Cosine of 8°: how far ζ turns between two pictures of what it has swept.
const SWEEP_STEP: f32 = 0.9903;
/// So many directions of ζ, a few degrees, are worth no picture.
const FEW: usize = 2;
/// Colour of a direction that is free again.
const FREE: Rgba = 0x5adc78ff;
/// How far above and below the centre of the marks the captions stand, in half lengths of a mark.
const CAPTION: f32 = 1.25;

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
    is_turning: bool,
    /// The hand when ζ had been turned, and the segment that turns it about the old ζ.
    freed: Option<glam::Mat3>,
    segment: Option<usize>,
    /// The words on it.
    text: String,
}

/// A singularity's mark at a tick, and what the task does there.
struct Named<'a> {
    tick: u64,
    name: &'a str,
    tint: Rgba,
    look: Look,
    centre: Vec3,
    zeta: Vec3,
    segment: usize,
    is_turning: bool,
}

impl Named<'_> {
    /// A part of the mark.
    fn part(&self, part: &str) -> String {
        format!("{}{}/{part}", entity::SINGULARITY, self.name)
    }

    /// A picture of ζ: the `sector` swept, and ζ as it was at the `entry`.
    fn zeta(&self, part: &str) -> String {
        format!("/world/zeta/{}/{part}", self.name)
    }
}

impl Recording<'_> {
    /// Marks change their looks rarely; their places go with the picture.
    pub(super) fn write_marks(
        &mut self,
        row: &TickRow,
        q: &[f64; MAX_DOF],
        marks: &[Mark],
        hand: &Placement,
    ) {
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
                zeta: mark.zeta(),
                segment: command.map_or(0, |state| state.segment as usize),
                is_turning: command.is_some_and(|state| state.mode[i] == MODE_REORIENT),
            };
            // Taken out while it changes: the rest of the recording is read then.
            let mut shown = std::mem::take(&mut self.picture.marks[i]);
            if shown.look != mark.look {
                shown.look = mark.look;
                self.write_look(&mut shown, &named, mark.edge);
                self.write_why(&named, one.kind, q);
            }
            shown.swept = self.write_swept(shown.swept.take(), &named, hand);
            self.picture.marks[i] = shown;
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame.
    fn write_look(&mut self, shown: &mut Shown, mark: &Named, edge: f32) {
        let (tick, unit) = (mark.tick, self.run.mark_size());
        let Look { presence, angular } = mark.look;
        let [solid, rings] = ["glyph", "edge"].map(|part| mark.part(part));
        // Meshes are large: they are written once, later changes are their tint and their size.
        if shown.drawn != Some(angular) && presence != Presence::Hidden {
            shown.drawn = Some(angular);
            self.sink
                .log(tick, &solid, &mesh3d(&glyph(angular, mark.tint)));
            let edge = scene::rings(edge, unit, 0xffffffff);
            self.sink.log(tick, &rings, &ghost3d(&edge, 0xffffffff));
        }
        let scale = |scale: f32| Transform3D::update_fields().with_scale(scale);
        let tints = match presence {
            Presence::Hidden => None,
            Presence::Near => Some((0xffffff46, 0xbec3cdff)),
            Presence::Inside => Some((0xffffffff, 0xff6e6eff)),
        };
        if let Some((inner, rim)) = tints {
            self.sink.log(tick, &solid, &tinted(inner));
            self.sink.log(tick, &rings, &tinted(rim));
            self.sink.log(tick, &rings, &scale(1.0));
        } else {
            self.sink.log(tick, &solid, &scale(UNSEEN));
            self.sink.log(tick, &rings, &scale(UNSEEN));
        }
        let axes = match presence {
            Presence::Inside => &[Vec3::Y, Vec3::Z][..],
            _ => &[],
        };
        let axes = axes.iter().map(|axis| 0.5 * unit * *axis);
        let axes = arrows(Vec3::ZERO, axes, 0xc8d0dcff, 0.012 * unit);
        self.sink.log(tick, mark.part("axes"), &axes);
    }

    /// Axes and bones that fall into one line, on the links they belong to: they move with the arm and cost nothing per tick.
    fn write_why(&mut self, mark: &Named, kind: u32, q: &[f64; MAX_DOF]) {
        let (joints, reach) = (self.subject.joints, self.run.figure.reach);
        let path = |link: usize| format!("{}/why_{}", entity::link(entity::LINK, link), mark.name);
        if mark.look.presence == Presence::Hidden {
            return self.clear(mark.tick, (0..joints).map(path));
        }
        if (0..joints).any(|link| self.picture.drawn.contains(&path(link))) {
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
            let strips = lines(strips, drawn, 0.0025 * reach);
            self.draw(mark.tick, path(link), &strips);
        }
    }

    /// The sector that ζ has swept since the arm entered; the old ζ, green once it is free again; and their words.
    fn write_swept(
        &mut self,
        swept: Option<Swept>,
        mark: &Named,
        hand: &Placement,
    ) -> Option<Swept> {
        let is_inside = mark.look.presence == Presence::Inside;
        let begin = || Swept {
            directions: vec![mark.zeta],
            is_turning: false,
            freed: None,
            segment: None,
            text: String::new(),
        };
        let mut swept = swept.or_else(|| is_inside.then(begin))?;
        let (first, last) = (swept.directions[0], *swept.directions.last()?);
        // ζ is a line: its sign may be either.
        let zeta = mark.zeta * last.dot(mark.zeta).signum();
        let segment = self.run.job.scenario.segment.get(mark.segment);
        let goal = segment.and_then(|one| one.reorient.as_ref());
        let goal = goal.filter(|turn| turn.singularity == mark.name);
        let goal = goal.map(|turn| turn.by_deg);
        let is_over = segment.is_some() && swept.segment.is_some_and(|of| of != mark.segment);
        if is_over || (!is_inside && swept.freed.is_none()) {
            // It left as it came, or the task has gone on to something else.
            self.clear(mark.tick, ["sector", "entry"].map(|part| mark.zeta(part)));
            return is_inside.then(begin);
        }
        if let Some(R_0) = swept.freed {
            let by = hand.R * R_0.transpose();
            return Some(self.write_freed(swept, mark, by));
        }
        let has_ended = swept.is_turning && !mark.is_turning;
        swept.is_turning = mark.is_turning;
        if last.dot(zeta) < SWEEP_STEP || has_ended {
            swept.directions.push(zeta);
            self.write_sector(mark, &swept.directions);
        }
        if swept.directions.len() > FEW {
            let steps = swept.directions.windows(2);
            let turned: f32 = steps.map(|pair| pair[0].angle_between(pair[1])).sum();
            let turned = (turned + swept.directions.last()?.angle_between(zeta)).to_degrees();
            swept.text = format!("ζ turned {turned:.0}°{}", of(goal));
            if first.dot(zeta).abs() < 0.72 && !mark.is_turning {
                // Turned far enough, and the task goes on with another segment: the hand may rotate about the old ζ.
                swept.freed = Some(hand.R);
                swept.text = "the old ζ is free again".to_owned();
                self.write_old_zeta(mark, first, FREE);
            }
        }
        Some(swept)
    }

    /// The hand's rotation about the old ζ, by `by` since that is free again.
    fn write_freed(&mut self, mut swept: Swept, mark: &Named, by: Mat3) -> Swept {
        let segment = self.run.job.scenario.segment.get(mark.segment);
        if let Some(turn) = segment.and_then(|one| one.turn.as_ref()) {
            let (axis, angle) = glam::Quat::from_mat3(&by).to_axis_angle();
            let turned = (angle * axis.dot(swept.directions[0])).to_degrees().abs();
            swept.segment = Some(mark.segment);
            swept.text = format!("free again: {turned:.0}°{}", of(Some(turn.by_deg)));
        }
        if mark.look.presence == Presence::Hidden {
            self.clear(mark.tick, [mark.zeta("sector")]);
        }
        swept
    }

    /// The sector through successive directions.
    fn write_sector(&mut self, mark: &Named, directions: &[Vec3]) {
        if directions.len() <= FEW {
            return;
        }
        let sector = scene::sector(mark.centre, directions, 0.95 * self.run.mark_size());
        let sector = ghost3d(&sector, faded(mark.tint, 90));
        self.draw(mark.tick, mark.zeta("sector"), &sector);
        if directions.len() == FEW + 1 {
            self.write_old_zeta(mark, directions[0], faded(mark.tint, 200));
        }
    }

    /// ζ as it was when the arm entered, dashed.
    fn write_old_zeta(&mut self, mark: &Named, zeta: Vec3, colour: Rgba) {
        let end = 1.15 * self.run.mark_size() * zeta;
        let dashes = dashed(mark.centre - end, mark.centre + end, 15, 0);
        let dashes = lines(dashes, colour, self.run.fine());
        self.draw(mark.tick, mark.zeta("entry"), &dashes);
    }

    /// Where the marks are, and how large.
    pub(super) fn place_marks(&mut self, tick: u64, marks: &[Mark]) {
        let unit = self.run.mark_size();
        let names = self.subject.singularities.clone();
        for (mark, (name, _)) in marks.iter().zip(&names) {
            // Hidden entities need no pose.
            if mark.look.presence != Presence::Hidden {
                let path = format!("{}{name}", entity::SINGULARITY);
                let sizes = &mut self.track(format!("{path}/glyph"), tick).sizes;
                sizes.push([unit * mark.size; 3]);
                self.place(path, tick, mark.X_BS);
            }
        }
    }

    /// Two captions, so that none is ever drawn over another: what is lost, above the marks, and what happens, below them.
    pub(super) fn write_captions(&mut self, row: &TickRow, marks: &[Mark], hand: Vec3) {
        let inside = row.singularities().iter().enumerate();
        let inside: Vec<_> = inside.filter(|(_, one)| one.inside == 1).collect();
        let name = |(i, one): &(usize, &shared_types::SingularityState)| {
            singularity_name(one.kind, *i).to_owned()
        };
        let lost = match &inside[..] {
            [] => String::new(),
            [only] => format!(
                "{}: cannot {}",
                name(only),
                narration::lost(only.1.angular == 1)
            ),
            all => all.iter().map(name).collect::<Vec<_>>().join(", ") + ": locked",
        };
        let marks_shown = self.picture.marks.iter();
        let swept = marks_shown.filter_map(|shown| shown.swept.as_ref());
        let swept = swept.filter(|swept| !swept.text.is_empty());
        let swept = swept.max_by_key(|swept| swept.freed.is_some());
        let now = match (row.servo_state, swept) {
            (Some(state), _) => reason_text(state.reason, state.joint, state.upper).to_string(),
            (None, Some(swept)) if swept.freed.is_some() => swept.text.clone(),
            (None, swept) => {
                let swept = swept.map(|swept| swept.text.clone());
                let parts = [self.motion.null.words(), swept.unwrap_or_default()];
                let parts = parts.into_iter().filter(|part| !part.is_empty());
                parts.collect::<Vec<_>>().join(": ")
            }
        };
        let up = self.subject.eye.up.normalize_or(Vec3::Z) * (CAPTION * self.run.mark_size());
        let centre = marks.first().map_or(hand, |mark| mark.X_BS.p);
        let all = [(lost, centre + up), (now, centre - up)];
        for (k, (text, p)) in all.into_iter().enumerate() {
            let path = format!("{}{k}", entity::CAPTION);
            if text.is_empty() {
                self.clear(row.tick, [path]);
            } else {
                if self.picture.captions[k] != text {
                    self.draw(row.tick, path.clone(), &words(&text));
                }
                self.place(path, row.tick, Placement::at(p));
            }
            self.picture.captions[k] = text;
        }
    }
}

/// The part of words that names a goal.
fn of(goal: Option<f64>) -> String {
    goal.map_or(String::new(), |by_deg| format!(" of {:.0}°", by_deg.abs()))
}
