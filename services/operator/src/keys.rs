//! The keys of a terminal as targets. PURE.

use shared_types::scenario::Servo;

/// How long a key acts, s; longer than a terminal's delay before it repeats a key.
const HOLDS_S: f64 = 0.6;
/// Speed of a key at the start: m/s and rad/s.
const SPEED: [f64; 2] = [0.05, 0.2];

/// Steps of the speed, and its range.
const STEP: f64 = 1.25;
const RANGE: (f64, f64) = (0.05, 8.0);

const FRAMES: [&str; 3] = ["base", "hand", "singular"];
const SIDES: [&str; 3] = ["keep", "positive", "negative"];

/// State set by the keys.
#[derive(Clone, Debug)]
pub struct Keys {
    /// Index of [`FRAMES`], and of [`SIDES`].
    frame: usize,
    side: usize,
    /// Of [`SPEED`].
    factor: f64,
}

impl Default for Keys {
    fn default() -> Self {
        Self {
            frame: 0,
            side: 0,
            factor: 1.0,
        }
    }
}

impl Keys {
    /// The keys, in two lines.
    pub const HELP: &str = "w/s x  a/d y  r/f z   i/k turn x  j/l turn y  u/o turn z\n+ - speed   1 base 2 hand 3 singular   x side   space stop   q end";

    /// The target of a key; `None` if it only changes a setting, or means nothing.
    pub fn press(&mut self, key: u8) -> Option<String> {
        let axis = match key {
            b'w' | b's' => 0,
            b'a' | b'd' => 1,
            b'r' | b'f' => 2,
            b'i' | b'k' => 3,
            b'j' | b'l' => 4,
            b'u' | b'o' => 5,
            b' ' => 6,
            // Ctrl-C and Ctrl-D too.
            b'q' | 3 | 4 => return Some(Servo::END.to_owned()),
            other => {
                self.set(other);
                return None;
            }
        };
        let sign = if b"sdfklo".contains(&key) { -1.0 } else { 1.0 };
        let mut twist = [0.0; 6];
        if axis < 6 {
            twist[axis] = sign * self.factor * SPEED[axis / 3];
        }
        let values = twist.map(|value| value.to_string()).join(" ");
        let (frame, side) = (FRAMES[self.frame], SIDES[self.side]);
        Some(format!("twist, {frame}, {HOLDS_S}, {values}, {side}"))
    }

    fn set(&mut self, key: u8) {
        let step = match key {
            b'+' | b'=' => STEP,
            b'-' => 1.0 / STEP,
            _ => 1.0,
        };
        self.factor = (self.factor * step).clamp(RANGE.0, RANGE.1);
        match key {
            b'1'..=b'3' => self.frame = usize::from(key - b'1'),
            b'x' => self.side = (self.side + 1) % SIDES.len(),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::{FRAME_HAND, SIDE_POSITIVE, TARGET_END, TARGET_TWIST};
    use shared_types::target_file::live;

    #[test]
    fn every_key_is_a_target_that_the_operator_reads() {
        let mut keys = Keys::default();
        let mut press = |key: u8| {
            keys.press(key)
                .map(|line| live(&line, 0, 1000).next().unwrap().unwrap())
        };
        assert_eq!(press(b'd').unwrap().twist, [0.0, -0.05, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((press(b'2'), press(b'x')), (None, None));
        let turned = press(b'u').unwrap();
        assert_eq!(
            (turned.kind, turned.frame, turned.side, turned.twist[5]),
            (TARGET_TWIST, FRAME_HAND, SIDE_POSITIVE, 0.2)
        );
        assert_eq!(
            (press(b' ').unwrap().twist, press(3).unwrap().kind),
            ([0.0; 6], TARGET_END)
        );
    }
}
