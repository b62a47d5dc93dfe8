//! The run in words and colours: what people read beside the picture. PURE.

use nalgebra::Vector3;
use shared_types::codes::*;

use crate::facts::Facts;
use crate::pose::Rgba;
use crate::run::Tick;
use crate::signals::Now;
use crate::story::Named;

/// A colour and its name.
type Tint = (&'static str, Rgba);
/// Of those that are found by number.
const OTHERS: [Tint; 4] = [
    ("violet", 0xb48cffff),
    ("turquoise", 0x40c8b4ff),
    ("lime", 0xb4dc50ff),
    ("blue", 0x78beebff),
];

/// A singularity's colour, the same in marks, plots and words: by kind, for one found by number by its place.
pub(crate) fn named_colour(kind: u32, index: usize) -> Tint {
    match kind {
        KIND_ELBOW => ("orange", 0xff8018ff),
        KIND_WRIST => ("magenta", 0xf046dcff),
        KIND_OVERHEAD | KIND_SHOULDER => ("yellow", 0xfad63cff),
        _ => OTHERS[index % OTHERS.len()],
    }
}

/// Colours of the lanes of [`MODES`]: grey outside, warm inside.
pub(crate) const MODE_COLOURS: [Rgba; MODES.len()] = [
    0x3d4753ff, 0x8a7a3aff, 0x2f8f6bff, 0x2f7fb5ff, 0x8f6a4aff, 0xb03aa0ff, 0x4f7f86ff, 0x6b5fb0ff,
];

/// Colours of the lane of [`DRIVES`].
pub(crate) const DRIVE_COLOURS: [Rgba; DRIVES.len()] =
    [0x3f7f55ff, 0xb59a2fff, 0xc2602fff, 0xb03a3aff];

/// Colours of the lane of [`PHASES`].
pub(crate) const PHASE_COLOURS: [Rgba; PHASES.len()] =
    [0x3a6fb0ff, 0x5a8fa0ff, 0x3f7f55ff, 0xb03a3aff];

/// Lanes of the processes: states and their colours.
pub(crate) const LIFE_STATES: [(&str, Rgba); 4] = [
    ("up", 0x3d5f4bff),
    ("silent", 0xb0602fff),
    ("waiting", 0x5a626cff),
    ("restarted", 0xb59a2fff),
];

/// Colours of the lane of faults: of one in force, and of none.
pub(crate) const FAULT_COLOUR: Rgba = 0xc03030ff;
pub(crate) const NO_FAULT: (&str, Rgba) = ("none", 0x2a3038ff);

/// A stretch in the neighbourhood of a singularity with one response: its first tick and the tick after its last.
#[derive(Debug, PartialEq)]
struct Stretch {
    singularity: usize,
    first: u64,
    end: u64,
    mode: u32,
}

/// The events of a run so far: the words of a moment depend on it.
#[derive(Default)]
pub(crate) struct History {
    /// The acts of control inside neighbourhoods, by the time at which it began.
    stretches: Vec<Stretch>,
    /// The largest distance of the hand from its place; m.
    off_m: f64,
}

/// A stretch goes on across so many ticks without a command; and what is shorter than this is not told.
const PATIENCE: u64 = 5;
const SHORT_S: f64 = 0.05;

/// The response at a singularity.
pub(crate) fn mode(row: &Tick, i: usize) -> u32 {
    row.control_state
        .map_or(MODE_REGULAR, |state| state.mode[i])
}

impl History {
    /// Takes a tick in. While the drives hold or brake the arm, no response acts.
    pub(crate) fn push(&mut self, row: &Tick) {
        let is_driven = row.sensor.is_none_or(|sensor| sensor.drive == DRIVE_ACTIVE);
        for (singularity, one) in row.singularities().iter().enumerate() {
            let (first, mode) = (row.tick, mode(row, singularity));
            let is_its = |stretch: &&mut Stretch| stretch.singularity == singularity;
            let last = self.stretches.iter_mut().rev().find(is_its);
            match last.filter(|last| last.mode == mode && last.end + PATIENCE >= first) {
                _ if one.inside == 0 || mode == MODE_REGULAR || !is_driven => (),
                Some(last) => last.end = first + 1,
                None => self.stretches.push(Stretch {
                    singularity,
                    first,
                    end: first + 1,
                    mode,
                }),
            }
        }
        if let (Some(state), Some(desired)) = (row.plant_state, row.control_state) {
            let off = Vector3::from(state.p_BE) - Vector3::from(desired.p_BE_d);
            self.off_m = self.off_m.max(off.norm());
        }
    }

    /// How far the hand has been off its place; mm, to two digits.
    fn off_mm(&self) -> f64 {
        let off_um = self.off_m * 1e6;
        let digit = 10f64.powf(off_um.max(1.0).log10().floor() - 1.0).max(1.0);
        (off_um / digit).round() * digit * 1e-3
    }
}

/// A moment of a run, and what its words depend on besides.
pub(crate) struct Moment<'a> {
    pub(crate) row: &'a Tick,
    pub(crate) facts: &'a Facts<'a>,
    pub(crate) history: &'a History,
    /// The fault in force, in a few words.
    pub(crate) fault: Option<&'a str>,
}

