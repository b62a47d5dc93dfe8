//! A steered run: the source of its targets, and the limits of its motion.

use serde::{Deserialize, Serialize};

use super::force::stiffness_n_m;
use crate::codes::TARGET_END;
use crate::file::{Complaint, key_within, positive, require};
use crate::target_file::{self, Row};

/// A steered run: the arm follows targets instead of segments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Servo {
    /// File of targets, beside the scenario (docs/servo.md describes the format). Empty: `targets`,
    /// or a process of the graph.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub input: String,
    /// The targets themselves, in the file's format.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub targets: String,
    /// Targets arrive during the run, on the socket in the run's directory. The clock paces the
    /// ticks.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub live: bool,
    /// Longest duration; s. 0: until the last target of the file has expired.
    pub duration_s: f64,
    /// Ticks after which the run ends, wherever the arm is. 0: no such limit. An interrupted
    /// session is saved with the number of ticks that it had.
    #[serde(skip_serializing_if = "crate::is_default")]
    pub ticks: u64,
    /// Largest speed of the end-effector; m/s.
    pub speed_m_s: f64,
    /// Largest angular speed of the end-effector; rad/s.
    pub speed_rad_s: f64,
    /// Largest acceleration of the end-effector; m/s².
    pub acceleration_m_s2: f64,
    /// Largest angular acceleration of the end-effector; rad/s².
    pub acceleration_rad_s2: f64,
    /// About the stiffness of the surfaces that targets press on, within a factor of 2; N/m.
    pub stiffness_n_m: f64,
}

impl Default for Servo {
    fn default() -> Self {
        Self {
            input: String::new(),
            targets: String::new(),
            live: false,
            duration_s: 0.0,
            ticks: 0,
            speed_m_s: 0.5,
            speed_rad_s: 1.5,
            acceleration_m_s2: 2.0,
            acceleration_rad_s2: 6.0,
            stiffness_n_m: stiffness_n_m(),
        }
    }
}

impl Servo {
    /// The name of the socket in the run's directory that takes the targets of a live session, one line each.
    pub const SOCKET: &str = "operator.socket";

    /// The line that ends a live session at once ...
    pub const END: &str = "end";

    /// ... and the one that ends it when its last target is over, or after [`Self::LONGEST_REST_S`].
    pub const CLOSE: &str = "close";

    /// Longest time for which a session continues after its input has ended, s.
    pub const LONGEST_REST_S: f64 = 10.0;

    /// The targets of the text, for a run of `rate_hz`; none if there is no text.
    #[must_use]
    pub fn rows(&self, rate_hz: u32) -> Vec<Row> {
        // The text has been checked with the scenario.
        target_file::parse(&self.targets, rate_hz).unwrap_or_default()
    }

    /// How many targets of the text follow its first `end`: they have no effect.
    #[must_use]
    pub fn after_end(&self, rate_hz: u32) -> usize {
        let after = self
            .rows(rate_hz)
            .into_iter()
            .skip_while(|row| row.target.kind != TARGET_END);
        after.filter(|row| row.target.kind != TARGET_END).count()
    }

    /// How long the arm is steered; s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        if self.duration_s > 0.0 {
            return self.duration_s;
        }
        self.rows(MS).last().map_or(0.0, |row| {
            row.tick as f64 / f64::from(MS) + row.target.valid_s.clamp(0.0, LONGEST_S)
        })
    }

    pub(super) fn check(&self) -> Result<(), Complaint> {
        for (name, value) in [
            ("speed_m_s", self.speed_m_s),
            ("speed_rad_s", self.speed_rad_s),
            ("acceleration_m_s2", self.acceleration_m_s2),
            ("acceleration_rad_s2", self.acceleration_rad_s2),
        ] {
            positive(&format!("servo.{name}"), value)?;
        }
        key_within("servo.", "stiffness_n_m", self.stiffness_n_m, 10.0..=1e6)?;
        key_within("servo.", "duration_s", self.duration_s, 0.0..=36_000.0)?;
        if self.targets.is_empty() {
            return require(
                self.duration_s > 0.0 || !self.input.is_empty(),
                "servo",
                "there are no targets",
                "give the input file, the targets themselves, or the duration_s of a session with a process of its own",
            );
        }
        let invalid = |error: target_file::InvalidRow| {
            let remedy = "docs/servo.md has the format";
            Complaint::new("servo.targets", error.to_string(), remedy)
        };
        target_file::parse(&self.targets, MS)
            .map(drop)
            .map_err(invalid)
    }
}

/// Longest validity of the last target that a session waits for, s.
const LONGEST_S: f64 = 60.0;

/// Ticks per second where only times count.
const MS: u32 = 1000;
