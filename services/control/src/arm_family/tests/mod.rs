//! Each family's guarantees.

mod agreement;
mod geometry;
mod inverse;
mod minima;
mod numeric;
