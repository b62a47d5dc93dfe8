//! A steered arm: the twist that its target asks for, the motion of the next half second, and why it is no faster.

use glam::{Mat3, Vec3};
use re_sdk_types::archetypes::{Arrows3D, LineStrips3D, Points3D};
use re_sdk_types::components::Radius;
use shared_types::ServoState;
use shared_types::codes::reason_text;

use super::pieces::rgba;
use super::state::Recording;
use crate::arm::vec3;
use crate::entity;
use crate::signals::TickRow;
use crate::solid::{Placement, Rgba};
use crate::tint::of_words;

/// Time by which the arrows and the ghost are ahead, s: the horizon of the law's prediction.
const AHEAD_S: f32 = 0.5;
/// The target's colour, and the ghost's.
const ASKED: Rgba = [255, 240, 120, 255];
const GHOST: Rgba = [150, 235, 190, 200];
/// Twist that is drawn; m/s, rad/s.
const LEAST: f32 = 1e-3;
/// How far below the hand its words are, in half lengths of a mark.
const BELOW: f32 = 1.5;
/// Cosine of the angle by which the hand may turn before they are put below it again.
const STILL_BELOW: f32 = 0.94;
/// Lines of a curve.
const PIECES: usize = 16;

impl Recording {
    /// The marks of a steered run; nothing in any other.
    pub(super) fn write_target(
        &mut self,
        row: &TickRow,
        hand: &Placement,
        desired: Option<&Placement>,
    ) {
        let Some(state) = row.servo_state else { return };
        let unit = self.mark_size();
        self.write_asked(row.tick, state, hand, unit);
        let V = row.control_state.map_or([0.0; 6], |command| command.V_BE_d);
        self.write_ahead(row.tick, &V, desired.unwrap_or(hand), unit);
        let words = (state.reason, state.joint, state.upper);
        // Below the hand in base axes, in which it stays where the hand only moves: the labels of marks are beside it or above.
        let below = hand.R.transpose() * Vec3::NEG_Z;
        let stands = |(before, at): &((u32, u32, u32), Vec3)| {
            *before == words && at.dot(below) > STILL_BELOW
        };
        if !self.part.reason.as_ref().is_some_and(stands) {
            self.part.reason = Some((words, below));
            let point = Points3D::new([(below * BELOW * unit).to_array()]);
            let point = point
                .with_radii([Radius::new_ui_points(0.5)])
                .with_colors([rgba(of_words(ASKED))]);
            self.log(
                row.tick,
                entity::REASON,
                &point
                    .with_labels([reason_text(words.0, words.1, words.2)])
                    .with_show_labels(true),
            );
        }
    }

    /// The twist asked for: an arrow as long as its way in half a second and an arc as wide as its turn; and the line to the place that is asked for.
    fn write_asked(&mut self, tick: u64, state: &ServoState, hand: &Placement, unit: f32) {
        let [v, w] = halves(&state.V_target);
        let arrows = if v.length() > LEAST {
            vec![(v * AHEAD_S).clamp_length_min(0.2 * unit)]
        } else {
            Vec::new()
        };
        let origins = vec![hand.p.to_array(); arrows.len()];
        let arrows =
            Arrows3D::from_vectors(arrows.iter().map(Vec3::to_array)).with_origins(origins);
        self.log(
            tick,
            entity::ASKED,
            &arrows.with_colors([rgba(ASKED)]).with_radii([0.025 * unit]),
        );
        let mut strips: Vec<Vec<[f32; 3]>> = Vec::new();
        if w.length() > LEAST {
            let axis = w.normalize();
            let start = axis.any_orthonormal_vector() * (0.75 * unit);
            let angle = w.length() * AHEAD_S;
            strips.push(
                (0..=PIECES)
                    .map(|k| {
                        (hand.p + turned(axis, angle * k as f32 / PIECES as f32) * start).to_array()
                    })
                    .collect(),
            );
        }
        let place = vec3(&state.p_target.into());
        if place.distance(hand.p) > 0.02 * unit && place != Vec3::ZERO {
            strips.push(vec![hand.p.to_array(), place.to_array()]);
        }
        self.log(
            tick,
            entity::ASKED_TURN,
            &LineStrips3D::new(strips)
                .with_colors([rgba(ASKED)])
                .with_radii([0.018 * unit]),
        );
    }

    /// The hand of the reference arm half a second ahead, where nothing but its present twist moves it, and its way there.
    fn write_ahead(&mut self, tick: u64, V: &[f64; 6], from: &Placement, unit: f32) {
        let [v, w] = halves(V);
        if v.length() < LEAST && w.length() < LEAST {
            self.log(
                tick,
                entity::AHEAD,
                &Arrows3D::from_vectors(Vec::<[f32; 3]>::new()),
            );
            self.log(
                tick,
                entity::AHEAD_WAY,
                &LineStrips3D::new(Vec::<Vec<[f32; 3]>>::new()),
            );
            return;
        }
        let end = from.p + v * AHEAD_S;
        let R = turned(w.normalize_or(Vec3::Z), w.length() * AHEAD_S) * from.R;
        let axes = [R.x_axis, R.y_axis, R.z_axis].map(|axis| (axis * unit).to_array());
        let arrows = Arrows3D::from_vectors(axes).with_origins([end.to_array(); 3]);
        self.log(
            tick,
            entity::AHEAD,
            &arrows.with_colors([rgba(GHOST)]).with_radii([0.015 * unit]),
        );
        let way = LineStrips3D::new([[from.p.to_array(), end.to_array()]]);
        self.log(
            tick,
            entity::AHEAD_WAY,
            &way.with_colors([rgba(GHOST)]).with_radii([0.012 * unit]),
        );
    }
}

/// The linear and the angular half of a twist.
fn halves([a, b, c, d, e, f]: &[f64; 6]) -> [Vec3; 2] {
    [
        Vec3::new(*a as f32, *b as f32, *c as f32),
        Vec3::new(*d as f32, *e as f32, *f as f32),
    ]
}

fn turned(axis: Vec3, angle: f32) -> Mat3 {
    Mat3::from_axis_angle(axis, angle)
}
