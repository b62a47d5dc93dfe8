//! The sticks, triggers and buttons of a gamepad as targets. PURE.

use crate::settings::Settings;
use shared_types::scenario::Servo;

/// Reading of a stick or trigger up to which it is at rest: worn sticks do not come back to zero.
const DEAD: f64 = 0.12;
/// Age from which a target is too old, s: the pause between two of them many times over.
const VALID_S: f64 = 0.2;
/// Speed of a full stick at the start: m/s and rad/s.
const SPEED: [f64; 2] = [0.1, 0.4];

/// Something to pull or push, as a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// −1 left, 1 right.
    LeftStickX,
    /// −1 down (towards the user), 1 up.
    LeftStickY,
    /// −1 left, 1 right.
    RightStickX,
    /// −1 down, 1 up.
    RightStickY,
    /// 0 to 1.
    LeftTrigger,
    /// 0 to 1.
    RightTrigger,
}

/// Something to press, by its place: makers print different letters on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// The lowest of the four on the right.
    South,
    /// The left one.
    West,
    /// The uppermost one.
    North,
    /// Above the left trigger.
    LeftShoulder,
    /// Above the right trigger.
    RightShoulder,
    /// Up on the cross.
    Up,
    /// Down on the cross.
    Down,
    /// The right one of the two in the middle.
    Start,
}

/// The state of a gamepad, and the settings made by its buttons.
#[derive(Clone, Debug, Default)]
pub struct Pad {
    sticks: [f64; 6],
    shoulders: [bool; 2],
    settings: Settings,
    is_stopped: bool,
}

impl Pad {
    /// The sticks and buttons, in one line.
    pub const HELP: &str = "left stick x y  triggers z   right stick turn z y  shoulders turn x   cross up down speed   north frame  west side  \
                            south stop   start end";

    /// Takes a reading of an axis in; one that is no number is rest.
    pub fn tilt(&mut self, axis: Axis, reading: f64) {
        self.sticks[axis as usize] = beyond_dead_zone(reading);
        // A stop lasts until every stick has been let go.
        self.is_stopped &= !self.is_at_rest();
    }

    /// Handles a pressed or released button. Returns the line to send at once, if it is more than
    /// the sticks' next target.
    pub fn press(&mut self, button: Button, is_down: bool) -> Option<String> {
        match (button, is_down) {
            (Button::LeftShoulder, _) => self.shoulders[0] = is_down,
            (Button::RightShoulder, _) => self.shoulders[1] = is_down,
            (Button::South, true) => {
                self.is_stopped = true;
                return Some(self.line());
            }
            (Button::North, true) => self.settings.frame = (self.settings.frame + 1) % 3,
            (Button::West, true) => self.settings.change_side(),
            (Button::Up, true) => self.settings.change_speed(true),
            (Button::Down, true) => self.settings.change_speed(false),
            (Button::Start, true) => return Some(Servo::END.to_owned()),
            (_, false) => {}
        }
        self.is_stopped &= !self.is_at_rest();
        None
    }

    /// Everything let go: a gamepad that is gone.
    pub fn release(&mut self) {
        (self.sticks, self.shoulders) = ([0.0; 6], [false; 2]);
    }

    /// Whether nothing is tilted, pulled or held.
    pub fn is_at_rest(&self) -> bool {
        self.sticks == [0.0; 6] && self.shoulders == [false; 2]
    }

    /// The twist that is asked for, in the axes of the frame; m/s, rad/s.
    pub fn twist(&self) -> [f64; 6] {
        if self.is_stopped {
            return [0.0; 6];
        }
        let of = |axis: Axis| self.sticks[axis as usize];
        let [left, right] = self.shoulders.map(f64::from);
        let [v, w] = SPEED.map(|speed| speed * self.settings.factor);
        // Up is away from the user, along x; left is along y, and a positive turn.
        [
            v * of(Axis::LeftStickY),
            -v * of(Axis::LeftStickX),
            v * (of(Axis::RightTrigger) - of(Axis::LeftTrigger)),
            w * (right - left),
            w * of(Axis::RightStickY),
            -w * of(Axis::RightStickX),
        ]
        .map(|x| x + 0.0)
    }

    /// The target of this moment.
    pub fn line(&self) -> String {
        self.settings.line(VALID_S, self.twist())
    }
}

