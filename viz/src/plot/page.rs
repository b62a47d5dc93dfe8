//! A page of panels, and its files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::style::text_anchor::HPos;
use plotters::style::{FontStyle, WHITE, register_font};

use super::color::{GREY, INK};
use super::panel::Panel;
use super::pen::{CHARACTER, FINE, FONT, Pen, said};

/// Drawn pixels per pixel of the PNG, which has two for each point.
const SHRINK: u32 = 2;
static SANS: &[u8] = include_bytes!("dejavu-sans-subset.ttf");
static BOLD: &[u8] = include_bytes!("dejavu-sans-bold-subset.ttf");

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The file.
    #[error("cannot write {}: {error}; choose another folder with --out", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The drawing.
    #[error("the picture {} cannot be drawn: {reason}", path.display())]
    Draw {
        /// Which.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Page {
    /// Heading.
    pub title: String,
    /// One line below it.
    pub subtitle: String,
    /// From top to bottom.
    pub rows: Vec<Row>,
    /// Lines of text below.
    pub notes: Vec<String>,
    /// Points.
    pub width: f64,
}

impl Default for Page {
    fn default() -> Self {
        Self {
            title: String::new(),
            subtitle: String::new(),
            rows: Vec::new(),
            notes: Vec::new(),
            width: 900.0,
        }
    }
}

/// Panels side by side.
#[derive(Clone, Debug)]
pub struct Row {
    /// Points, headings and labels included.
    height: f64,
    panels: Vec<Panel>,
}

impl Row {
    /// Panels from left to right, `height` points high.
    #[must_use]
    pub fn of(height: f64, panels: impl IntoIterator<Item = Panel>) -> Self {
        Self {
            height,
            panels: panels.into_iter().collect(),
        }
    }
}

/// Margin of the page, points.
const MARGIN: f64 = 22.0;
/// Room between panels, points.
const GAP: f64 = 28.0;
/// Line height and letters of notes, points.
const NOTE: f64 = 17.0;
const LETTERS: f64 = 12.0;
impl Page {
    /// The picture as an SVG element, and where the data of its last panel is, in the units of the SVG: x, and y from above.
    ///
    /// # Errors
    /// [`PlotError`] where it cannot be drawn; `path` is what the error names.
    pub fn svg(&self, path: &Path) -> Result<(String, [Range<i32>; 2]), PlotError> {
        for (weight, font) in [(FontStyle::Normal, SANS), (FontStyle::Bold, BOLD)] {
            register_font(FONT, weight, font)
                .map_err(|_| draw_error(path, "its font is broken"))?;
        }
        let size = (self.width as u32 * FINE, self.height() as u32 * FINE);
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        let data = self
            .paint(&area, true)
            .map_err(|reason| draw_error(path, reason))?;
        drop(area);
        let sized = |(width, height)| format!("width=\"{width}\" height=\"{height}\"");
        let (fine, points) = (sized(size), sized((size.0 / FINE, size.1 / FINE)));
        Ok((svg.replacen(&fine, &points, 1), data))
    }

    /// Saves the picture as `path.svg` and `path.png`.
    ///
    /// # Errors
    /// [`PlotError`] where a file cannot be written.
    pub fn save(&self, path: &Path) -> Result<[PathBuf; 2], PlotError> {
        let (svg, _) = self.svg(path)?;
        let svg_path = path.with_added_extension("svg");
        write(&svg_path, svg.as_bytes())?;

        let size = (self.width as u32 * FINE, self.height() as u32 * FINE);
        let mut pixels = vec![255; size.0 as usize * size.1 as usize * 3];
        self.paint(
            &BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area(),
            false,
        )
        .map_err(|reason| draw_error(path, reason))?;
        let png_path = path.with_added_extension("png");
        write(
            &png_path,
            &png(&pixels, size).map_err(|error| draw_error(&png_path, error))?,
        )?;
        Ok([svg_path, png_path])
    }

    fn height(&self) -> f64 {
        let rows: f64 = self.rows.iter().map(|row| row.height).sum();
        self.heading() + rows + NOTE * self.note_lines().len() as f64 + MARGIN
    }

