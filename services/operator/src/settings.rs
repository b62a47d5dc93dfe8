//! Frame, side and speed of the targets, as keys have set them. PURE.

/// Steps of the speed, and its range.
const STEP: f64 = 1.25;
const RANGE: (f64, f64) = (0.05, 8.0);

const FRAMES: [&str; 3] = ["base", "hand", "singular"];
const SIDES: [&str; 3] = ["keep", "positive", "negative"];

#[derive(Clone, Debug)]
pub(crate) struct Settings {
    /// One of [`FRAMES`].
    pub(crate) frame: usize,
    side: usize,
    pub(crate) factor: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            frame: 0,
            side: 0,
            factor: 1.0,
        }
    }
}

impl Settings {
    pub(crate) fn change_side(&mut self) {
        self.side = (self.side + 1) % SIDES.len();
    }

    pub(crate) fn change_speed(&mut self, is_up: bool) {
        let step = if is_up { STEP } else { 1.0 / STEP };
        self.factor = (self.factor * step).clamp(RANGE.0, RANGE.1);
    }

    /// The line of a target that asks for `twist` and is too old after `valid_s`.
    pub(crate) fn line(&self, valid_s: f64, twist: [f64; 6]) -> String {
        let values = twist.map(|value| value.to_string()).join(" ");
        let (frame, side) = (FRAMES[self.frame], SIDES[self.side]);
        format!("twist, {frame}, {valid_s}, {values}, {side}")
    }
}