/// A reading with the dead zone taken out, from there on linear to ±1.
fn beyond_dead_zone(reading: f64) -> f64 {
    if reading.is_nan() {
        return 0.0;
    }
    let size = (reading.abs().min(1.0) - DEAD).max(0.0) / (1.0 - DEAD);
    if reading < 0.0 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::{
        FRAME_BASE, FRAME_HAND, FRAME_SINGULAR, SIDE_POSITIVE, TARGET_END, TARGET_TWIST,
    };
    use shared_types::target_file::live;

    /// A line as the operator reads it.
    fn target(line: &str) -> shared_types::TargetContent {
        live(line, 0, 1000).next().unwrap().unwrap()
    }

    #[test]
    fn a_full_stick_is_the_full_speed_and_a_worn_one_is_at_rest() {
        let cases: [(Axis, f64, usize, f64); 9] = [
            (Axis::LeftStickY, 1.0, 0, 0.1),
            (Axis::LeftStickX, 1.0, 1, -0.1),
            (Axis::RightTrigger, 1.0, 2, 0.1),
            (Axis::LeftTrigger, 1.0, 2, -0.1),
            (Axis::RightStickY, -1.0, 4, -0.4),
            (Axis::RightStickX, -1.0, 5, 0.4),
            (Axis::LeftStickY, 0.56, 0, 0.05),
            (Axis::LeftStickY, -0.119, 0, 0.0),
            // A reading beyond its range is the end of it.
            (Axis::LeftStickY, 7.0, 0, 0.1),
        ];
        for (axis, reading, place, expected) in cases {
            let mut pad = Pad::default();
            pad.tilt(axis, reading);
            let mut twist = [0.0; 6];
            twist[place] = expected;
            let close = pad
                .twist()
                .iter()
                .zip(twist)
                .all(|(one, other)| (one - other).abs() < 1e-12);
            assert!(close, "{axis:?} at {reading}: {:?}", pad.twist());
        }
        let mut pad = Pad::default();
        pad.tilt(Axis::LeftStickX, f64::NAN);
        assert!(pad.is_at_rest());
        pad.tilt(Axis::LeftStickX, f64::INFINITY);
        assert_eq!(pad.twist()[1], -0.1);
    }

    #[test]
    fn buttons_choose_frame_side_and_speed_and_the_operator_reads_every_line() {
        let mut pad = Pad::default();
        pad.tilt(Axis::LeftStickY, 1.0);
        // The button pressed, and then the target: its frame, its side, its speed.
        let no_side = target(&pad.line()).side;
        for (buttons, frame, side, speed) in [
            (&[][..], FRAME_BASE, no_side, 0.1),
            (
                &[Button::North, Button::West, Button::Up],
                FRAME_HAND,
                SIDE_POSITIVE,
                0.125,
            ),
            (&[Button::North], FRAME_SINGULAR, SIDE_POSITIVE, 0.125),
            // The speed has a least value.
            (
                &[&[Button::North][..], &[Button::Down; 100]].concat(),
                FRAME_BASE,
                SIDE_POSITIVE,
                0.005,
            ),
        ] {
            for button in buttons {
                assert_eq!(
                    [true, false].map(|down| pad.press(*button, down)),
                    [None, None]
                );
            }
            let found = target(&pad.line());
            assert_eq!(
                (found.kind, found.frame, found.side),
                (TARGET_TWIST, frame, side)
            );
            assert!((found.twist[0] - speed).abs() < 1e-12, "{found:?}");
        }
        let mut pad = Pad::default();
        pad.tilt(Axis::LeftStickY, 1.0);
        pad.press(Button::RightShoulder, true);
        assert_eq!(target(&pad.line()).twist[3], 0.4);
        let end = pad.press(Button::Start, true).unwrap();
        assert_eq!(target(&end).kind, TARGET_END);
    }

    #[test]
    fn a_stop_lasts_until_everything_is_let_go() {
        let mut pad = Pad::default();
        pad.tilt(Axis::LeftStickY, 1.0);
        assert_eq!(
            target(&pad.press(Button::South, true).unwrap()).twist,
            [0.0; 6]
        );
        pad.tilt(Axis::LeftStickY, 0.5);
        assert_eq!(pad.twist(), [0.0; 6], "the stick is still tilted");
        pad.tilt(Axis::LeftStickY, 0.0);
        pad.tilt(Axis::LeftStickY, 1.0);
        assert_eq!(pad.twist()[0], 0.1);
        pad.release();
        assert!(pad.is_at_rest() && pad.twist() == [0.0; 6]);
    }
}
