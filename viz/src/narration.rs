//! The run in words and colours: what people read beside the picture. PURE.

use nalgebra::Vector3;
use shared_types::MAX_SINGULARITIES;
use shared_types::codes::*;
use shared_types::messages::SingularityState;

use crate::signals::TickRow;
use crate::solid::Rgba;

/// A colour and its name.
type Tint = (&'static str, Rgba);
const ORANGE: Tint = ("orange", 0xff8018ff);
const MAGENTA: Tint = ("magenta", 0xf046dcff);
const YELLOW: Tint = ("yellow", 0xfad63cff);
/// Of those that are found by number.
const OTHERS: [Tint; 4] = [
    ("violet", 0xb48cffff),
    ("turquoise", 0x40c8b4ff),
    ("salmon", 0xff8a80ff),
    ("blue", 0x78beebff),
];

/// A singularity's colour, the same in marks, plots and words: by kind, for one found by number by its place.
fn named_colour(kind: u32, index: usize) -> Tint {
    match kind {
        KIND_ELBOW => ORANGE,
        KIND_WRIST => MAGENTA,
        KIND_OVERHEAD | KIND_SHOULDER => YELLOW,
        _ => OTHERS[index % OTHERS.len()],
    }
}

/// The colour alone.
pub(crate) fn colour_of(kind: u32, index: usize) -> Rgba {
    named_colour(kind, index).1
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
pub(crate) const DRIVE_STATES: States = &[
    ("active", 0x3f7f55ff),
    ("holding", 0xb59a2fff),
    ("stopping", 0xc2602fff),
    ("braked", 0xb03a3aff),
];

/// Lanes of the task.
pub(crate) const PHASE_STATES: States = &[
    ("running", 0x3a6fb0ff),
    ("settling", 0x5a8fa0ff),
    ("done", 0x3f7f55ff),
    ("refused", 0xb03a3aff),
];

/// Lanes of the processes.
pub(crate) const LIFE_STATES: States = &[
    ("up", 0x3d5f4bff),
    ("silent", 0xb0602fff),
    ("waiting", 0x5a626cff),
    ("restarted", 0xb59a2fff),
];

/// Colours of the lane of faults: of one in force, and of none.
pub(crate) const FAULT_COLOUR: u32 = 0xc03030ff;
pub(crate) const NO_FAULT: (&str, u32) = ("none", 0x2a3038ff);

/// A stay in the neighbourhood of a singularity: its first tick, the tick after its last, and the response that took most of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stay {
    first: u64,
    end: u64,
    mode: u32,
}

/// The events of a run so far: the words of a moment depend on it.
#[derive(Clone, Debug, Default)]
pub(crate) struct History {
    /// Present stays: first tick, and the ticks spent in each mode.
    present: [Option<(u64, [u32; MODES.len()])>; MAX_SINGULARITIES],
    /// The latest stay in each singularity, once it is over.
    past: [Option<Stay>; MAX_SINGULARITIES],
    /// The largest distance of the hand from its place; m. Of tasks in which it should stand still only.
    off_m: Option<f64>,
}

/// The response at a singularity.
fn mode(row: &TickRow, i: usize) -> u32 {
    row.control_state
        .map_or(MODE_REGULAR, |state| state.mode[i])
}

impl History {
    /// Of a run whose hand should stand still, or of another.
    pub(crate) fn new(stands_still: bool) -> Self {
        Self {
            off_m: stands_still.then_some(0.0),
            ..Self::default()
        }
    }

    /// Takes a tick in.
    pub(crate) fn push(&mut self, row: &TickRow) {
        for (i, one) in row.singularities().iter().enumerate() {
            if one.inside == 1 {
                let (_, modes) = self.present[i].get_or_insert((row.tick, [0; MODES.len()]));
                if let Some(ticks) = modes.get_mut(mode(row, i) as usize) {
                    *ticks += 1;
                }
            } else if let Some((first, modes)) = self.present[i].take() {
                let most = (0..).zip(modes).max_by_key(|(_, ticks)| *ticks);
                let mode = most.map_or(MODE_REGULAR, |(mode, _)| mode);
                let end = row.tick;
                self.past[i] = Some(Stay { first, end, mode });
            }
        }
        if let (Some(off_m), Some(state), Some(desired)) =
            (&mut self.off_m, row.plant_state, row.control_state)
        {
            let off = Vector3::from(state.p_BE) - Vector3::from(desired.p_BE_d);
            *off_m = off_m.max(off.norm());
        }
    }

    /// How far the hand has been off a place where it should stand still; mm, to two digits.
    fn off_mm(&self) -> Option<f64> {
        let off_um = self.off_m? * 1e6;
        let digit = 10f64.powf(off_um.max(1.0).log10().floor() - 1.0).max(1.0);
        Some((off_um / digit).round() * digit * 1e-3)
    }
}

/// A moment of a run, and the properties of the run that its words depend on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment<'a, 'm> {
    pub(crate) row: &'a TickRow<'m>,
    pub(crate) history: &'a History,
    /// The scenario's title.
    pub(crate) title: &'a str,
    pub(crate) joints: usize,
    pub(crate) rate_hz: u32,
    /// Directions of the task.
    pub(crate) directions: usize,
    /// The fault in force, in a few words.
    pub(crate) fault: Option<&'a str>,
}