    /// The notes, folded to the width of the page.
    fn note_lines(&self) -> Vec<String> {
        let most = (self.width - 2.0 * MARGIN) / (CHARACTER * LETTERS);
        let folded = |note: &String| {
            let note = note.replace(" -", " −");
            let lines = textwrap::wrap(&note, most as usize);
            lines.into_iter().map(String::from).collect::<Vec<_>>()
        };
        self.notes.iter().flat_map(folded).collect()
    }

    fn heading(&self) -> f64 {
        MARGIN
            + if self.title.is_empty() { 0.0 } else { 24.0 }
            + if self.subtitle.is_empty() { 0.0 } else { 20.0 }
    }

    /// Draws everything; where the data of the last panel is, pixels.
    fn paint<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        joins: bool,
    ) -> Result<[Range<i32>; 2], String> {
        area.fill(&WHITE).map_err(said)?;
        let pen = Pen { area, joins };
        let heads = [
            (6.0, &self.title, 17.0, true, INK),
            (29.0, &self.subtitle, 12.0, false, GREY),
        ];
        for (down, text, size, bold, color) in heads {
            let place = (MARGIN, MARGIN + down);
            pen.text(place, text, size, bold, color, HPos::Left)?;
        }
        let (mut top, mut data) = (self.heading(), [0..0, 0..0]);
        for row in &self.rows {
            let shares: f64 = row.panels.iter().map(|panel| panel.share).sum();
            let room = self.width - 2.0 * MARGIN + GAP;
            let mut left = MARGIN;
            for panel in &row.panels {
                let width = room * panel.share / shares;
                data = panel
                    .paint(&pen, left..left + width - GAP, top..top + row.height)?
                    .into();
                left += width;
            }
            top += row.height;
        }
        for (i, line) in self.note_lines().iter().enumerate() {
            let place = (MARGIN, top + NOTE * (i as f64 + 0.6));
            pen.text(place, line, LETTERS, false, INK, HPos::Left)?;
        }
        area.present().map_err(said)?;
        Ok(data)
    }
}

fn draw_error(path: &Path, reason: impl ToString) -> PlotError {
    PlotError::Draw {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), PlotError> {
    files::write(path, bytes).map_err(|error| PlotError::Write {
        path: path.to_owned(),
        error,
    })
}

/// The finely drawn pixels averaged, as a PNG.
fn png(fine: &[u8], (width, height): (u32, u32)) -> Result<Vec<u8>, png::EncodingError> {
    let (w, h) = (width / SHRINK, height / SHRINK);
    let average = |at: u32| {
        let (x, y, c) = (at / 3 % w, at / 3 / w, at % 3);
        let block = (0..SHRINK * SHRINK).map(|k| {
            let (x, y) = (SHRINK * x + k % SHRINK, SHRINK * y + k / SHRINK);
            u32::from(fine[((y * width + x) * 3 + c) as usize])
        });
        (block.sum::<u32>() / (SHRINK * SHRINK)) as u8
    };
    let pixels: Vec<u8> = (0..3 * w * h).map(average).collect();
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, w, h);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::super::axis::Axis;
    use super::super::color::{BLUE, GREY};
    use super::*;

    #[test]
    fn a_picture_is_saved_twice_and_thinning_keeps_the_extremes() {
        let folder = tempfile::tempdir().unwrap();
        let mut panel = Panel::new("x < y & z", Axis::named("time, s"), Axis::default());
        let wave = |k| (f64::from(k), if k == 7777 { 9.0 } else { 0.0 });
        let wave: Vec<_> = (0..20_000).map(wave).collect();
        panel.line("spike", BLUE, &wave);
        panel.dashed(
            "wanted",
            GREY,
            &[(0.0, f64::NAN), (1.0, 1.0), (19_000.0, 2.0)],
        );
        let page = Page {
            rows: vec![Row::of(200.0, [panel])],
            ..Page::default()
        };
        let [svg, png] = page.save(&folder.path().join("a.b")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        assert!(svg.contains("x &lt; y &amp; z") && svg.len() < 100_000);
        assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
        assert!(
            super::super::pen::thinned(&wave, 12.0)
                .iter()
                .any(|(_, y)| *y == 9.0)
        );
        let error = page.save(Path::new("/nowhere/at/all")).unwrap_err();
        assert!(matches!(error, PlotError::Write { .. }));
    }
}
