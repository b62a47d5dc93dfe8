//! The viewer's colours on paper. PURE.

use crate::plot::{Color, rgb};
use crate::solid::Rgba;

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

/// The least luminance of words in the viewer's 3-D views. Their ground is dark or, in the viewer's light theme, of a middle grey.
const PALEST: f32 = 0.85;

/// A colour for words that read in both themes of the viewer: with as much white as that takes.
pub(crate) fn of_words(colour: Rgba) -> Rgba {
    let (luminance, [r, g, b, _]) = (luminance(colour), colour.to_be_bytes());
    let white = ((PALEST - luminance) / (1.0 - luminance).max(1e-6)).clamp(0.0, 1.0);
    let [r, g, b] = [r, g, b].map(|byte| {
        (255.0 * (linear(byte) + white * (1.0 - linear(byte))).powf(1.0 / 2.2)).round() as u8
    });
    u32::from_be_bytes([r, g, b, 255])
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

/// The colour of a kind of singularity, as in marks and plots of the viewer, for white paper.
#[must_use]
pub fn singularity_ink(kind: u32) -> Color {
    ink(crate::narration::colour_of(kind, 0))
}

/// As a plot takes it.
pub(crate) fn ink(colour: Rgba) -> Color {
    rgb(on_paper(colour) >> 8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bright_colours_are_darkened_for_paper_and_dark_ones_lightened_for_words() {
        let [r, g, b, _] = on_paper(0xfad63cff).to_be_bytes();
        assert!(r > g && g > b && g < 160, "still yellow: {r} {g} {b}");
        assert_eq!(on_paper(0x283c78ff), 0x283c78ff);
        for colour in [0xf03cd25a, 0x5adc78ff, 0x000000ff, 0xffffff00] {
            assert!(luminance(of_words(colour)) > 0.84 && of_words(colour) & 0xff == 0xff);
        }
    }
}
