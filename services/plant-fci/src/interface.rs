//! Constants of the interface.

/// Joints of a Franka arm.
pub const JOINTS: usize = 7;

/// Ticks per second of the interface.
pub const RATE_HZ: u32 = 1000;
