//! Targets as text, one line each: the format of `armplane servo --from FILE`, of live targets, and
//! of saved sessions.
//!
//! ```csv
//! # armplane targets 1, length m
//! # time_s, kind, frame, valid_s, values, side, given_s, force
//! 0.00, twist, base, 0.2, 0.005 0 0 0 0 0
//! 0.10, pose, base, 0.2, 0.5 0 0.7 0 1 0 0 0.05 0 0 0 0 0
//! 0.20, posture, joints, 0.2, 0 0.3 1.2 0 0.5 0, positive
//! 3.00, end
//! ```
//!
//! The first line of a file is its head. It gives the unit of lengths, `m` or `mm`, for the lines
//! after it; so does any further head. An unreadable head is refused, and with it all lines up to
//! the next readable head. Live lines have no times, and are in metres unless a head precedes them.
//! Times are in s, angles in rad, rotations are quaternions `w x y z`. A twist has six values,
//! `[linear; angular]`, in the axes of base, hand or singular; a pose has seven (position,
//! quaternion), and six more for the twist with which it moves; a posture has one per joint. `side`
//! (keep, negative, positive) and `given_s`, the time at which the target was measured where it is
//! not `time_s`, may be left out. So may `force`, the force with which the hand presses, in N: `hand 0
//! 0 10`, or in the axes of the base. A restarted operator gives `none` until it receives a target. A
//! frame may be a number, because another program may have sent it. `NaN` is read, and refused by
//! the controller.

use crate::MAX_DOF;
use crate::codes::{
    FRAME_BASE, FRAME_HAND, FRAMES, Named, SIDE_KEEP, SIDES, TARGET_END, TARGET_NONE, TARGET_POSE,
    TARGET_POSTURE, TARGET_TWIST, TARGET_UNREADABLE, TARGETS, name_of,
};
use crate::file::InvalidFile;
use crate::messages::TargetContent;
use crate::wire::Part;

/// The beginning of a head.
const HEAD: &str = "# armplane targets 1, length ";

/// Most targets in a file.
const MOST: usize = 1_000_000;

/// Largest error of a quaternion's squared norm.
pub const NORM: f64 = 1e-3;

/// Latest time in a file, s.
const LATEST_S: f64 = 36_000.0;

/// A target and the tick from which it is published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The tick.
    pub tick: u64,
    /// The target.
    pub target: TargetContent,
}

/// A line that is no target.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {message}")]
pub struct InvalidRow {
    /// The line, from 1.
    pub line: usize,
    /// The defect, and the remedy.
    pub message: String,
}

impl InvalidRow {
    /// As the defect of a file, at the line.
    #[must_use]
    pub fn in_file(self, file: &str, text: &str) -> InvalidFile {
        let before: usize = text
            .split_inclusive('\n')
            .take(self.line.saturating_sub(1))
            .map(str::len)
            .sum();
        let line = text
            .get(before..)
            .and_then(|rest| rest.lines().next())
            .map_or(0, str::len);
        InvalidFile {
            file: file.to_owned(),
            text: text.to_owned(),
            span: Some(before..before + line),
            message: self.message,
            remedy: String::new(),
        }
    }
}

/// The targets of a text, for a run of `rate_hz` ticks per second.
///
/// # Errors
/// [`InvalidRow`]: the first line that is no target, or is earlier than the one before.
pub fn parse(text: &str, rate_hz: u32) -> Result<Vec<Row>, InvalidRow> {
    Ok(numbered(text, rate_hz)?
        .into_iter()
        .map(|(_, row)| row)
        .collect())
}

