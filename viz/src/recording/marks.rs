//! The strokes and captions of a picture, and of a steered arm what is asked for.

use glam::{Affine3, Mat3, Quat, Vec3};
use re_sdk_types::archetypes::{Clear, Mesh3D, Points3D};
use re_sdk_types::components::Radius;
use shared_types::codes::reason_text;

use super::Recording;
use super::draw::{array, arrows, lines};
use crate::entity;
use crate::narration::lost;
use crate::picture::{Picture, Sign};
use crate::pose::{Rgba, vec3};
use crate::run::Tick;
use crate::scene::turned_words;
use crate::signals::{Now, halves};
use crate::story::Named;
use crate::strokes::{Frame, strokes};

/// Time by which the arrows and the ghost of a steered arm are ahead, s: the horizon of the law's prediction.
const AHEAD_S: f32 = 0.5;
/// Colour of words about no singularity, to be read on dark and light; the target's, and the ghost's.
const QUIET: Rgba = 0x8898b0ff;
const ASKED: Rgba = 0xe8dc60ff;
const GHOST: Rgba = 0x86d4aac8;
/// Of the force on a surface.
const FORCE: Rgba = 0x3cc8e6ff;
/// Twist that is drawn; m/s, rad/s.
const LEAST: f32 = 1e-3;
/// Lines of a curve.
const PIECES: usize = 24;

/// Words at the origin.
fn label(text: &str, colour: Rgba) -> Points3D {
    Points3D::new([[0.0; 3]])
        .with_radii([Radius::new_ui_points(0.0)])
        .with_colors([colour])
        .with_labels([text])
        .with_show_labels(true)
}

