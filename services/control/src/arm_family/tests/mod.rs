//! Each family's promises.

mod agreement;
mod geometry;
mod inverse;
mod minima;
mod numeric;