/// Checks a text that somebody wrote for an arm of `dof` joints: beyond [`parse`], the slips of the pen that the controller would refuse in the run. A NaN
/// or the number of a frame is none: it stands for what another program may send.
///
/// # Errors
/// [`InvalidRow`]: the first line that cannot be followed.
pub fn check(text: &str, rate_hz: u32, dof: usize) -> Result<(), InvalidRow> {
    for (line, Row { target, .. }) in numbered(text, rate_hz)? {
        let norm = target.quaternion.iter().map(|x| x * x).sum::<f64>();
        let message = match target.kind {
            TARGET_POSTURE if target.joints as usize != dof => {
                format!(
                    "the posture has {} values, and the arm has {dof} joints",
                    target.joints
                )
            }
            TARGET_POSE
                if FRAMES.iter().any(|(code, _)| *code == target.frame)
                    && target.frame != FRAME_BASE =>
            {
                format!(
                    "a pose is in the frame base, not {}",
                    name_of(FRAMES, target.frame)
                )
            }
            TARGET_POSE if (norm - 1.0).abs() > NORM => {
                format!(
                    "the quaternion qw qx qy qz has the norm {:.3}: it must be 1",
                    norm.sqrt()
                )
            }
            _ => continue,
        };
        return Err(InvalidRow { line, message });
    }
    Ok(())
}

/// Whether a line is a head, be it one that cannot be read: what may be meant as a unit, in whatever quotes or marks of a comment, is no comment. No word
/// of a target has these letters.
#[must_use]
pub fn is_head(line: &str) -> bool {
    let line = line.to_ascii_lowercase();
    ["armplane", "length"]
        .iter()
        .any(|word| line.contains(word))
}

/// Units of length in a metre, by a head: divided by, so that 700 mm are the number nearest to 0.7 m.
fn per_metre(head: &str) -> Result<f64, String> {
    // Some editors begin a file with a mark of its encoding.
    let head = head.strip_prefix('\u{feff}').unwrap_or(head);
    match head.strip_prefix(HEAD).map(str::trim) {
        Some("m") => Ok(1.0),
        Some("mm") => Ok(1e3),
        _ => Err(format!(
            "a line with `armplane` or `length` gives the unit: write it as `{HEAD}m`, or `mm`"
        )),
    }
}

/// The lines of a text that are to be targets, each with its number and with the unit in force; and the heads that cannot be read.
fn lines(
    text: &str,
    mut unit: Result<f64, String>,
) -> impl Iterator<Item = (usize, Result<f64, String>, &str)> {
    let numbered = text.lines().map(str::trim).zip(1..);
    numbered.filter_map(move |(line, number)| {
        if is_head(line) {
            unit = per_metre(line);
        }
        let is_content = if is_head(line) {
            unit.is_err()
        } else {
            !(line.is_empty() || line.starts_with('#'))
        };
        is_content.then(|| (number, unit.clone(), line))
    })
}

/// The targets of a text without times, as they come while a session lasts, published from `tick` on. Of a line that is no target: the line and the defect.
pub fn live(
    text: &str,
    tick: u64,
    rate_hz: u32,
) -> impl Iterator<Item = Result<TargetContent, (&str, String)>> {
    lines(text, Ok(1.0)).map(move |(_, unit, line)| {
        unit.and_then(|unit| content(line, unit, tick, rate_hz))
            .map_err(|defect| (line, defect))
    })
}

/// The targets of a text, each with its line.
fn numbered(text: &str, rate_hz: u32) -> Result<Vec<(usize, Row)>, InvalidRow> {
    let invalid = |line: usize, message: String| InvalidRow { line, message };
    let mut rows: Vec<(usize, Row)> = Vec::new();
    for (number, unit, line) in lines(
        text,
        Err(format!("the first line must be `{HEAD}m`, or `mm`")),
    ) {
        let (time, rest) = line.split_once(',').unwrap_or((line, ""));
        let row = unit.and_then(|unit| {
            let tick = ticks(time, rate_hz)?;
            content(rest, unit, tick, rate_hz).map(|target| Row { tick, target })
        });
        let row = row.map_err(|message| invalid(number, message))?;
        if rows.last().is_some_and(|(_, last)| row.tick < last.tick) {
            return Err(invalid(
                number,
                format!(
                    "the target at {} s comes after a later one: sort the lines by time",
                    time.trim()
                ),
            ));
        }
        if rows.len() == MOST {
            return Err(invalid(
                number,
                format!(
                    "more than {MOST} targets: leave out lines, or steer from standard input (`--from -`)"
                ),
            ));
        }
        rows.push((number, row));
    }
    if rows.is_empty() {
        let message = "there is no target: add a line such as `0, twist, base, 1, 0.01 0 0 0 0 0`";
        return Err(invalid(1, message.to_owned()));
    }
    Ok(rows)
}

