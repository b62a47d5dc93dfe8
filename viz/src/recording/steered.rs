//! A steered arm: the twist that its target asks for, the motion of the next half second, and why it is no faster.

use glam::{Quat, Vec3};

use super::Recording;
use super::shapes::{arrows, lines};
use crate::arm::vec3;
use crate::signals::{TickRow, halves};
use crate::solid::{Placement, Rgba};

/// Time by which the arrows and the ghost are ahead, s: the horizon of the law's prediction.
const AHEAD_S: f32 = 0.5;
/// The target's colour, and the ghost's.
const ASKED: Rgba = 0xfff078ff;
const GHOST: Rgba = 0x96ebbec8;
/// Twist that is drawn; m/s, rad/s.
const LEAST: f32 = 1e-3;
/// Lines of a curve.
const PIECES: usize = 16;

impl Recording<'_> {
    /// The marks of a steered run; nothing in any other.
    pub(super) fn write_target(
        &mut self,
        row: &TickRow,
        hand: &Placement,
        desired: Option<&Placement>,
    ) {
        let Some(state) = row.servo_state else { return };
        let unit = self.run.mark_size();
        self.write_asked(
            row.tick,
            &state.V_target,
            vec3(&state.p_target.into()),
            hand.p,
            unit,
        );
        let V = row.control_state.map_or([0.0; 6], |command| command.V_BE_d);
        self.write_ahead(row.tick, &V, desired.unwrap_or(hand), unit);
    }

    /// The twist asked for: an arrow as long as its way in half a second and an arc as wide as its turn; and the line to the place that is asked for.
    fn write_asked(&self, tick: u64, V: &[f64; 6], place: Vec3, hand: Vec3, unit: f32) {
        let [v, w] = vectors(V);
        let motion = (v.length() > LEAST).then(|| (v * AHEAD_S).clamp_length_min(0.2 * unit));
        let motion = arrows(hand, motion, ASKED, 0.025 * unit);
        self.sink.log(tick, "/world/asked/motion", &motion);
        let mut strips: Vec<Vec<Vec3>> = Vec::new();
        if w.length() > LEAST {
            let start = w.normalize().any_orthonormal_vector() * (0.75 * unit);
            let at = |k: usize| hand + turned(w * (k as f32 / PIECES as f32)) * start;
            strips.push((0..=PIECES).map(at).collect());
        }
        if place.distance(hand) > 0.02 * unit && place != Vec3::ZERO {
            strips.push(vec![hand, place]);
        }
        self.sink.log(
            tick,
            "/world/asked/turn",
            &lines(strips, ASKED, 0.018 * unit),
        );
    }

    /// The hand of the reference arm half a second ahead, where nothing but its present twist moves it, and its way there.
    fn write_ahead(&self, tick: u64, V: &[f64; 6], from: &Placement, unit: f32) {
        let [v, w] = vectors(V);
        let is_still = v.length() < LEAST && w.length() < LEAST;
        let (end, R) = (
            from.p + v * AHEAD_S,
            glam::Mat3::from_quat(turned(w)) * from.R,
        );
        let axes = [R.x_axis, R.y_axis, R.z_axis].map(|axis| axis * unit);
        let (axes, way) = match is_still {
            true => (&[][..], None),
            false => (&axes[..], Some([from.p, end])),
        };
        let axes = arrows(end, axes.iter().copied(), GHOST, 0.015 * unit);
        self.sink.log(tick, "/world/ahead/hand", &axes);
        self.sink
            .log(tick, "/world/ahead/way", &lines(way, GHOST, 0.012 * unit));
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