impl Moment<'_, '_> {
    /// Markdown, a headline and at most three lines: the singularity that the arm is in, the motion that is lost there, the arm's response.
    pub(crate) fn markdown(&self) -> String {
        let mut text = String::new();
        if self.tell_fault(&mut text) {
            return text;
        }
        let locks = self.inside().count();
        if locks > 0 {
            self.tell_locks(&mut text, locks);
        } else {
            self.tell_free(&mut text);
        }
        let command = self.row.control_state;
        if let Some(state) = self.row.servo_state {
            let reason = reason_text(state.reason, state.joint, state.upper);
            text += &format!("Steered: **{reason}**.  \n");
        } else if command.is_some_and(|state| state.clipped == 1) {
            text += "The goal is out of reach: the hand slides along the boundary.  \n";
        }
        let torque = self.row.torque;
        if torque.is_some_and(|torque| torque.phase == PHASE_REFUSED) {
            text += "**The controller refused to go on** and brings the arm to rest.  \n";
        }
        text
    }

    /// Singularities that the arm is inside of.
    fn inside(&self) -> impl Iterator<Item = (usize, &SingularityState)> {
        let all = self.row.singularities().iter().enumerate();
        all.filter(|(_, one)| one.inside == 1)
    }

    /// The fault in force, or that no torque comes; whether there is nothing more to say.
    fn tell_fault(&self, text: &mut String) -> bool {
        let drive = self.row.sensor.map_or(DRIVE_ACTIVE, |sensor| sensor.drive);
        let does = match drive {
            _ if self.row.torque.is_some() => "the arm goes on",
            DRIVE_HOLDING | DRIVE_ACTIVE => "the drives hold the last torque",
            DRIVE_STOPPING => "the drives bring the arm to rest",
            _ => "the drives have braked the arm",
        };
        let is_undriven = self.row.torque.is_none();
        if is_undriven || self.fault.is_some() {
            let fault = self.fault.unwrap_or("No torque comes");
            *text += &format!("**{fault}: {does}**  \n");
        }
        if is_undriven {
            *text += "The drives do this by themselves until fresh torque comes. In the lanes of the processes, those that wait for another one are grey.\n";
        }
        is_undriven
    }

    /// No singularity is in the way: those that the arm has been in, the last of them at the end.
    fn tell_free(&self, text: &mut String) {
        let title = self.title;
        if let Some(off_mm) = self.history.off_mm() {
            *text += &format!(
                "**{title}**  \nThe hand should stand still. It has been **{off_mm} mm** off its place at most. Amber: its way, \
                 50 times as large.  \n",
            );
            return;
        }
        let mut all = self.row.singularities().iter().enumerate();
        *text += &match all.find(|(i, _)| mode(self.row, *i) != MODE_REGULAR) {
            Some((i, one)) => {
                let doing = doing(mode(self.row, i));
                format!(
                    "**Near the {} singularity: {doing}**  \n",
                    singularity_name(one.kind, i)
                )
            }
            None => "**Free: the hand can move in every direction**  \n".to_owned(),
        };
        let all = self.row.singularities().iter().zip(&self.history.past);
        let past = all.enumerate();
        let past = past.filter_map(|(i, (one, stay))| Some((i, one, (*stay)?)));
        let mut past: Vec<_> = past.collect();
        past.sort_by_key(|(_, _, stay)| stay.first);
        let rate_hz = f64::from(self.rate_hz.max(1));
        for (i, one, stay) in &past[past.len().saturating_sub(2)..] {
            let [first, end] = [stay.first, stay.end].map(|tick| tick as f64 / rate_hz);
            let doing = doing(stay.mode);
            *text += &format!(
                "{}, {first:.2} to {end:.2} s: {doing}.  \n",
                coloured(*i, one)
            );
        }
    }