fn miscounted(kind: u32, count: usize) -> String {
    match kind {
        TARGET_TWIST => format!("a twist has 6 values, not {count}: vx vy vz wx wy wz"),
        TARGET_POSE => {
            format!("a pose has 7 values, or 13 with its twist, not {count}: x y z qw qx qy qz")
        }
        TARGET_POSTURE => format!("a posture has one value per joint, not {count}"),
        _ => format!(
            "a target of kind `{}` cannot be given",
            name_of(TARGETS, kind)
        ),
    }
}

/// The target of a line without its time, published from `tick` on; `per_metre` units of length are a metre.
fn content(line: &str, per_metre: f64, tick: u64, rate_hz: u32) -> Result<TargetContent, String> {
    let mut parts = line.split(',').map(str::trim);
    let mut next = || parts.next().filter(|part| !part.is_empty());
    let mut target = TargetContent {
        given_tick: tick,
        kind: code(next().unwrap_or_default(), TARGETS, "kind")?,
        ..Default::default()
    };
    match target.kind {
        TARGET_END => return Ok(target),
        TARGET_NONE => return Ok(TargetContent::default()),
        _ => {}
    }
    let frame = next().unwrap_or_default();
    target.frame = match frame.parse() {
        Ok(number) => number,
        Err(_) if target.kind == TARGET_POSTURE && frame == "joints" => FRAME_BASE,
        Err(_) => code(frame, FRAMES, "frame")?,
    };
    target.valid_s = number(next().unwrap_or_default(), "valid_s")?;
    let mut values = [0.0; 13];
    let mut count = 0;
    for text in next().unwrap_or_default().split_whitespace() {
        *values.get_mut(count).ok_or("more than 13 values")? = number(text, "a value")?;
        count += 1;
    }
    let linear =
        |at: usize| std::array::from_fn(|i| values[at + i] / if i < 3 { per_metre } else { 1.0 });
    match (target.kind, count) {
        (TARGET_TWIST, 6) => target.twist = linear(0),
        (TARGET_POSE, 7 | 13) => {
            target.position = std::array::from_fn(|i| values[i] / per_metre);
            target.quaternion = std::array::from_fn(|i| values[3 + i]);
            target.twist = linear(7);
        }
        (TARGET_POSTURE, 1..=MAX_DOF) => {
            target.q[..count].copy_from_slice(&values[..count]);
            target.joints = count as u32;
        }
        (kind, count) => return Err(miscounted(kind, count)),
    }
    target.side = next().map_or(Ok(SIDE_KEEP), |side| code(side, SIDES, "side"))?;
    target.given_tick = next().map_or(Ok(tick), |given| ticks(given, rate_hz))?;
    if let Some(text) = next() {
        (target.force_frame, target.force) = force(text)?;
    }
    Ok(if target.is_finite() {
        target
    } else {
        unreadable(target.given_tick)
    })
}

/// The frame of a force, and its components; N.
fn force(text: &str) -> Result<(u32, [f64; 3]), String> {
    let mut words = text.split_whitespace();
    let pressed_in = [(FRAME_BASE, "base"), (FRAME_HAND, "hand")];
    let frame = code(
        words.next().unwrap_or_default(),
        &pressed_in,
        "frame of a force",
    )?;
    let values = words.map(|word| number(word, "a force"));
    let values = values.collect::<Result<Vec<_>, _>>()?;
    let values = <[f64; 3]>::try_from(values);
    values
        .map(|force| (frame, force))
        .map_err(|values| format!("a force has 3 values after its frame, not {}", values.len()))
}

/// In place of a target with a NaN or an infinity, which no message may hold.
#[must_use]
pub fn unreadable(given_tick: u64) -> TargetContent {
    TargetContent {
        given_tick,
        kind: TARGET_UNREADABLE,
        ..Default::default()
    }
}

