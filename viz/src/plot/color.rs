//! The colours of all pictures.

use plotters::style::RGBAColor;

/// An opaque or translucent colour.
pub type Color = RGBAColor;

/// The opaque colour `0xrrggbb`.
pub(crate) const fn rgb(colour: u32) -> Color {
    let [_, r, g, b] = colour.to_be_bytes();
    RGBAColor(r, g, b, 1.0)
}

/// Text on what is dark.
pub(super) const WHITE: Color = rgb(0xffffff);
/// Text and axes.
pub const INK: Color = rgb(0x262a33);
/// The colour of secondary data.
pub const GREY: Color = rgb(0x787e8a);
/// Lines behind the data.
pub const FAINT: Color = rgb(0xe4e6eb);
/// Ours.
pub const BLUE: Color = rgb(0x0062b2);
/// The colour of failures.
pub const RED: Color = rgb(0xcb3234);

/// The n-th of eight distinguishable colours, for the colour-blind too (after Okabe and Ito).
pub fn numbered(n: usize) -> Color {
    const COLORS: [u32; 8] = [
        0x0062b2, 0xd55e00, 0x008c68, 0xb85c96, 0xc98c00, 0x42a0d8, 0x6e6e76, 0x96283c,
    ];
    rgb(COLORS[n % COLORS.len()])
}
