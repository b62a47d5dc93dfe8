//! The marks of singularities: the lost direction ζ, what it has swept, and the lines that show why the arm is singular.

use glam::Vec3;
use nalgebra::SVector;
use re_sdk_types::archetypes::{Arrows3D, Clear, LineStrips3D, Points3D, Transform3D};
use re_sdk_types::components::Radius;
use shared_types::codes::MODE_REORIENT;
use shared_types::messages::SingularityState;

use super::pieces::{ghost3d, lettered, mesh3d, rgba, tinted};
use super::state::{Recording, Swept};
use crate::scene::{Mark, Presence, dashed, glyph};
use crate::signals::TickRow;
use crate::solid::{Placement, Rgba};
use crate::tint::of_words;
use crate::{entity, narration, scene};

/// A size that cannot be seen. Nothing else hides a mesh that is to come back: none would be its own size, and a cleared one had to be
/// written again.
pub(super) const UNSEEN: f32 = 1e-6;
/// Cosine of 8°: how far ζ turns between two pictures of what it has swept.
const SWEEP_STEP: f32 = 0.9903;
/// Degrees between two pictures of the rotation about the old ζ.
const TELL_STEP_DEG: f32 = 5.0;
/// Colour of a direction that is free again.
const FREE: Rgba = [90, 220, 120, 255];

/// A singularity's mark at a tick.
struct Named<'a> {
    tick: u64,
    number: usize,
    name: &'a str,
    tint: Rgba,
    centre: Vec3,
    zeta: Vec3,
    is_inside: bool,
    is_hidden: bool,
}

