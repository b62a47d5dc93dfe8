//! The viewer's colours on paper. PURE.

use crate::pose::Rgba;

/// The largest luminance of a line on white paper: a contrast of three to one.
const LIGHTEST: f32 = 0.30;

fn linear(byte: u8) -> f32 {
    (f32::from(byte) / 255.0).powf(2.2)
}

fn luminance(colour: Rgba) -> f32 {
    let [r, g, b, _] = colour.to_be_bytes();
    0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
}

/// A colour of the viewer, whose ground is dark, for white paper: the same hue, as dark as it has to be.
pub(crate) fn on_paper(colour: Rgba) -> Rgba {
    let light = (LIGHTEST / luminance(colour).max(LIGHTEST)).powf(1.0 / 2.2);
    shaded(colour, light)
}

/// Darker by a factor.
pub(crate) fn shaded(colour: Rgba, light: f32) -> Rgba {
    let [r, g, b, a] = colour.to_be_bytes();
    let [r, g, b] = [r, g, b].map(|byte| (f32::from(byte) * light).round().clamp(0.0, 255.0) as u8);
    u32::from_be_bytes([r, g, b, a])
}

/// With another opacity.
pub(crate) fn faded(colour: Rgba, opacity: u8) -> Rgba {
    (colour & !0xff) | u32::from(opacity)
}

/// As HTML writes it.
pub(crate) fn hex(colour: Rgba) -> String {
    format!("#{:06x}", colour >> 8)
}

/// How opaque it is, 0 to 1.
pub(crate) fn opacity(colour: Rgba) -> f32 {
    (colour & 0xff) as f32 / 255.0
}
