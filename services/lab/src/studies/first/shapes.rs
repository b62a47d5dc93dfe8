//! The paths of a first scenario.

use control::quintic;

/// The shape of a path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shape {
    /// There and back.
    #[default]
    Line,
    /// At constant speed.
    Circle,
    /// Lines with rounded corners.
    Waypoints,
    /// A smooth curve through points.
    Spline,
    /// Poses with times, in a file.
    Table,
}

/// The time of a table, s, and its rows.
const TIME_S: f64 = 4.0;
const ROWS: u32 = 80;

impl Shape {
    /// All of them, as they are named.
    pub const ALL: [(&'static str, Self); 5] = [
        ("line", Self::Line),
        ("circle", Self::Circle),
        ("waypoints", Self::Waypoints),
        ("spline", Self::Spline),
        ("table", Self::Table),
    ];

    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Line => "The hand moves along a straight line, and back",
            Self::Circle => "The hand moves around a circle",
            Self::Waypoints => "The hand moves from point to point, with rounded corners",
            Self::Spline => "The hand moves along a smooth curve through points",
            Self::Table => "The hand moves through the poses of a table",
        }
    }

    /// The segments of a path of a size, m, along an axis of the base (0 is x), and the rows of its table, which is called as the scenario.
    pub(super) fn segments(self, name: &str, axis: usize, length: f64) -> (String, Option<String>) {
        let side = |along: f64, across: f64| {
            let mut point = [0.0; 3];
            (point[axis], point[(axis + 1) % 3]) = (along * length, across * length);
            format!("{point:?}")
        };
        let along = ["x", "y", "z"][axis];
        let points = [side(1.0, 0.0), side(1.0, 0.5), side(0.0, 0.0)].join(", ");
        let points = format!("points_m = [{points}], frame = \"start\"");
        // In whole millimetres: a person reads it.
        let blend = (200.0 * length.abs()).round() / 1e3;
        let text = match self {
            Self::Line => format!(
                "[[segment]]\nslide = {{ along = \"{along}\", by_m = {length} }}\nduration_s = 2.0\n\
                 # to_m = [0.4, 0.2, 0.3]                  # instead of `slide`: a place, base axes\n\
                 # turn = {{ about = \"z\", by_deg = 20 }}     # turns the hand meanwhile\n\n\
                 [[segment]]\nslide = {{ along = \"{along}\", by_m = {} }}\nduration_s = 2.0\n",
                -length
            ),
            Self::Circle => format!(
                "[[segment]]\narc = {{ centre_m = {}, about = \"{along}\", by_deg = 360, frame = \"start\" }}\nduration_s = 4.0\n\
                 ramp_s = 0.5                              # constant speed after it; left out: one smooth motion\n",
                side(0.0, 0.5)
            ),
            Self::Waypoints => format!(
                "[[segment]]\nwaypoints = {{ {points}, blend_m = {blend} }}\nduration_s = 4.0\n"
            ),
            Self::Spline => format!("[[segment]]\nspline = {{ {points} }}\nduration_s = 4.0\n"),
            Self::Table => format!(
                "[[segment]]\ntable = {{ file = \"{name}.csv\", frame = \"start\" }}     # t, x, y, z, qw, qx, qy, qz\n"
            ),
        };
        (text, (self == Self::Table).then(|| rows(axis, length)))
    }
}

/// A table of the way along an axis and back.
fn rows(axis: usize, length: f64) -> String {
    let mut text = "t, x, y, z, qw, qx, qy, qz\n".to_owned();
    for k in 0..=ROWS {
        let t = TIME_S * f64::from(k) / f64::from(ROWS);
        let [there, ..] = quintic(t.min(TIME_S - t), 0.5 * TIME_S);
        let mut p = [0.0; 3];
        p[axis] = there * length;
        let [x, y, z] = p;
        text += &format!("{t:.2}, {x:.6}, {y:.6}, {z:.6}, 1, 0, 0, 0\n");
    }
    text
}