impl Recording {
    /// Marks change their looks rarely; their places go with the picture.
    pub(super) fn write_marks(
        &mut self,
        row: &TickRow,
        q: &[f64],
        marks: &[Mark],
        hand: &Placement,
    ) {
        let tick = row.tick;
        let is_inside = |mark: &Mark| mark.look.presence == Presence::Inside;
        let entered = marks
            .iter()
            .zip(&self.part.marks)
            .any(|(mark, before)| is_inside(mark) && before.presence != Presence::Inside);
        if entered {
            // Labels that stand keep their sides.
            for ((side, new), before) in self
                .story
                .sides
                .iter_mut()
                .zip(scene::label_sides(marks))
                .zip(&self.part.marks)
            {
                if before.presence != Presence::Inside {
                    *side = new;
                }
            }
        }
        for (i, (one, mark)) in row.singularities().iter().zip(marks).enumerate() {
            let Some((name, tint)) = self.subject.singularities.get(i).cloned() else {
                return;
            };
            if self.part.marks[i] != mark.look {
                self.part.marks[i] = mark.look;
                self.write_look(tick, &name, tint, i, mark, &narration::label(one, i));
                self.write_why(tick, &name, tint, i, one, q);
            }
            let task = row.control_state.map_or((0, false), |state| {
                (state.segment as usize, state.mode[i] == MODE_REORIENT)
            });
            let mark = Named {
                tick,
                number: i,
                name: &name,
                tint,
                centre: mark.X_BS.p,
                // On the other side than the mark's label.
                zeta: -self.story.sides[i] * mark.zeta(),
                is_inside: is_inside(mark),
                is_hidden: mark.look.presence == Presence::Hidden,
            };
            self.write_swept(&mark, task, hand);
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame and the words.
    fn write_look(
        &mut self,
        tick: u64,
        name: &str,
        [r, g, b, _]: Rgba,
        i: usize,
        mark: &Mark,
        words: &str,
    ) {
        let path = entity::singularity(name);
        let [solid, rings, axes, label] = [
            entity::glyph(name),
            entity::edge(name),
            format!("{path}/axes"),
            entity::label(name),
        ];
        let unit = self.mark_size();
        // Meshes are large: they are written once, later changes are their tint and their size.
        if self.part.drawn[i] != Some(mark.look.angular) && mark.look.presence != Presence::Hidden {
            self.part.drawn[i] = Some(mark.look.angular);
            let glyph = mesh3d(&glyph(mark.look.angular, [r, g, b, 255]), None);
            let edge = ghost3d(&scene::rings(mark.edge, unit, [255; 4]), [255; 4]);
            self.log(tick, &*solid, &glyph);
            self.log(tick, &*rings, &edge);
        }
        let (presence, is_inside) = (mark.look.presence, mark.look.presence == Presence::Inside);
        if presence == Presence::Hidden {
            for path in [solid, rings] {
                self.log(tick, path, &Transform3D::update_fields().with_scale(UNSEEN));
            }
        } else {
            let (opacity, rim) = match is_inside {
                true => (255, [255, 110, 110, 255]),
                false => (70, [190, 195, 205, 255]),
            };
            self.log(tick, solid, &tinted([255, 255, 255, opacity]));
            self.log(tick, &*rings, &tinted(rim));
            self.log(tick, rings, &Transform3D::update_fields().with_scale(1.0));
        }
        if !is_inside {
            self.clear(tick, axes);
            self.clear(tick, label);
            return;
        }
        let frame = Arrows3D::from_vectors([[0.0, 0.5 * unit, 0.0], [0.0, 0.0, 0.5 * unit]])
            .with_colors([0xc8d0dcff_u32])
            .with_radii([0.012 * unit]);
        self.log(tick, axes, &frame);
        let point = Points3D::new([[0.0; 3]])
            .with_radii([Radius::new_ui_points(0.5)])
            .with_colors([rgba(of_words([r, g, b, 255]))])
            .with_labels([words])
            .with_show_labels(true);
        self.log(tick, label, &point);
    }

    /// Axes and bones that fall into one line, on the links they belong to: they move with the arm and cost nothing per tick.
    fn write_why(
        &mut self,
        tick: u64,
        name: &str,
        tint: Rgba,
        i: usize,
        one: &SingularityState,
        q: &[f64],
    ) {
        if self.part.marks[i].presence == Presence::Hidden {
            for link in std::mem::take(&mut self.part.why[i]) {
                self.log(tick, entity::reason(name, link), &Clear::flat());
            }
            return;
        }
        if !self.part.why[i].is_empty() {
            return;
        }
        let joints = self.subject.joints;
        let dependent = match one.kind {
            shared_types::codes::KIND_NUMERIC if joints <= 6 => scene::dependent_joints(
                &self.run.arm.jacobian(&SVector::from_column_slice(q)),
                joints,
                f64::from(0.4 * self.run.figure.reach),
            ),
            _ => Vec::new(),
        };
        for (link, strips, is_second) in scene::reasons(one.kind, &self.run.figure, &dependent) {
            let drawn = if is_second {
                [245, 245, 250, 255]
            } else {
                tint
            };
            let lines = LineStrips3D::new(strips)
                .with_colors([rgba(drawn)])
                .with_radii([0.0045 * self.run.figure.reach]);
            self.log(tick, entity::reason(name, link), &lines);
            self.part.why[i].push(link);
        }
    }

    /// The sector that ζ has swept since the arm entered, with its angle; the old ζ, green and with its own angle once it is free again.
    fn write_swept(&mut self, mark: &Named, task: (usize, bool), hand: &Placement) {
        let (name, zeta) = (mark.name, mark.zeta);
        let mut swept = match self.part.swept[mark.number].take() {
            Some(swept) => swept,
            None if mark.is_inside => Swept {
                directions: vec![zeta],
                freed: None,
                told_deg: 0.0,
                is_over: false,
            },
            None => return,
        };
        let (Some(&first), Some(&last)) = (swept.directions.first(), swept.directions.last())
        else {
            return;
        };
        // A few degrees are worth no picture.
        let is_drawn = swept.directions.len() > 2;
        if !mark.is_inside && swept.freed.is_none() {
            // It left as it came.
            if is_drawn {
                self.clear(mark.tick, entity::sector(name));
                self.clear(mark.tick, entity::swept(name));
                self.clear(mark.tick, entity::entry(name));
            }
            return;
        }
        if mark.is_inside && swept.freed.is_none() && last.dot(zeta) < SWEEP_STEP {
            // ζ is a line: its sign may be either.
            let zeta = if last.dot(zeta) < -0.5 { -zeta } else { zeta };
            swept.directions.push(zeta);
            self.write_sector(mark, &swept.directions, task.0);
        } else if is_drawn {
            self.write_freed(mark, &mut swept, first, task, hand);
            if mark.is_hidden && !swept.is_over {
                // The old ζ stays to be seen until the arm enters again.
                swept.is_over = true;
                self.clear(mark.tick, entity::sector(name));
                self.clear(mark.tick, entity::swept(name));
            } else if mark.is_inside && swept.is_over {
                self.clear(mark.tick, entity::entry(name));
                return;
            }
        }
        self.part.swept[mark.number] = Some(swept);
    }

    fn clear(&self, tick: u64, path: String) {
        self.log(tick, path, &Clear::flat());
    }

    /// The sector through successive directions, from the third on.
    fn write_sector(&self, mark: &Named, directions: &[Vec3], segment: usize) {
        if directions.len() < 3 {
            return;
        }
        let (name, centre, unit) = (mark.name, mark.centre, self.mark_size());
        let [r, g, b, _] = mark.tint;
        let steps = directions.windows(2);
        let turned: f32 = steps.map(|pair| pair[0].angle_between(pair[1])).sum();
        let goal = self.run.wanted_turns.get(segment).and_then(Option::as_ref);
        let goal = goal.filter(|(of, _)| of == name);
        let of = goal.map_or(String::new(), |(_, by)| format!(" of {:.0}°", by.abs()));
        let words = format!("ζ turned {:.0}°{of}", turned.to_degrees());
        let mesh = scene::sector(centre, directions, 0.95 * unit);
        let arc = directions.iter();
        let arc = arc.map(|direction| (centre + *direction * 0.97 * unit).to_array());
        let arc = lettered(
            vec![arc.collect()],
            vec![mark.tint],
            vec![words],
            0.004 * self.run.figure.reach,
        );
        self.log(
            mark.tick,
            entity::sector(name),
            &ghost3d(&mesh, [r, g, b, 90]),
        );
        self.log(mark.tick, entity::swept(name), &arc);
        if directions.len() == 3 {
            let dashes = self.old_zeta(mark, directions[0], [r, g, b, 200], String::new());
            self.log(mark.tick, entity::entry(name), &dashes);
        }
    }

    /// Turned far enough, and the task goes on with another segment: what was lost is free, and the hand may rotate about it.
    fn write_freed(
        &self,
        mark: &Named,
        swept: &mut Swept,
        first: Vec3,
        (segment, is_turning): (usize, bool),
        hand: &Placement,
    ) {
        let entry = entity::entry(mark.name);
        let Some(R_0) = swept.freed else {
            if first.dot(mark.zeta).abs() < 0.72 && !is_turning {
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
        let wanted = self.run.wanted_rotations.get(segment).copied().flatten();
        let of = wanted.map_or(String::new(), |by| format!(" of {:.0}°", by.abs()));
        let words = format!("free again: {about_deg:.0}°{of}");
        self.log(mark.tick, entry, &self.old_zeta(mark, first, FREE, words));
        if mark.is_inside {
            self.clear(mark.tick, entity::swept(mark.name));
        }
    }

    /// ζ as it was when the arm entered, dashed, with words at its upper end.
    fn old_zeta(&self, mark: &Named, zeta: Vec3, colour: Rgba, words: String) -> LineStrips3D {
        let (unit, centre) = (self.mark_size(), mark.centre);
        let end = 1.15 * unit * zeta;
        let dashes = dashed(centre - end, centre + end, 15, 0);
        let mut strips: Vec<Vec<[f32; 3]>> = dashes.iter().map(|dash| dash.to_vec()).collect();
        let mut labels = vec![String::new(); strips.len()];
        let up = if zeta.z < 0.0 { -zeta } else { zeta };
        let tip = centre + 1.2 * unit * up;
        strips.push(vec![tip.to_array(), (tip + 0.02 * unit * up).to_array()]);
        labels.push(words);
        let colours = vec![colour; strips.len()];
        lettered(strips, colours, labels, 0.004 * self.run.figure.reach)
    }

    /// Half the length of the mark of a singularity the arm is in; m.
    pub(super) fn mark_size(&self) -> f32 {
        0.2 * self.run.figure.reach
    }
}