    /// The singularities that the arm is in.
    fn tell_locks(&self, text: &mut String, locks: usize) {
        let all = self.directions;
        let rank = format!("rank {} of {all}", all.saturating_sub(locks));
        *text += &match self.inside().next() {
            Some((i, one)) if locks == 1 => {
                // One that was found by number has no name but that.
                let name = match one.kind {
                    KIND_NUMERIC => "Singular".to_owned(),
                    kind => capital(singularity_name(kind, i)) + " lock",
                };
                let lost = lost(one.angular == 1);
                format!("**{name}: the hand cannot {lost}** · {rank}  \n")
            }
            _ => format!("**{locks} directions are lost** · {rank}  \n"),
        };
        for (i, one) in self.inside() {
            let (class, why) = (name_of(TYPES, one.class), reason(one.kind, self.joints));
            let (name, doing) = (coloured(i, one), doing(mode(self.row, i)));
            *text += &format!("{name}, {class}: {why}; {doing}.  \n");
        }
    }
}

/// The name of a singularity with its colour.
fn coloured(i: usize, one: &SingularityState) -> String {
    let (name, (colour, _)) = (singularity_name(one.kind, i), named_colour(one.kind, i));
    format!("**{name}** ({colour})")
}

/// With a capital letter.
pub(crate) fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

/// The motion that the hand has lost.
pub(crate) fn lost(angular: bool) -> &'static str {
    if angular {
        "turn about ζ"
    } else {
        "move along ζ"
    }
}

fn reason(kind: u32, joints: usize) -> &'static str {
    match (kind, joints) {
        (KIND_ELBOW, _) => "upper arm and forearm in line",
        (KIND_WRIST, 7) => "axes 5 and 7 parallel",
        (KIND_WRIST, _) => "axes 4 and 6 parallel",
        (KIND_OVERHEAD, _) => "wrist on the waist's axis",
        (KIND_SHOULDER, _) => "axes 1 and 3 parallel",
        _ => "joint motions that cancel",
    }
}

/// The arm's response in a mode.
pub(crate) fn doing(mode: u32) -> &'static str {
    match mode {
        MODE_REGULAR => "plain operational-space control",
        MODE_BLEND => "blends hand and null-space control",
        MODE_TRACK => "follows the path by null-space motion",
        MODE_PASS => "passes through, ζ held off the path",
        MODE_HOLD => "holds ζ, moves orthogonal to it",
        MODE_REORIENT => "joints turn ζ, the hand stays",
        MODE_SLIDE => "out of reach: slides on the boundary",
        MODE_RECOVER => "removes the null-space error",
        _ => "in a mode this recording does not know",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::messages::{ControlState, PlantState, SingularityReport};
    use shared_types::topics::ByTopic;

    /// A stay is told with its times and its longest response, and how far a hand was off that should stand still.
    #[test]
    fn the_past_is_known() {
        let (mut report, mut command) = <(SingularityReport, ControlState)>::default();
        let (mut state, mut history) = (PlantState::default(), History::new(true));
        report.count = 1;
        for tick in 0..30 {
            let is_inside = (10..25).contains(&tick);
            report.singularities[0].inside = u32::from(is_inside);
            command.mode[0] = if tick < 22 { MODE_REORIENT } else { MODE_TRACK };
            state.p_BE[1] = if tick == 7 { 0.008_462 } else { 0.001 };
            let messages = ByTopic {
                plant_state: Some(&state),
                singularity: Some(&report),
                control_state: Some(&command),
                ..ByTopic::default()
            };
            let row = TickRow::new(tick, messages);
            history.push(&row);
            let (first, end, mode) = (10, 25, MODE_REORIENT);
            let stay = Stay { first, end, mode };
            assert_eq!(history.past[0], (tick >= 25).then_some(stay));
            assert_eq!(history.off_mm(), Some(if tick < 7 { 1.0 } else { 8.5 }));
        }
    }

    #[test]
    fn every_code_has_a_lane_colour() {
        let tables = [
            (MODES, MODE_STATES),
            (DRIVES, DRIVE_STATES),
            (PHASES, PHASE_STATES),
        ];
        for (table, states) in tables {
            let has_colour = |name: &str| states.iter().any(|(state, _)| *state == name);
            assert!(table.iter().all(|(_, name)| has_colour(name)));
        }
    }
}