/// The events of a tick, in words: a headline, and lines, some of them about a singularity.
#[derive(Default, PartialEq)]
pub(crate) struct Words {
    pub(crate) headline: String,
    pub(crate) lines: Vec<(Option<usize>, String)>,
}

impl Words {
    /// As the viewer reads it, with the colours of the singularities by their names.
    pub(crate) fn markdown(&self, named: &[Named]) -> String {
        let line = |(of, text): &(Option<usize>, String)| match of.and_then(|i| named.get(i)) {
            Some(one) => format!("**{}** ({}){text}.  \n", one.name, one.colour_name),
            None => format!("{text}.  \n"),
        };
        let lines: String = self.lines.iter().map(line).collect();
        format!("**{}**  \n{lines}", self.headline)
    }

    fn add(&mut self, text: impl Into<String>) {
        self.lines.push((None, text.into()));
    }

    fn add_about(&mut self, singularity: usize, text: String) {
        self.lines.push((Some(singularity), text));
    }

    /// A headline; below that of a fault, a line.
    fn head(&mut self, headline: String) {
        if self.headline.is_empty() {
            self.headline = headline
        } else {
            self.add(headline)
        }
    }
}

impl Moment<'_> {
    /// The drive's state first; then the singularities that the arm is in, the motion that is lost there, and the response.
    pub(crate) fn words(&self) -> Words {
        let mut words = Words::default();
        let is_driven = self.tell_drive(&mut words);
        match self.row.singularities().iter().any(|one| one.inside == 1) {
            true => self.tell_locks(&mut words, is_driven),
            false if is_driven => self.tell_free(&mut words),
            false => (),
        }
        if !is_driven {
            return words;
        }
        if let Some(state) = self.row.servo_state {
            let reason = reason_text(state.reason, state.joint, state.upper);
            words.add(format!("Steered: {reason}"));
        } else if self.row.control_state.is_some_and(|m| m.clipped == 1) {
            words.add("The goal is out of reach: the hand slides along the boundary");
        }
        if let Some([asked, force]) = Now::new(self.row, self.facts).pressed() {
            let digits = usize::from(asked < 10.0);
            words.add(format!(
                "The hand presses with {force:.digits$} N of {asked} N"
            ));
        }
        if self.row.torque.is_some_and(|m| m.phase == PHASE_REFUSED) {
            words.add("The controller refused to go on and brings the arm to rest");
        }
        words
    }

    /// The fault in force, and a drive that does not follow the controller; whether it does.
    fn tell_drive(&self, words: &mut Words) -> bool {
        let drive = self.row.sensor.map_or(DRIVE_ACTIVE, |sensor| sensor.drive);
        let comes = self.row.torque.is_some();
        let does = match drive {
            DRIVE_ACTIVE if comes => "the arm goes on",
            DRIVE_ACTIVE | DRIVE_HOLDING => "the drives hold the last torque",
            DRIVE_STOPPING => "the drives bring the arm to rest",
            _ => "the drives have braked the arm",
        };
        let is_driven = comes && drive == DRIVE_ACTIVE;
        if !is_driven || self.fault.is_some() {
            let late = if comes {
                "Torque came late"
            } else {
                "No torque comes"
            };
            words.headline = format!("{}: {does}", self.fault.unwrap_or(late));
        }
        if !is_driven {
            words.add("The drives do this by themselves until fresh torque comes. In the lanes of the processes, those that wait for another one are grey");
        }
        is_driven
    }

    /// No singularity is in the way: those that the arm has been in, the last of them at the end.
    fn tell_free(&self, words: &mut Words) {
        if self.facts.stands_still {
            let off_mm = self.history.off_mm();
            words.head(self.facts.title.to_owned());
            return words.add(format!(
                "The hand should stand still. It has been {off_mm} mm off its place at most. Amber: its way, 50 times as large"
            ));
        }
        let mut all = self.row.singularities().iter().enumerate();
        let headline = match all.find(|(i, _)| mode(self.row, *i) != MODE_REGULAR) {
            Some((i, one)) => format!(
                "Near the {} singularity: {}",
                singularity_name(one.kind, i),
                doing(mode(self.row, i))
            ),
            None => "Free: the hand can move in every direction".to_owned(),
        };
        words.head(headline);
        let rate_hz = f64::from(self.facts.rate_hz);
        let is_long = |one: &&Stretch| (one.end - one.first) as f64 > SHORT_S * rate_hz;
        let long: Vec<_> = self.history.stretches.iter().filter(is_long).collect();
        for stretch in &long[long.len().saturating_sub(3)..] {
            let [first, end] = [stretch.first, stretch.end].map(|tick| tick as f64 / rate_hz);
            let text = format!(", {first:.2} to {end:.2} s: {}", doing(stretch.mode));
            words.add_about(stretch.singularity, text);
        }
    }

    /// The singularities that the arm is in, each with what control does there while the drives follow it.
    fn tell_locks(&self, words: &mut Words, is_driven: bool) {
        let inside: Vec<_> = self
            .row
            .singularities()
            .iter()
            .enumerate()
            .filter(|(_, one)| one.inside == 1)
            .collect();
        let joints = self.facts.joints();
        let directions = self.facts.robot.task.count().min(joints);
        let rank = directions.saturating_sub(inside.len());
        let rank = format!("rank {rank} of {directions}");
        let headline = match inside[..] {
            [(i, one)] => {
                // One that was found by number has no name but that.
                let name = match one.kind {
                    KIND_NUMERIC => "Singular".to_owned(),
                    kind => capital(singularity_name(kind, i)) + " lock",
                };
                format!(
                    "{name}: the hand cannot {} · {rank}",
                    lost(one.angular == 1)
                )
            }
            _ => format!("{} directions are lost · {rank}", inside.len()),
        };
        words.head(headline);
        for (i, one) in inside {
            let (class, why) = (name_of(TYPES, one.class), reason(one.kind, joints));
            let doing = match mode(self.row, i) {
                mode if is_driven && mode != MODE_REGULAR => format!("; {}", doing(mode)),
                _ => String::new(),
            };
            words.add_about(i, format!(", {class}: {why}{doing}"));
        }
    }
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
fn doing(mode: u32) -> &'static str {
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
    use shared_types::messages::{ControlState, PlantState, SensorSample, SingularityReport};
    use shared_types::topics::ByTopic;

    /// Each response is told with its own times, but for those of the drives, and how far a hand was off that should stand still.
    #[test]
    fn the_past_is_known() {
        let (mut report, mut command) = <(SingularityReport, ControlState)>::default();
        let (mut state, mut history) = <(PlantState, History)>::default();
        let mut sensor = SensorSample::default();
        report.count = 1;
        for number in 0..30 {
            report.singularities[0].inside = u32::from((10..25).contains(&number));
            command.mode[0] = if number < 22 {
                MODE_REORIENT
            } else {
                MODE_TRACK
            };
            state.p_BE[1] = if number == 7 { 0.008_462 } else { 0.001 };
            sensor.drive = match number {
                14..21 => DRIVE_STOPPING,
                _ => DRIVE_ACTIVE,
            };
            let messages = ByTopic {
                sensor: Some(sensor),
                plant_state: Some(state),
                singularity: Some(report),
                control_state: Some(command),
                ..ByTopic::default()
            };
            history.push(&Tick {
                tick: number,
                messages,
                events: Vec::new(),
            });
            assert_eq!(history.off_mm(), if number < 7 { 1.0 } else { 8.5 });
        }
        let stretch = |first, end, mode| Stretch {
            singularity: 0,
            first,
            end,
            mode,
        };
        let expected = [
            stretch(10, 14, MODE_REORIENT),
            stretch(21, 22, MODE_REORIENT),
            stretch(22, 25, MODE_TRACK),
        ];
        assert_eq!(history.stretches, expected);
    }
}
