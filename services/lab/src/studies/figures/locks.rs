//! Chang & Khatib 1995, Figure 3. The three locks of a PUMA side by side.

use nalgebra::Vector3;
use serde_json::{Map, Value, json};
use shared_types::codes::{
    KIND_ELBOW, KIND_WRIST, TYPE_1, TYPE_2, TYPE_UNKNOWN, TYPES, name_of, singularity_name,
};
use viz::plot::{Axis, BLUE, Color, GREY, Page, Panel, Row, digits};
use viz::singularity_ink;

use super::figure::Figure;
use super::trace::{Sample, Trace};

/// Half the length of ζ in the picture; m.
const ZETA: f64 = 0.28;
/// Places of the shoulder and of the wrist's centre among the points of the arm.
const SHOULDER: usize = 2;
const WRIST: usize = 5;

/// An oblique view: from the side of the plane in which the arm reaches out, a little above.
struct View {
    right: Vector3<f64>,
    up: Vector3<f64>,
}

impl View {
    fn of(sample: &Sample) -> Self {
        let hand = sample.arm.last().copied().unwrap_or_else(Vector3::x);
        let heading = hand.y.atan2(hand.x) - 1.05;
        let (elevation, sin, cos) = (0.4f64, heading.sin(), heading.cos());
        let up = Vector3::new(
            -cos * elevation.sin(),
            -sin * elevation.sin(),
            elevation.cos(),
        );
        Self {
            right: Vector3::new(-sin, cos, 0.0),
            up,
        }
    }

    fn place(&self, p: &Vector3<f64>) -> (f64, f64) {
        (p.dot(&self.right), p.dot(&self.up))
    }
}

/// Each lock with its ζ, the reason for it, and the hand's lost motion.
pub(super) fn three_locks(locks: [(u32, &Trace); 3]) -> Figure {
    let mut numbers = Map::new();
    let mut notes = Vec::new();
    let panels = locks.map(|(kind, trace)| {
        let place = trace.place_of(kind);
        let name = singularity_name(kind, place);
        let is_turn = kind == KIND_WRIST;
        let mut panel =
            Panel::new(&format!("{name} lock: cannot {} ζ", if is_turn { "turn about" } else { "move along" }), hidden(), hidden());
        panel.equal = true;
        let Some(sample) = trace.most_singular(place) else { return panel };
        let (zeta, class) = (sample.zeta[place], name_of(TYPES, sample.class.get(place).copied().unwrap_or(TYPE_UNKNOWN)));
        draw(&mut panel, sample, kind, &zeta, singularity_ink(kind));
        let why = match kind {
            KIND_ELBOW => "shoulder, elbow and wrist are in one line, and ζ is that line",
            KIND_WRIST => "axes 4 and 6 are one line, and ζ is at right angles to it and to axis 5",
            _ => "the wrist is as near to the waist's axis as it can come, and ζ is normal to the arm's plane",
        };
        notes.push(format!("{name} ({class}): {why}; |s| = {} at {:.2} s of its run.", digits(sample.s[place].abs()), sample.t));
        let paper = name_of(TYPES, if kind == KIND_ELBOW { TYPE_1 } else { TYPE_2 });
        if class != paper {
            notes.push(format!(
                "The paper counts the {name} lock as {paper}. Here the type is computed: the shoulder's offset keeps the wrist's centre out of a cylinder around \
                 the waist's axis, so the centre can move along ζ on one side. Without the offset (`puma560-ideal`) the lock is {paper}, too."
            ));
        }
        numbers.insert(name.to_owned(), json!({"s": sample.s[place], "t_s": sample.t, "zeta": [zeta.x, zeta.y, zeta.z], "type": class, "type_in_the_paper": paper}));
        panel
    });
    Figure {
        name: "fig3",
        page: Page {
            title: "Figure 3: the singularities of a PUMA 560, and the direction ζ that each takes".to_owned(),
            subtitle: "postures of three runs where the arm is most singular; dashed: the lines that fall together".to_owned(),
            rows: vec![Row::of(330.0, panels)],
            notes,
            width: 980.0,
        },
        numbers: Value::Object(numbers),
    }
}

fn hidden() -> Axis {
    Axis {
        hidden: true,
        ..Axis::default()
    }
}

fn draw(panel: &mut Panel, sample: &Sample, kind: u32, zeta: &Vector3<f64>, color: Color) {
    let view = View::of(sample);
    let line = |from: Vector3<f64>, to: Vector3<f64>| [view.place(&from), view.place(&to)];
    let centre = sample.arm.get(WRIST).copied().unwrap_or(sample.p);
    // The floor's axes, for the eye; they are not to scale with anything.
    for axis in [Vector3::x(), Vector3::y()] {
        let pale = Color { 3: 0.5, ..GREY };
        panel.dashed("", pale, &line(-0.25 * axis, 0.25 * axis));
    }
    let shoulder = sample.arm.get(SHOULDER).copied().unwrap_or_default();
    let (lost, axis) = (centre - shoulder, sample.axis(2));
    let (name, from, to) = match kind {
        KIND_ELBOW => ("shoulder, elbow, wrist", shoulder, shoulder + 1.3 * lost),
        KIND_WRIST => ("axes 4 and 6", centre - 0.3 * axis, centre + 0.35 * axis),
        _ => {
            let top = Vector3::z() * (centre.z + 0.25);
            ("waist's axis", Vector3::zeros(), top)
        }
    };
    panel.dashed(name, color, &line(from, to));
    let arm: Vec<_> = sample.arm.iter().map(|p| view.place(p)).collect();
    panel.arm(BLUE, 0.9, &arm);
    panel.line(
        "ζ",
        color,
        &line(centre - ZETA * zeta, centre + ZETA * zeta),
    );
    if kind == KIND_WRIST {
        // Three quarters of a turn about ζ.
        let side = zeta
            .cross(&sample.axis(2))
            .try_normalize(1e-9)
            .unwrap_or_else(Vector3::x);
        let other = zeta.cross(&side);
        let arc = (0..=36).map(|k| (0.05 + 0.75 * f64::from(k) / 36.0) * std::f64::consts::TAU);
        let arc: Vec<_> = arc
            .map(|turn| {
                view.place(&(centre + 0.6 * ZETA * (side * turn.cos() + other * turn.sin())))
            })
            .collect();
        let heads = [[arc[2], arc[0]], [arc[34], arc[36]]];
        panel.line("", color, &arc);
        heads
            .iter()
            .for_each(|[from, tip]| head(panel, *from, *tip, color));
    } else {
        for side in [-1.0, 1.0] {
            let [from, tip] = line(centre, centre + side * ZETA * zeta);
            head(panel, from, tip, color);
        }
    }
}

/// The barbs of an arrow.
fn head(panel: &mut Panel, from: (f64, f64), tip: (f64, f64), color: Color) {
    let (dx, dy) = (tip.0 - from.0, tip.1 - from.1);
    let long = dx.hypot(dy).max(1e-9);
    let (dx, dy) = (0.05 * dx / long, 0.05 * dy / long);
    panel.line(
        "",
        color,
        &[
            (tip.0 - dx + 0.6 * dy, tip.1 - dy - 0.6 * dx),
            tip,
            (tip.0 - dx - 0.6 * dy, tip.1 - dy + 0.6 * dx),
        ],
    );
}
