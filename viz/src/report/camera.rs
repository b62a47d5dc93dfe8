//! From the base's axes to the page: an eye far away, so that equal lengths are drawn equal. PURE.

use glam::{Vec2, Vec3};

use crate::blueprint::Eye;

/// A view along parallel lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Camera {
    right: Vec3,
    down: Vec3,
    /// Away from the eye.
    pub(super) forward: Vec3,
    /// Units of the drawing per metre.
    scale: f32,
    origin: Vec2,
}

impl Camera {
    /// Looks as the eye does, and shows `points` in a drawing of a width; units. The second number is the drawing's height.
    pub(super) fn framing(
        eye: &Eye,
        points: impl Iterator<Item = Vec3> + Clone,
        width: f32,
    ) -> (Self, f32) {
        let forward = (eye.look_at - eye.position).normalize_or(Vec3::Y);
        let right = forward.cross(eye.up).normalize_or(Vec3::X);
        let down = forward.cross(right);
        let mut camera = Self {
            right,
            down,
            forward,
            scale: 1.0,
            origin: Vec2::ZERO,
        };
        let (mut low, mut high) = (Vec2::splat(f32::INFINITY), Vec2::splat(f32::NEG_INFINITY));
        for point in points.filter(|point| point.is_finite()) {
            let at = camera.place(point);
            (low, high) = (low.min(at), high.max(at));
        }
        if !low.is_finite() || !high.is_finite() {
            (low, high) = (Vec2::splat(-0.5), Vec2::splat(0.5));
        }
        let margin = 0.03 * (high - low).max_element().max(1e-3);
        (low, high) = (low - margin, high + margin);
        // Not narrower than three quarters of its height: captions stand below it.
        let spare = (0.75 * (high.y - low.y) - (high.x - low.x)).max(0.0) / 2.0;
        (low.x, high.x) = (low.x - spare, high.x + spare);
        camera.scale = width / (high.x - low.x);
        camera.origin = low * camera.scale;
        (camera, (high.y - low.y) * camera.scale)
    }

    pub(super) fn place(&self, point: Vec3) -> Vec2 {
        Vec2::new(point.dot(self.right), point.dot(self.down)) * self.scale - self.origin
    }

    /// A length in units of the drawing.
    pub(super) fn units(&self, length_m: f32) -> f32 {
        length_m * self.scale
    }

    /// The distance from the eye, from anywhere.
    pub(super) fn depth(&self, point: Vec3) -> f32 {
        point.dot(self.forward)
    }
}
