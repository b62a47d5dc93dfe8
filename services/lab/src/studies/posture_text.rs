//! The arm at one posture, as text for people.

use std::fmt;

use model::{Joint, Robot};
use nalgebra::DMatrix;
use session::table::{Fitted, count};
use shared_types::codes;
use shared_types::messages::SingularityState;
use viz::digits;

use super::posture::Posture;
use crate::text::{Columns, optional};

/// Tables of joints and singularities, matrices, singular values and remarks.
pub struct PostureText<'a> {
    /// The evaluated posture.
    pub posture: &'a Posture,
    /// The arm.
    pub robot: &'a Robot,
}

impl fmt::Display for PostureText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { posture, robot } = self;
        writeln!(
            f,
            "{} at frame {}, base axes, SI units\n\n{}",
            robot.name,
            posture.frame,
            self.joints()
        )?;
        let pose = DMatrix::from_fn(4, 4, |row, column| posture.pose[row][column]);
        matrix(f, "pose X_BE", &pose)?;
        matrix(f, "J, rows [v; ω]", &posture.J)?;
        matrix(f, "A, kg·m²", &posture.A)?;
        self.measures(f)?;
        writeln!(f, "{}", self.singularities())?;
        writeln!(
            f,
            "κ₁: how far null-space motion moves the hand along ζ; κ₂: how far it turns ζ."
        )?;
        let mut notes = robot.notes.iter();
        notes.try_for_each(|note| writeln!(f, "note: {note}"))
    }
}

impl PostureText<'_> {
    fn joints(&self) -> Fitted {
        type Row<'a> = (usize, &'a Joint);
        let Posture {
            q, gravity, bias, ..
        } = self.posture;
        let finite = |x: f64, text: String| optional(x.is_finite().then_some(text), |text| text);
        let place = |joint: &Joint, q: f64| {
            finite(
                q,
                format!("{:.2}{}", joint.kind.shown(q), joint.kind.units()[0]),
            )
        };
        let load =
            |joint: &Joint, x: f64| finite(x, format!("{} {}", digits(x), joint.kind.units()[1]));
        Columns::<Row<'_>>::new()
            .text("joint", |(_, joint)| joint.name.clone())
            .number("q rad, m", |(i, _)| format!("{:.6}", q[*i]))
            .number("q", |(i, joint)| place(joint, q[*i]))
            .number("lower", |(_, joint)| place(joint, joint.lower))
            .number("upper", |(_, joint)| place(joint, joint.upper))
            .number("gravity", |(i, joint)| load(joint, gravity[*i]))
            .number("bias", |(i, joint)| load(joint, bias[*i]))
            .number("limit", |(_, joint)| load(joint, joint.effort))
            .print(self.robot.joints.iter().enumerate())
    }

    /// Determinant, singular values, rank.
    fn measures(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (posture, report) = (self.posture, &self.posture.report);
        let list = |values: &[f64]| {
            let values = values.iter().map(|value| digits(*value));
            values.collect::<Vec<_>>().join("  ")
        };
        let (rank, axes) = (report.rank as usize, posture.singular_values.len());
        let lost = match axes.saturating_sub(rank) {
            0 => String::new(),
            lost => format!(
                ": no joint moves the hand along {}",
                count(lost as u64, "direction")
            ),
        };
        if let Some(det) = posture.det {
            writeln!(f, "det J            {}", digits(det))?;
        }
        writeln!(f, "singular values  {}", list(&posture.singular_values))?;
        writeln!(
            f,
            "unit-scaled      {}  (lengths / {} m, at the wrist centre)",
            list(&posture.scaled_singular_values),
            digits(report.length_m)
        )?;
        writeln!(
            f,
            "condition {}, manipulability {}; rank {rank} of {axes}{lost}\n",
            digits(posture.condition()),
            digits(report.manipulability)
        )
    }

    fn singularities(&self) -> Fitted {
        type Row<'a> = (&'a str, &'a SingularityState);
        let zeta = |s: &SingularityState| {
            let (kind, at) = if s.angular != 0 { ("ω", 3) } else { ("v", 0) };
            let z = &s.zeta_B[at..];
            let [x, y, z] = [z[0], z[1], z[2]].map(|value| unsigned(value, 3));
            format!("{kind} [{x}, {y}, {z}]")
        };
        Columns::<Row<'_>>::new()
            .text("singularity", |(name, _)| *name)
            .number("s", |(_, s)| digits(s.s))
            .number("η in/out", |(_, s)| {
                format!("{} / {}", s.eta_in, s.eta_out)
            })
            .text("inside", |(_, s)| if s.inside != 0 { "inside" } else { "" })
            .text("type", |(_, s)| codes::name_of(codes::TYPES, s.class))
            .number("κ₁", |(_, s)| digits(s.kappa_1))
            .number("κ₂", |(_, s)| digits(s.kappa_2))
            .text("ζ (base axes)", |(_, s)| zeta(s))
            .print(self.posture.singularities())
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
