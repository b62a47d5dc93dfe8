//! The colours of all pictures.

use plotters::style::RGBAColor;

/// An opaque or translucent colour.
pub type Color = RGBAColor;

pub(super) const fn rgb(r: u8, g: u8, b: u8) -> Color {
    RGBAColor(r, g, b, 1.0)
}

/// Text on what is dark.
pub(super) const WHITE: Color = rgb(255, 255, 255);
/// Text and axes.
pub const INK: Color = rgb(38, 42, 51);
/// The colour of secondary data.
pub const GREY: Color = rgb(120, 126, 138);
/// Lines behind the data.
pub const FAINT: Color = rgb(228, 230, 235);
/// Ours.
pub const BLUE: Color = rgb(0, 98, 178);
/// The colour of failures.
pub const RED: Color = rgb(203, 50, 52);

/// The n-th of eight distinguishable colours, for the colour-blind too (after Okabe and Ito).
pub fn numbered(n: usize) -> Color {
    const COLORS: [Color; 8] = [
        BLUE,
        rgb(213, 94, 0),
        rgb(0, 140, 104),
        rgb(184, 92, 150),
        rgb(201, 140, 0),
        rgb(66, 160, 216),
        rgb(110, 110, 118),
        rgb(150, 40, 60),
    ];
    COLORS[n % COLORS.len()]
}
