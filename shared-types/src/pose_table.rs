//! A path as a table of poses with times, a line each.
//!
//! ```csv
//! t, x, y, z, qw, qx, qy, qz
//! 0.00, 0.450, 0.100, 0.300, 0, 1, 0, 0
//! 0.01, 0.451, 0.100, 0.300, 0, 1, 0, 0
//! ```
//!
//! Times are in s, positions in m. The first line may name the columns, which then may come in any order; without it the order is
//! the one above. Fields are separated by commas, semicolons or tabs. Lines that begin with `#` are comments. A quaternion and its
//! negative mean the same rotation.

pub use crate::target_file::InvalidRow;

/// The columns, in their default order.
const COLUMNS: [&str; 8] = ["t", "x", "y", "z", "qw", "qx", "qy", "qz"];
/// Most rows.
const MOST: usize = 1_000_000;
/// Largest error of a quaternion's norm: what four decimals leave.
const NORM: f64 = 1e-3;
/// Speeds that no hand has, m/s and rad/s.
const FASTEST: [f64; 2] = [20.0, 100.0];
/// A step between two rows is a jump where it is so many times as fast as those before and after it, and faster than this; m/s and rad/s.
const JUMP: f64 = 10.0;
const SUDDEN: [f64; 2] = [0.5, 1.5];
/// Way of a step that rounded decimals may be, m and rad: 1 mm in each of three, at any rate of rows.
const ROUNDING: [f64; 2] = [1.8e-3, 1.8e-3];

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Its line, from 1.
    pub line: usize,
    /// s.
    pub t_s: f64,
    /// m.
    pub p_m: [f64; 3],
    /// `[w, x, y, z]`, of norm 1, on the side of the row before.
    pub quaternion: [f64; 4],
}

fn invalid<T>(line: usize, message: String) -> Result<T, InvalidRow> {
    Err(InvalidRow { line, message })
}

/// The poses of a text.
///
/// # Errors
/// [`InvalidRow`]: the first line that has no pose, that does not come after the one before, or to which the hand would have to jump.
pub fn parse(text: &str) -> Result<Vec<Row>, InvalidRow> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let lines = text.lines().map(str::trim).zip(1..);
    let mut lines = lines
        .filter(|(line, _)| !line.is_empty() && !line.starts_with('#'))
        .peekable();
    let mut order = std::array::from_fn(|i| i);
    if let Some((head, line)) = lines.next_if(|(line, _)| is_head(line)) {
        order = columns(head).or_else(|message| invalid(line, message))?;
    }
    let mut rows: Vec<Row> = Vec::new();
    for (text, line) in lines {
        let mut row = row(text, line, &order).or_else(|message| invalid(line, message))?;
        if let Some(last) = rows.last() {
            if row.t_s <= last.t_s {
                let word = if row.t_s == last.t_s {
                    "repeats"
                } else {
                    "goes back to"
                };
                let t_s = row.t_s;
                return invalid(
                    line,
                    format!(
                        "the row {word} the time {t_s} s: give each pose a later time than the one before"
                    ),
                );
            }
            if dot(&row.quaternion, &last.quaternion) < 0.0 {
                row.quaternion = row.quaternion.map(|x| -x);
            }
        }
        if rows.len() == MOST {
            return invalid(
                line,
                format!(
                    "more than {MOST} rows: leave out rows, a smooth curve leads through the rest"
                ),
            );
        }
        rows.push(row);
    }
    if rows.len() < 2 {
        return invalid(
            1,
            format!("a path has at least two rows: {}", COLUMNS.join(", ")),
        );
    }
    steady(&rows)?;
    Ok(rows)
}

fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split([',', ';', '\t'])
        .map(|field| field.trim().trim_matches('"'))
}

/// Whether a line names the columns.
fn is_head(line: &str) -> bool {
    fields(line)
        .next()
        .is_some_and(|first| first.parse::<f64>().is_err())
}

/// The place in the line of every column.
fn columns(head: &str) -> Result<[usize; 8], String> {
    let names: Vec<String> = fields(head)
        .map(|name| {
            let name = name.to_ascii_lowercase();
            let name = name
                .strip_suffix("_s")
                .or_else(|| name.strip_suffix("_m"))
                .unwrap_or(&name);
            if name == "time" { "t" } else { name }.to_owned()
        })
        .collect();
    let mut order = [0; 8];
    for (place, column) in order.iter_mut().zip(COLUMNS) {
        let mut found = names.iter().enumerate().filter(|(_, name)| *name == column);
        *place = match (found.next(), found.next()) {
            (Some((place, _)), None) => place,
            _ => {
                return Err(format!(
                    "the first line must name each column once: {}",
                    COLUMNS.join(", ")
                ));
            }
        };
    }
    match names.len() {
        8 => Ok(order),
        count => Err(format!(
            "the first line names {count} columns, not 8: {}",
            COLUMNS.join(", ")
        )),
    }
}

fn row(text: &str, line: usize, order: &[usize; 8]) -> Result<Row, String> {
    let mut values = [0.0; 8];
    let mut count = 0;
    for field in fields(text) {
        let value: f64 = field
            .parse()
            .map_err(|_| format!("`{field}` is not a number: write 0.25, with a point"))?;
        if !value.is_finite() {
            return Err(format!(
                "`{field}` is not a finite number: leave the row out"
            ));
        }
        if let Some(place) = values.get_mut(count) {
            *place = value;
        }
        count += 1;
    }
    if count != 8 {
        return Err(format!(
            "the row has {count} values, not 8: {}",
            COLUMNS.join(", ")
        ));
    }
    let value = |column: usize| values[order[column]];
    let (p_m, q): ([f64; 3], [f64; 4]) = (
        std::array::from_fn(|i| value(1 + i)),
        std::array::from_fn(|i| value(4 + i)),
    );
    let norm = dot(&q, &q).sqrt();
    if (norm - 1.0).abs() > NORM {
        return Err(format!(
            "the quaternion has the norm {norm:.4}, so it is no rotation: give qw, qx, qy, qz with the norm 1"
        ));
    }
    if p_m.iter().any(|x| x.abs() > 1000.0) {
        return Err("the position is farther than 1000 m: give metres, not millimetres".to_owned());
    }
    Ok(Row {
        line,
        t_s: value(0),
        p_m,
        quaternion: q.map(|x| x / norm),
    })
}

fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Whether no step is a jump.
fn steady(rows: &[Row]) -> Result<(), InvalidRow> {
    let norm = |d: &mut dyn Iterator<Item = f64>| d.map(|x| x * x).sum::<f64>().sqrt();
    let speeds: Vec<[f64; 2]> = rows
        .windows(2)
        .map(|pair| {
            let a = &pair[0];
            let b = &pair[1];
            let moved = norm(&mut (0..3).map(|i| b.p_m[i] - a.p_m[i]));
            // Twice the chord of quaternions is the angle, for small ones.
            let turned = 2.0 * norm(&mut (0..4).map(|i| b.quaternion[i] - a.quaternion[i]));
            let beyond = |way: f64, rounding: f64| (way - rounding).max(0.0) / (b.t_s - a.t_s);
            [beyond(moved, ROUNDING[0]), beyond(turned, ROUNDING[1])]
        })
        .collect();
    let units = [("m/s", "moves"), ("rad/s", "turns")];
    for i in 0..speeds.len() {
        for half in 0..2 {
            let at = |i: Option<usize>| {
                i.and_then(|i| speeds.get(i))
                    .map_or(0.0, |speed| speed[half])
            };
            let (here, (unit, verb)) = (speeds[i][half], units[half]);
            // A single pose off the way makes two quick steps.
            let beside = at(i.checked_sub(1)).max(at(Some(i + 1)).min(at(Some(i + 2))));
            if here > FASTEST[half] || speeds.len() > 2 && here > SUDDEN[half].max(JUMP * beside) {
                let Row { line, t_s, .. } = rows[i + 1];
                return invalid(
                    line,
                    format!(
                        "the hand {verb} with {here:.1} {unit} to the pose at {t_s} s: that is a jump; correct the row, or give it more time"
                    ),
                );
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line_of(text: &str) -> usize {
        parse(text).unwrap_err().line
    }

    #[test]
    fn a_row_that_is_no_pose_is_refused_with_its_line() {
        let rows: Vec<String> = (0..9)
            .map(|i| {
                format!(
                    "{}, {}, 0, 0.5, 1, 0, 0, 0",
                    0.1 * f64::from(i),
                    0.02 * f64::from(i)
                )
            })
            .collect();
        let with = |line: &str| {
            let mut rows = rows.clone();
            line.clone_into(&mut rows[4]);
            format!("# a comment\n{}\n", rows.join("\n"))
        };
        assert_eq!(parse(&with(&rows[4])).unwrap().len(), 9);
        for wrong in [
            "0.4, 0.08, 0, 0.5, 1, 0, 0",
            "0.4, 0.08, 0, 0.5, 1, 0, 0, 0, 0",
            "0.3, 0.08, 0, 0.5, 1, 0, 0, 0",
            "0.2, 0.08, 0, 0.5, 1, 0, 0, 0",
            "0.4, nan, 0, 0.5, 1, 0, 0, 0",
            "0.4, inf, 0, 0.5, 1, 0, 0, 0",
            "0.4, 0.08, 0, 0.5, 1, 1, 0, 0",
            "0.4, 0.08, 0, 0.5, 0, 0, 0, 0",
            "0.4, 80, 0, 0.5, 1, 0, 0, 0",
            "0.4, 8000, 0, 0.5, 1, 0, 0, 0",
            "0.4, 0.08, 0, 0.5, 0, 1, 0, 0",
            "0.4, a, 0, 0.5, 1, 0, 0, 0",
        ] {
            assert_eq!(line_of(&with(wrong)), 6, "{wrong}");
        }
        // Three decimals at 1 kHz.
        let rounded = |i: u32| {
            let x = 2.6e-4 * f64::from(i);
            format!(
                "{:.3}, {x:.3}, {x:.3}, {x:.3}, 1, 0, 0, 0\n",
                1e-3 * f64::from(i)
            )
        };
        let rounded: String = (0..99).map(rounded).collect();
        assert_eq!(parse(&rounded).unwrap().len(), 99);
        assert_eq!(line_of("t,x,y,z,qx,qy,qz\n"), 1);
        assert_eq!(line_of("t,x,y,z,qx,qy,qz,qz\n"), 1);
        assert_eq!(line_of("0, 0, 0, 0, 1, 0, 0, 0\n"), 1);
    }

    #[test]
    fn named_columns_come_in_any_order_and_signs_of_quaternions_are_harmless() {
        let text =
            "\u{feff}time_s;x_m;y_m;z_m;qx;qy;qz;qw\n0;1;2;3;0;0;0.6;0.8\n1;1;2;3;0;0;-0.6;-0.8\n";
        let rows = parse(text).unwrap();
        assert_eq!(rows[0].quaternion, [0.8, 0.0, 0.0, 0.6]);
        assert_eq!(rows[0].quaternion, rows[1].quaternion);
        assert_eq!((rows[1].p_m, rows[1].line), ([1.0, 2.0, 3.0], 3));
    }
}
