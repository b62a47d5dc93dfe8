//! Each family's promises.

mod geometry;
mod inverse;
mod minima;
mod numeric;