/// The text of targets; [`parse`] gives them again, bit for bit.
#[must_use]
pub fn write(rows: &[Row], rate_hz: u32) -> String {
    let seconds = |tick: u64| tick as f64 / f64::from(rate_hz);
    let mut text =
        format!("{HEAD}m\n# time_s, kind, frame, valid_s, values, side, given_s, force\n");
    for Row { tick, target } in rows {
        let line = match target.kind {
            TARGET_END | TARGET_NONE => {
                format!("{}, {}", seconds(*tick), name_of(TARGETS, target.kind))
            }
            _ => {
                let frame = FRAMES
                    .iter()
                    .find(|(code, _)| *code == target.frame)
                    .map_or(target.frame.to_string(), |(_, name)| (*name).to_owned());
                let values: Vec<f64> = match target.kind {
                    TARGET_POSE => target
                        .position
                        .into_iter()
                        .chain(target.quaternion)
                        .chain(target.twist)
                        .collect(),
                    TARGET_POSTURE => target.q[..(target.joints as usize).min(MAX_DOF)].to_vec(),
                    TARGET_TWIST => target.twist.to_vec(),
                    _ => vec![f64::NAN; 6],
                };
                let kind = if target.kind == TARGET_UNREADABLE {
                    TARGET_TWIST
                } else {
                    target.kind
                };
                let values: Vec<String> = values.iter().map(f64::to_string).collect();
                let kind = name_of(TARGETS, kind);
                let side = name_of(SIDES, target.side);
                let head = format!(
                    "{}, {kind}, {frame}, {}, {}",
                    seconds(*tick),
                    target.valid_s,
                    values.join(" ")
                );
                let given = seconds(target.given_tick);
                let [x, y, z] = target.force;
                if target.force == [0.0; 3] {
                    format!("{head}, {side}, {given}")
                } else {
                    let frame = name_of(FRAMES, target.force_frame);
                    format!("{head}, {side}, {given}, {frame} {x} {y} {z}")
                }
            }
        };
        text.push_str(&line);
        text.push('\n');
    }
    text
}

