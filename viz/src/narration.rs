//! The run in words and colours: what people read beside the picture. PURE.

use std::fmt::Write;

use shared_types::MAX_SINGULARITIES;
use shared_types::codes::*;
use shared_types::messages::SingularityState;

use crate::signals::TickRow;
use crate::solid::Rgba;

/// A singularity's colour: by kind, which for a PUMA is by type too (elbow 1, wrist 2, overhead mixed).
pub(crate) fn colour_of_kind(kind: u32, index: usize) -> Rgba {
    const NUMERIC: [u32; 4] = [TYPE_1, TYPE_2, TYPE_MIXED, TYPE_UNKNOWN];
    match kind {
        KIND_ELBOW => colour_of_type(TYPE_1),
        KIND_WRIST => colour_of_type(TYPE_2),
        KIND_OVERHEAD => colour_of_type(TYPE_MIXED),
        _ => colour_of_type(NUMERIC[index % NUMERIC.len()]),
    }
}

/// A type's colour: 1 orange, 2 magenta, mixed yellow.
pub(crate) fn colour_of_type(class: u32) -> Rgba {
    match class {
        TYPE_1 => [255, 128, 24, 255],
        TYPE_2 => [240, 70, 220, 255],
        TYPE_MIXED => [250, 214, 60, 255],
        _ => [150, 200, 215, 255],
    }
}

/// States with the colours of their lanes.
pub(crate) type States = &'static [(&'static str, u32)];

/// Lanes of modes: grey outside, warm inside.
pub(crate) const MODE_STATES: States = &[
    ("regular", 0x3d4753ff),
    ("blend", 0x8a7a3aff),
    ("track", 0x2f8f6bff),
    ("pass", 0x2f7fb5ff),
    ("hold", 0xb5542fff),
    ("reorient", 0xb03aa0ff),
    ("slide", 0xc23b3bff),
    ("recover", 0x6b5fb0ff),
];

/// Lanes of the drive.
pub(crate) const DRIVE_STATES: States =
    &[("active", 0x3f7f55ff), ("holding", 0xb59a2fff), ("stopping", 0xc2602fff), ("braked", 0xb03a3aff)];

/// Lanes of the task.
pub(crate) const PHASE_STATES: States = &[("running", 0x3a6fb0ff), ("settling", 0x5a8fa0ff), ("done", 0x3f7f55ff), ("refused", 0xb03a3aff)];

/// Lanes of the processes.
pub(crate) const LIFE_STATES: States = &[("up", 0x3d5f4bff), ("silent", 0xb03a3aff), ("restarted", 0xb59a2fff)];

/// The state that the words depend on: they are written again when it changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Situation {
    count: usize,
    singularities: [Singular; MAX_SINGULARITIES],
    phase: Option<u32>,
    segment: u32,
    clipped: bool,
    /// Of the drive, where no command has come.
    undriven: Option<u32>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Singular {
    kind: u32,
    class: u32,
    inside: bool,
    angular: bool,
    mode: u32,
}

impl Situation {
    pub(crate) fn of(row: &TickRow) -> Self {
        let mut situation = Self { count: row.singularities().len(), ..Self::default() };
        for (i, one) in row.singularities().iter().enumerate() {
            let mode = row.control_state.map_or(MODE_REGULAR, |command| command.mode[i]);
            situation.singularities[i] =
                Singular { kind: one.kind, class: one.class, inside: one.inside == 1, angular: one.angular == 1, mode };
        }
        if let Some(state) = row.control_state {
            situation.segment = state.segment;
            situation.clipped = state.clipped == 1;
        }
        if let Some(torque) = row.torque {
            situation.phase = Some(torque.phase);
        } else {
            situation.undriven = Some(row.sensor.map_or(DRIVE_ACTIVE, |sensor| sensor.drive));
        }
        situation
    }

    /// Markdown: the singularity that the arm is in, the motion that is lost there, and the arm's response.
    pub(crate) fn markdown(&self) -> String {
        let mut text = String::new();
        if let Some(drive) = self.undriven {
            let _ = writeln!(
                text,
                "## No command reaches the arm\n\nA process is silent (see its lane), so no new torque comes. The last one holds for a few ticks; \
                 then the drives stop the arm by themselves, brake, and go on when fresh torque comes. Now they are **{}**.\n",
                name_of(DRIVES, drive)
            );
            return text;
        }
        let inside: Vec<(usize, &Singular)> = self.singularities[..self.count].iter().enumerate().filter(|(_, one)| one.inside).collect();
        if inside.is_empty() {
            text.push_str("## Regular: the hand can move in every direction\n\n");
            let near = self.singularities[..self.count].iter().enumerate().find(|(_, one)| one.mode != MODE_REGULAR);
            if let Some((i, one)) = near {
                let _ = writeln!(
                    text,
                    "Near the **{}** singularity, *{}*: {}.\n",
                    singularity_name(one.kind, i),
                    name_of(MODES, one.mode),
                    doing(one.mode, one.angular)
                );
            }
            text.push_str("A *singularity* is a posture where the hand loses a direction ζ: no joint speed moves it that way, and plain control would demand endless joint speed. It is near where a line s_i(q) comes to 0.\n");
        }
        for (i, one) in inside {
            let name = singularity_name(one.kind, i);
            let verb = if one.angular { "turn about" } else { "move along" };
            let glyph = if one.angular { "arc" } else { "double arrow" };
            let _ = writeln!(text, "## Inside the {} singularity ({})\n", name, name_of(TYPES, one.class));
            let _ = writeln!(
                text,
                "{}: **the hand cannot {verb} ζ**, the {} {glyph}.{}\n",
                reason(one.kind),
                colour_name(one.class),
                remedy(one.class)
            );
            let _ = writeln!(text, "Now **{}**: {}.\n", name_of(MODES, one.mode), doing(one.mode, one.angular));
        }
        if self.clipped {
            text.push_str("The goal is beyond reach: the hand slides along the boundary.\n\n");
        }
        if self.phase == Some(PHASE_REFUSED) {
            text.push_str("**The controller refused to go on** and brings the arm to rest.\n\n");
        }
        text.push_str(
            "\n*Blue: the speeds the hand can reach; net: the accelerations a force gives it (Λ⁻¹): both flat along a lost direction. \
             Rings: |s_i| = η_i. Green: desired; white: actual. Pale arms: null-space motion.*\n",
        );
        text
    }
}

