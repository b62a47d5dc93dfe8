//! Control laws compared: on scenarios, on many lines, and at the best of their parameters.

mod arm_sweep;
mod arm_text;
mod law;
mod picture;
mod race;
mod scenarios;
mod score;
mod sweep;
mod text;
mod tune;
mod verdict;

pub use arm_sweep::{ArmLines, ArmSweep, Line, Outcome};
pub use law::{laws, name_of};
pub use race::{Race, Racer, race};
pub use scenarios::{Compared, Request, compare};
pub use score::Score;
pub(crate) use score::scored;
pub use sweep::{SWEEP, Sweep, SweepSize, missed};
pub use tune::{Point, Ranked, tune, worth};