fn code(word: &str, table: &[Named], what: &str) -> Result<u32, String> {
    let known = || {
        table
            .iter()
            .map(|(_, name)| *name)
            .filter(|name| !["none", "unreadable"].contains(name))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let found = table
        .iter()
        .find(|(_, name)| *name == word)
        .map(|(code, _)| *code);
    found.ok_or_else(|| format!("there is no {what} `{word}`; there are {}", known()))
}

fn number(text: &str, what: &str) -> Result<f64, String> {
    text.parse()
        .map_err(|_| format!("`{text}` is not a number ({what})"))
}

fn ticks(text: &str, rate_hz: u32) -> Result<u64, String> {
    let time: f64 = number(text.trim(), "a time in s")?;
    if (0.0..=LATEST_S).contains(&time) {
        return Ok((time * f64::from(rate_hz)).round() as u64);
    }
    let time = text.trim();
    Err(format!(
        "the time {time} s is out of range: 0 to {LATEST_S}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_written_target_is_read_again_bit_for_bit() {
        let text = "# armplane targets 1, length mm\n\n0, twist, hand, 0.2, 5 0 0 0 0 0.1\n0.1, pose, base, 1, 500 0 700 0 1 0 0, keep, 0.05\n\
                    0.2,posture,joints,1, 0.1 0.2 0.3 0.4 0.5 0.6,positive\n0.25,twist,base,1,0 0 0 0 0 0,,,hand 0 0.5 10\n0.3,twist,7,1,0 0 0 0 0 0\n0.4,twist,base,1,NaN 0 0 0 0 0\n0.5,none\n1,end\n";
        let rows = parse(text, 1000).unwrap();
        let targets: Vec<_> = rows.iter().map(|row| row.target).collect();
        assert_eq!(
            (rows.len(), targets[0].twist[0], targets[1].position),
            (8, 0.005, [0.5, 0.0, 0.7])
        );
        let codes = (targets[1].given_tick, targets[4].frame, targets[5].kind);
        assert_eq!(codes, (50, 7, TARGET_UNREADABLE));
        let pressing = (targets[3].force_frame, targets[3].force);
        assert_eq!(pressing, (FRAME_HAND, [0.0, 0.5, 10.0]));
        let mut odd = rows.clone();
        odd[0].target.twist[1] = 0.1 + 0.2;
        assert_eq!(parse(&write(&odd, 1000), 1000).unwrap(), odd);
    }

    #[test]
    fn a_head_gives_the_unit_of_the_lines_after_it_with_times_and_without() {
        let line = "twist, base, 1, 5 0 0 0 0 0";
        let speeds = |text: &str| -> Vec<_> {
            let targets = live(text, 7, 1000);
            targets
                .map(|target| target.ok().map(|target| target.twist[0]))
                .collect()
        };
        let metres = format!("{HEAD}m");
        let unknown = format!("{HEAD}cm");
        assert_eq!(speeds(line), [Some(5.0)]);
        let text = format!("\u{feff}{HEAD}mm\n# a comment\n\n{line}\n{metres}\n{line}\n");
        assert_eq!(speeds(&text), [Some(0.005), Some(5.0)]);
        let quoted = format!("\"{HEAD}mm\"");
        for head in [
            &*unknown,
            &*quoted,
            "#armplane targets 1,length mm",
            "// armplane targets 1, length mm",
            "# length mm, armplane targets 1",
            "# Length: mm",
            "# armplane targets 1, length mm\rtwist, base, 1, 5 0 0 0 0 0\rend",
            "Armplane",
        ] {
            assert_eq!(speeds(head), [None], "{head}");
            assert_eq!(speeds(&format!("{head}\n{line}")), [None, None], "{head}");
            let wrong = parse(&format!("{metres}\n0, {line}\n{head}\n1, {line}\n"), 1000);
            assert_eq!(wrong.unwrap_err().line, 3, "{head}");
        }
        let text = format!("{metres}\n0, {line}\n{HEAD}mm\n1, {line}\n");
        let rows = parse(&text, 1000).unwrap();
        assert_eq!(rows[1].target.twist[0], 0.005);
    }

    #[test]
    fn a_line_that_is_no_target_is_named() {
        let cases = [
            ("0, twist, base, 1, 0 0 0 0 0", 2),
            ("0, twist, tool, 1, 0 0 0 0 0 0", 2),
            ("0, twst, base, 1, 0 0 0 0 0 0", 2),
            ("1, end\n0, end", 3),
            ("-1, end", 2),
            ("NaN, end", 2),
            ("0, twist, base, one, 0 0 0 0 0 0", 2),
            ("0, twist, base, 1, 0 0 0 0 0 0, keep, 0, hand 0 10", 2),
            ("0, twist, base, 1, 0 0 0 0 0 0, keep, 0, tool 0 0 10", 2),
            ("0, posture, joints, 1, 0 0 0 0 0 0 0 0 0 0 0 0 0 0", 2),
            ("", 1),
        ];
        for (lines, line) in cases {
            let error = parse(&format!("{HEAD}m\n{lines}\n"), 1000).unwrap_err();
            assert_eq!(error.line, line, "{error}");
        }
        assert_eq!(parse("time_s,vx\n", 1000).unwrap_err().line, 1);
    }

    #[test]
    fn a_line_that_this_arm_cannot_follow_is_named() {
        let cases = [
            ("0, posture, joints, 1, 0 0 0 0 0 0 0", false),
            ("0, pose, hand, 1, 0 0 0 1 0 0 0", false),
            ("0, pose, base, 1, 0 0 0 1 1 0 0", false),
            ("0, pose, base, 1, 0 0 0 1 0 0 0", true),
            ("0, pose, 7, 1, 0 0 0 1 0 0 0", true),
            ("0, twist, base, 1, NaN 0 0 0 0 0", true),
        ];
        for (line, is_right) in cases {
            let text = format!("{HEAD}m\n0, twist, hand, 1, 0 0 0 0 0 0\n{line}\n");
            let wrong = check(&text, 1000, 6).err().map(|error| error.line);
            assert_eq!(wrong, (!is_right).then_some(3), "{line}");
        }
    }
}