impl Recording<'_> {
    /// The strokes of a picture, each written where it is another one, and its captions.
    pub(super) fn draw_marks(&mut self, row: &Tick, picture: &Picture) {
        let (tick, unit) = (row.tick, self.run.mark_size());
        let mut before = std::mem::take(&mut self.strokes);
        for stroke in strokes(self.run, &self.scene.story.named, picture, unit) {
            let name = &stroke.name;
            let path = match stroke.frame {
                Frame::Link(link) => format!("{}/{name}", entity::link(entity::LINK, link)),
                _ => format!("{}/{name}", entity::WORLD),
            };
            let key = format!("{:?} {}", stroke.strips, stroke.colour);
            let is_known = before.remove(&path).as_ref() == Some(&key);
            match stroke.radius {
                _ if is_known => (),
                Some(radius) => {
                    let lines = lines(stroke.strips, stroke.colour, radius);
                    self.sink.log(tick, &path, &lines);
                }
                None => {
                    let corners = array(stroke.strips.concat());
                    let triangles = (2..corners.len() as u32).map(|k| [0, k - 1, k]);
                    let area = Mesh3D::new(corners)
                        .with_triangle_indices(triangles)
                        .with_albedo_factor(stroke.colour);
                    self.sink.log(tick, &path, &area);
                }
            }
            self.strokes.insert(path, key);
        }
        for path in before.into_keys() {
            self.sink.log(tick, path, &Clear::flat());
        }
        self.draw_captions(row, picture);
    }

    /// Captions of each singularity, none while no report says where it is; and one below the hand.
    fn draw_captions(&mut self, row: &Tick, picture: &Picture) {
        let (tick, unit) = (row.tick, self.run.mark_size());
        for (i, named) in self.scene.story.named.clone().into_iter().enumerate() {
            let Named { name, colour, .. } = named;
            let mut captions = Default::default();
            if let Some(sign) = picture.signs.get(i) {
                let X_BS = sign.mark.X_BS;
                if sign.mark.is_seen {
                    self.place(format!("/world/singularity/{name}"), tick, X_BS);
                }
                let centre = Affine3::from_translation(X_BS.translation);
                self.place(format!("/world/zeta/{name}"), tick, centre);
                captions = self.captions(i, sign, picture);
            }
            let paths = [
                format!("{}{name}", entity::NAME),
                format!("{}{name}", entity::CAPTION),
                format!("{}{name}_turned", entity::CAPTION),
            ];
            for (path, (words, at)) in paths.into_iter().zip(captions) {
                self.caption(tick, path, words, colour, at);
            }
        }
        let words = match row.servo_state {
            Some(s) => reason_text(s.reason, s.joint, s.upper).to_string(),
            None => turned_words(&picture.turned),
        };
        let below = picture.hand.translation - self.run.up * (1.9 * unit);
        self.caption(tick, format!("{}now", entity::CAPTION), words, QUIET, below);
    }

    /// Words and their places: the name, and what is lost, at ζ's own end; what has become of the old one at its end. Several locks share a centre: the
    /// first speaks for all.
    fn captions(&self, i: usize, sign: &Sign, picture: &Picture) -> [(String, Vec3); 3] {
        let (mark, unit) = (sign.mark, self.run.mark_size());
        let inside: Vec<&str> = picture
            .signs
            .iter()
            .zip(&self.scene.story.named)
            .filter(|(sign, _)| sign.mark.is_inside)
            .map(|(_, named)| named.name.as_str())
            .collect();
        let name = &self.scene.story.named[i].name;
        let lost = match inside[..] {
            [first] if first == name => format!("{name}: cannot {}", lost(mark.is_angular)),
            [first, ..] if first == name => inside.join(", ") + ": locked",
            _ => String::new(),
        };
        let name = if mark.is_inside { name.as_str() } else { "" };
        let up = |way: Vec3| {
            way * if way.dot(self.run.up) < 0.0 {
                -1.0
            } else {
                1.0
            }
        };
        let end = mark.X_BS.translation + up(mark.zeta() * (1.15 * unit * mark.size));
        let entry = sign.swept.first().copied().unwrap_or_default() * (1.25 * unit);
        let below = mark.X_BS.translation - up(entry);
        [
            (name.to_owned(), end),
            (lost, end),
            (sign.note.clone(), below),
        ]
    }

    /// A caption at a place; empty words: none.
    fn caption(&mut self, tick: u64, path: String, words: String, colour: Rgba, at: Vec3) {
        if words.is_empty() {
            return self.hide(tick, &path);
        }
        self.place(path.clone(), tick, Affine3::from_translation(at));
        self.show(tick, path, words.clone(), || label(&words, colour));
    }

    /// Of a run that controls a force: the force of the hand on the surface, as long as two marks at its set-point.
    pub(super) fn draw_force(&mut self, row: &Tick, picture: &Picture) {
        if !self.run.job.scenario.presses() {
            return;
        }
        let unit = self.run.mark_size();
        let pressed = Now::new(row, self.run).pressed();
        let force = row.plant_state.zip(pressed).map(|(m, [newtons, _])| {
            let F = -Vec3::from(m.contact_force_n.map(|f| f as f32));
            F * (2.0 * unit / newtons as f32)
        });
        let arrow = force
            .filter(|F| F.length() > 0.05 * unit)
            .map(|F| [picture.hand.translation, F]);
        self.sink
            .log(row.tick, "/world/force", &arrows(arrow, FORCE, 0.06 * unit));
    }

    /// Of a steered run, the twist that its target asks for: an arrow as long as its way in half a second and an arc as wide as its turn; the line to the
    /// place that is asked for; and the hand of the reference arm half a second ahead, where nothing but its present twist moves it.
    pub(super) fn draw_target(&mut self, row: &Tick, picture: &Picture) {
        let Some(state) = row.servo_state else { return };
        let (unit, hand) = (self.run.mark_size(), picture.hand.translation);
        let [v, w] = vectors(&state.V_target);
        let motion = (v * AHEAD_S).clamp_length_min(0.2 * unit);
        let motion = (v.length() > LEAST).then_some([hand, motion]);
        let motion = arrows(motion, ASKED, 0.025 * unit);
        self.sink.log(row.tick, "/world/asked/motion", &motion);
        let mut strips: Vec<Vec<Vec3>> = Vec::new();
        if w.length() > LEAST {
            let start = w.normalize().any_orthonormal_vector() * (0.75 * unit);
            let at = |k: usize| hand + turned(w * (k as f32 / PIECES as f32)) * start;
            strips.push((0..=PIECES).map(at).collect());
        }
        let place = vec3(&state.p_target.into());
        if place.distance(hand) > 0.02 * unit && place != Vec3::ZERO {
            strips.push(vec![hand, place]);
        }
        let strips = lines(strips, ASKED, 0.018 * unit);
        self.sink.log(row.tick, "/world/asked/turn", &strips);
        let [v, w] = row
            .control_state
            .map(|command| vectors(&command.V_BE_d))
            .unwrap_or_default();
        let from = picture.desired.unwrap_or(picture.hand);
        let end = from.translation + v * AHEAD_S;
        let R = Mat3::from_quat(turned(w)) * from.matrix3;
        let moves = v.length() > LEAST || w.length() > LEAST;
        let axes = [R.x_axis, R.y_axis, R.z_axis].map(|axis| [end, axis * unit]);
        let axes = arrows(axes.into_iter().filter(|_| moves), GHOST, 0.015 * unit);
        self.sink.log(row.tick, "/world/ahead/hand", &axes);
        let way = moves.then_some([from.translation, end]);
        let way = lines(way, GHOST, 0.012 * unit);
        self.sink.log(row.tick, "/world/ahead/way", &way);
    }
}

/// The linear and the angular half of a twist.
fn vectors(V: &[f64; 6]) -> [Vec3; 2] {
    halves(V).map(|half| Vec3::from(half.map(|x| x as f32)))
}

/// The rotation of half a second at an angular velocity.
fn turned(w: Vec3) -> Quat {
    Quat::from_scaled_axis(w * AHEAD_S)
}
