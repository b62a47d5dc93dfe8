//! The arm at one posture, as text for people.

use std::fmt;

use nalgebra::DMatrix;
use session::table::{Fitted, count, number, table};
use shared_types::codes;
use viz::digits;

use super::posture::Posture;

/// Tables of joints and singularities, matrices, singular values and remarks.
impl fmt::Display for Posture<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { robot, frame, .. } = self;
        writeln!(
            f,
            "{} at frame {frame}, base axes, SI units\n\n{}",
            robot.name,
            self.joints()
        )?;
        matrix(f, "pose X_BE", &self.pose)?;
        matrix(f, "J, rows [v; ω]", &self.J)?;
        matrix(f, "A, kg·m²", &self.A)?;
        self.measures(f)?;
        writeln!(f, "{}", self.singularity_table())?;
        writeln!(
            f,
            "κ₁: how far null-space motion moves the hand along ζ; κ₂: how far it turns ζ."
        )?;
        let mut notes = robot.notes.iter();
        notes.try_for_each(|note| writeln!(f, "note: {note}"))
    }
}

impl Posture<'_> {
    fn joints(&self) -> Fitted {
        let mut joints = table(&[
            "joint", "q rad, m", "q", "lower", "upper", "gravity", "bias", "limit",
        ]);
        for (i, joint) in self.robot.joints.iter().enumerate() {
            let [place, load] = joint.kind.units();
            let known = |x: f64, text: String| {
                if x.is_finite() {
                    text
                } else {
                    "–".to_owned()
                }
            };
            let at = |q: f64| known(q, format!("{:.2}{place}", joint.kind.shown(q)));
            // Rounding of a torque of zero.
            let under = |x: f64| known(x, format!("{} {load}", near_zero(x)));
            let q = self.q[i];
            let numbers = [
                format!("{q:.6}"),
                at(q),
                at(joint.lower),
                at(joint.upper),
                under(self.gravity[i]),
                under(self.bias[i]),
                under(joint.effort),
            ];
            let name = [joint.name.as_str().into()].into_iter();
            joints.add_row(name.chain(numbers.map(number)));
        }
        joints
    }

    /// Determinant, singular values, rank.
    fn measures(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = &self.report;
        let list = |values: &[f64]| {
            let values = values.iter().map(|value| near_zero(*value));
            values.collect::<Vec<_>>().join("  ")
        };
        let (rank, served) = (report.rank as usize, self.served);
        let lost = match served.saturating_sub(rank) {
            0 => String::new(),
            lost => format!(
                ": no joint moves the hand along {}",
                count(lost as u64, "direction")
            ),
        };
        if let Some(det) = self.det {
            writeln!(f, "det J            {}", near_zero(det))?;
        }
        writeln!(f, "singular values  {}", list(&self.singular_values))?;
        writeln!(
            f,
            "unit-scaled      {}  (lengths / {} m, {})",
            list(&self.scaled_singular_values[..served]),
            digits(report.length_m),
            self.centre()
        )?;
        writeln!(
            f,
            "condition {}, manipulability {}; rank {rank} of {served}{lost}\n",
            condition(self.condition()),
            near_zero(report.manipulability)
        )
    }

    /// The point of the hand whose Jacobian is unit-scaled.
    fn centre(&self) -> &'static str {
        let (C, X_BE) = (self.report.p_BC, &self.pose);
        let is_hand = (0..3).all(|axis| (C[axis] - X_BE[(axis, 3)]).abs() < ZERO);
        if is_hand {
            "at the hand"
        } else {
            "at the wrist centre"
        }
    }

    fn singularity_table(&self) -> Fitted {
        let mut rows = table(&[
            "singularity",
            "s",
            "η in/out",
            "inside",
            "type",
            "κ₁",
            "κ₂",
            "ζ (base axes)",
        ]);
        for (name, s) in self.singularities() {
            let (kind, at) = if s.angular != 0 { ("ω", 3) } else { ("v", 0) };
            let [x, y, z] = [0, 1, 2].map(|axis| unsigned(s.zeta_B[at + axis], 3));
            rows.add_row([
                name.into(),
                number(near_zero(s.s)),
                number(format!("{} / {}", s.eta_in, s.eta_out)),
                if s.inside != 0 { "inside" } else { "" }.into(),
                codes::name_of(codes::TYPES, s.class).into(),
                number(digits(s.kappa_1)),
                number(digits(s.kappa_2)),
                format!("{kind} [{x}, {y}, {z}]").into(),
            ]);
        }
        rows
    }
}

/// Numbers below it are rounding.
const ZERO: f64 = 1e-9;

fn near_zero(value: f64) -> String {
    digits(if value.abs() < ZERO { 0.0 } else { value })
}

fn condition(value: f64) -> String {
    if value > 1.0 / ZERO {
        "∞".to_owned()
    } else {
        digits(value)
    }
}

/// A number to so many decimals; 0 where they are all zeros.
fn unsigned(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|letter| b"-.0".contains(&letter));
    if is_zero { "0".to_owned() } else { text }
}

fn matrix(f: &mut fmt::Formatter<'_>, title: &str, matrix: &DMatrix<f64>) -> fmt::Result {
    writeln!(f, "{title}")?;
    for row in matrix.row_iter() {
        let values: Vec<_> = row
            .iter()
            .map(|value| format!("{:>10}", unsigned(*value, 5)))
            .collect();
        writeln!(f, "  {}", values.join(" "))?;
    }
    writeln!(f)
}