/// The label at the mark, as short as can be.
pub(crate) fn label(one: &SingularityState, index: usize) -> String {
    let verb = if one.angular == 1 { "cannot turn about ζ" } else { "cannot move along ζ" };
    format!("{} ({}): {verb}", singularity_name(one.kind, index), name_of(TYPES, one.class))
}

fn reason(kind: u32) -> &'static str {
    match kind {
        KIND_ELBOW => "The arm is stretched or folded",
        KIND_WRIST => "Axes 4 and 6 are parallel",
        KIND_OVERHEAD => "The wrist is above the waist's axis",
        _ => "The joints' motions no longer span all directions",
    }
}

fn remedy(class: u32) -> &'static str {
    match class {
        TYPE_1 => " Type 1: null-space motion of the joints moves the hand along ζ, the second-order way out.",
        TYPE_2 => " Type 2: null-space motion of the joints turns ζ itself, until the wanted motion is free.",
        TYPE_MIXED => " Mixed type: null-space motion both turns ζ and moves the hand along it.",
        _ => "",
    }
}

fn doing(mode: u32, angular: bool) -> &'static str {
    match (mode, angular) {
        (MODE_REGULAR, _) => "plain operational-space control",
        (MODE_BLEND, _) => "control along ζ passes smoothly between hand and null space",
        (MODE_TRACK, _) => "null-space motion follows the part of the path along ζ",
        (MODE_PASS, _) => "passing through with ζ held away from the direction of travel",
        (MODE_HOLD, _) => "ζ is held; the hand moves orthogonal to it only",
        (MODE_REORIENT, true) => "null-space motion turns ζ while the hand stays",
        (MODE_REORIENT, false) => "null-space motion swings ζ while the hand stays",
        (MODE_SLIDE, _) => "the goal is beyond reach; the hand slides along the boundary",
        (MODE_RECOVER, _) => "outside again, the rest of the auxiliary error is removed",
        _ => "in a mode this recording does not know",
    }
}

fn colour_name(class: u32) -> &'static str {
    match class {
        TYPE_1 => "orange",
        TYPE_2 => "magenta",
        TYPE_MIXED => "yellow",
        _ => "blue-grey",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::TorqueCommand;
    use shared_types::messages::{ControlState, SensorSample, SingularityReport};
    use shared_types::topics::ByTopic;

    #[test]
    fn words_name_the_singularity_and_what_is_lost() {
        let mut report = SingularityReport { count: 2, ..SingularityReport::default() };
        report.singularities[0] = SingularityState { kind: KIND_ELBOW, class: TYPE_1, ..SingularityState::default() };
        report.singularities[1] =
            SingularityState { kind: KIND_WRIST, class: TYPE_2, inside: 1, angular: 1, ..SingularityState::default() };
        let (mut command, torque) = <(ControlState, TorqueCommand)>::default();
        command.mode[1] = MODE_REORIENT;
        let row = TickRow::new(
            0,
            ByTopic { singularity: Some(&report), control_state: Some(&command), torque: Some(&torque), ..ByTopic::default() },
        );
        let words = Situation::of(&row).markdown();
        for expected in ["wrist singularity (type 2)", "cannot turn about ζ", "magenta arc", "**reorient**"] {
            assert!(words.contains(expected), "{expected:?} is not in {words}");
        }
        assert!(!words.contains("elbow"), "the arm is not in the elbow singularity");
        assert_eq!(Situation::of(&row), Situation::of(&row));
    }

    #[test]
    fn without_a_command_the_words_say_what_the_drive_does() {
        let report = SingularityReport { count: 1, ..SingularityReport::default() };
        let sensor = SensorSample { drive: DRIVE_BRAKED, ..SensorSample::default() };
        let words =
            Situation::of(&TickRow::new(0, ByTopic { singularity: Some(&report), sensor: Some(&sensor), ..ByTopic::default() })).markdown();
        assert!(words.contains("No command reaches the arm") && words.contains("**braked**") && !words.contains("plain"), "{words}");
    }

    #[test]
    fn every_code_has_a_lane_colour() {
        let lanes = |table: &[Named], states: States| table.iter().all(|(_, name)| states.iter().any(|(state, _)| state == name));
        assert!(lanes(MODES, MODE_STATES) && lanes(DRIVES, DRIVE_STATES) && lanes(PHASES, PHASE_STATES));
    }
}
