//! The arm at one posture, as text for people.

use std::fmt;

use model::Robot;
use nalgebra::DMatrix;
use session::table::{number, table};
use shared_types::codes;
use viz::plot::digits;

use super::posture::Posture;

/// Tables of joints and singularities, matrices, singular values and remarks.
pub struct PostureText<'a> {
    /// The evaluated posture.
    pub posture: &'a Posture,
    /// The arm.
    pub robot: &'a Robot,
}

impl fmt::Display for PostureText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} at frame {}, base axes, SI units\n",
            self.robot.name, self.posture.frame
        )?;
        let mut joints = table(&[
            "joint", "q rad, m", "q", "lower", "upper", "gravity", "bias", "limit",
        ]);
        for (i, joint) in self.robot.joints.iter().enumerate() {
            let [unit, load_unit] = joint.kind.units();
            let finite =
                |x: f64, text: String| number(if x.is_finite() { text } else { "–".into() });
            let place = |q: f64| finite(q, format!("{:.2}{unit}", joint.kind.shown(q)));
            let load = |x: f64| finite(x, format!("{} {load_unit}", digits(x)));
            joints.add_row([
                joint.name.clone().into(),
                number(format!("{:.6}", self.posture.q[i])),
                place(self.posture.q[i]),
                place(joint.lower),
                place(joint.upper),
                load(self.posture.gravity[i]),
                load(self.posture.bias[i]),
                load(joint.effort),
            ]);
        }
        writeln!(f, "{joints}")?;
        matrix(
            f,
            "pose X_BE",
            &DMatrix::from_fn(4, 4, |row, column| self.posture.pose[row][column]),
        )?;
        matrix(f, "J, rows [v; ω]", &self.posture.J)?;
        matrix(f, "A, kg·m²", &self.posture.A)?;
        let list = |values: &[f64]| {
            values
                .iter()
                .map(|value| digits(*value))
                .collect::<Vec<_>>()
                .join("  ")
        };
        if let Some(det) = self.posture.det {
            writeln!(f, "det J            {}", digits(det))?;
        }
        writeln!(
            f,
            "singular values  {}",
            list(&self.posture.singular_values)
        )?;
        writeln!(
            f,
            "unit-scaled      {}  (lengths / {} m, at the wrist centre)",
            list(&self.posture.scaled_singular_values),
            self.posture.report.length_m
        )?;
        writeln!(
            f,
            "rank {}, condition {}, manipulability {}\n",
            self.posture.report.rank,
            digits(self.posture.condition()),
            digits(self.posture.report.manipulability)
        )?;
        let mut found = table(&[
            "singularity",
            "s",
            "η in/out",
            "inside",
            "type",
            "κ₁",
            "κ₂",
            "ζ (base axes)",
        ]);
        for (name, s) in self.posture.singularities() {
            let half = if s.angular != 0 {
                &s.zeta_B[3..]
            } else {
                &s.zeta_B[..3]
            };
            let kind = if s.angular != 0 { "ω" } else { "v" };
            found.add_row([
                name.into(),
                number(digits(s.s)),
                number(format!("{} / {}", s.eta_in, s.eta_out)),
                if s.inside != 0 {
                    "inside".into()
                } else {
                    "".into()
                },
                codes::name_of(codes::TYPES, s.class).into(),
                number(digits(s.kappa_1)),
                number(digits(s.kappa_2)),
                format!("{kind} [{:.3}, {:.3}, {:.3}]", half[0], half[1], half[2]).into(),
            ]);
        }
        writeln!(f, "{found}")?;
        for note in &self.robot.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}

fn matrix(f: &mut fmt::Formatter<'_>, title: &str, matrix: &DMatrix<f64>) -> fmt::Result {
    writeln!(f, "{title}")?;
    for row in matrix.row_iter() {
        writeln!(
            f,
            "  {}",
            row.iter()
                .map(|value| format!("{value:>10.5}"))
                .collect::<Vec<_>>()
                .join(" ")
        )?;
    }
    writeln!(f)
}
