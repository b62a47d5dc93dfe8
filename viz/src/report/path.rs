//! Lines of a drawing as SVG writes them, in whole units. PURE.

use std::fmt::Write;

use glam::Vec2;

/// The `d` of an SVG path.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Path(String);

impl Path {
    /// A polygon.
    pub(super) fn closed(points: &[[i32; 2]]) -> Self {
        let mut path = Self::open(points);
        path.0.push('z');
        path
    }

    /// A line through points.
    pub(super) fn line(points: impl IntoIterator<Item = Vec2>) -> Self {
        let whole: Vec<[i32; 2]> = points
            .into_iter()
            .map(|p| [p.x.round() as i32, p.y.round() as i32])
            .collect();
        Self::open(&whole)
    }

    /// A polygon through points.
    pub(super) fn polygon(points: impl IntoIterator<Item = Vec2>) -> Self {
        let mut path = Self::line(points);
        path.0.push('z');
        path
    }

    fn open(points: &[[i32; 2]]) -> Self {
        let mut text = String::new();
        let mut last = [0, 0];
        for (i, point) in points.iter().enumerate() {
            if i == 0 {
                let _ = write!(text, "M{} {}", point[0], point[1]);
            } else {
                text.push_str(if i == 1 { "l" } else { "" });
                for (axis, value) in [point[0] - last[0], point[1] - last[1]]
                    .into_iter()
                    .enumerate()
                {
                    // A minus parts numbers as well as a blank does.
                    let gap = if value < 0 || (i == 1 && axis == 0) {
                        ""
                    } else {
                        " "
                    };
                    let _ = write!(text, "{gap}{value}");
                }
            }
            last = *point;
        }
        Self(text)
    }

    /// Goes on with another line.
    pub(super) fn and(mut self, other: Self) -> Self {
        self.0.push_str(&other.0);
        self
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn text(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_relative_and_as_short_as_can_be() {
        let path = Path::line([
            Vec2::new(10.2, 20.0),
            Vec2::new(7.0, 21.0),
            Vec2::new(7.0, 11.0),
        ]);
        assert_eq!(path.text(), "M10 20l-3 1 0-10");
        assert_eq!(
            Path::polygon([Vec2::ZERO, Vec2::X * 5.0])
                .and(Path::line([Vec2::ONE]))
                .text(),
            "M0 0l5 0zM1 1"
        );
    }
}
