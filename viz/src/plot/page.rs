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
use super::pen::{FINE, FONT, Pen};

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
/// Line height of notes, points.
const NOTE: f64 = 17.0;
impl Page {
    /// The picture as an SVG element.
    ///
    /// # Errors
    /// [`PlotError`] where it cannot be drawn; `path` is what the error names.
    pub fn svg(&self, path: &Path) -> Result<String, PlotError> {
        register_font(FONT, FontStyle::Normal, SANS)
            .map_err(|_| draw_error(path, "its font is broken"))?;
        register_font(FONT, FontStyle::Bold, BOLD)
            .map_err(|_| draw_error(path, "its font is broken"))?;
        let size = (self.width as u32 * FINE, self.height() as u32 * FINE);
        let mut svg = String::new();
        self.paint(
            &SVGBackend::with_string(&mut svg, size).into_drawing_area(),
            true,
        )
        .map_err(|reason| draw_error(path, reason))?;
        let fine = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
        Ok(svg.replacen(
            &fine,
            &format!("width=\"{}\" height=\"{}\"", size.0 / FINE, size.1 / FINE),
            1,
        ))
    }

    /// Saves the picture as `path.svg` and `path.png`.
    ///
    /// # Errors
    /// [`PlotError`] where a file cannot be written.
    pub fn save(&self, path: &Path) -> Result<[PathBuf; 2], PlotError> {
        let svg = self.svg(path)?;
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

    /// The rectangle of the data of a page's only panel, in the units of the SVG: x, and y from below.
    pub(crate) fn frame(&self) -> Option<[Range<u32>; 2]> {
        let row = self.rows.first()?;
        let (x, y) = row.panels.first()?.frame(
            MARGIN..self.width - MARGIN,
            self.heading()..self.heading() + row.height,
        );
        let fine = |range: Range<f64>| {
            (range.start * f64::from(FINE)) as u32..(range.end * f64::from(FINE)) as u32
        };
        Some([fine(x), fine(y)])
    }

    fn height(&self) -> f64 {
        let rows: f64 = self.rows.iter().map(|row| row.height).sum();
        self.heading() + rows + NOTE * self.notes.len() as f64 + MARGIN
    }

    fn heading(&self) -> f64 {
        MARGIN
            + if self.title.is_empty() { 0.0 } else { 24.0 }
            + if self.subtitle.is_empty() { 0.0 } else { 20.0 }
    }

    fn paint<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        joins: bool,
    ) -> Result<(), String> {
        area.fill(&WHITE).map_err(|error| error.to_string())?;
        let pen = Pen { area, joins };
        pen.text(
            (MARGIN, MARGIN + 6.0),
            &self.title,
            17.0,
            true,
            INK,
            HPos::Left,
        )?;
        pen.text(
            (MARGIN, MARGIN + 29.0),
            &self.subtitle,
            12.0,
            false,
            GREY,
            HPos::Left,
        )?;
        let mut top = self.heading();
        for row in &self.rows {
            let shares: f64 = row.panels.iter().map(|panel| panel.share).sum();
            let room = self.width - 2.0 * MARGIN + GAP;
            let mut left = MARGIN;
            for panel in &row.panels {
                let width = room * panel.share / shares;
                panel.paint(&pen, left..left + width - GAP, top..top + row.height)?;
                left += width;
            }
            top += row.height;
        }
        for (i, note) in self.notes.iter().enumerate() {
            pen.text(
                (MARGIN, top + NOTE * (i as f64 + 0.6)),
                &note.replace(" -", " −"),
                12.0,
                false,
                INK,
                HPos::Left,
            )?;
        }
        area.present().map_err(|error| error.to_string())
    }
}

fn draw_error(path: &Path, reason: impl ToString) -> PlotError {
    PlotError::Draw {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), PlotError> {
    std::fs::write(path, bytes).map_err(|error| PlotError::Write {
        path: path.to_owned(),
        error,
    })
}

/// The finely drawn pixels averaged, as a PNG.
fn png(fine: &[u8], (width, height): (u32, u32)) -> Result<Vec<u8>, png::EncodingError> {
    let (w, h, n) = (
        (width / SHRINK) as usize,
        (height / SHRINK) as usize,
        SHRINK as usize,
    );
    let mut pixels = Vec::with_capacity(w * h * 3);
    for y in 0..h {
        for x in 0..w {
            for c in 0..3 {
                let block = (0..n).flat_map(|j| {
                    (0..n).map(move |i| ((n * y + j) * width as usize + n * x + i) * 3 + c)
                });
                pixels.push(
                    (block.map(|at| u32::from(fine[at])).sum::<u32>() / (SHRINK * SHRINK)) as u8,
                );
            }
        }
    }
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, w as u32, h as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::super::axis::Axis;
    use super::super::color::BLUE;
    use super::super::pen::thinned;
    use super::*;

    #[test]
    fn a_picture_is_saved_twice_and_thinning_keeps_the_extremes() {
        let folder = tempfile::tempdir().unwrap();
        let mut panel = Panel::new("x < y & z", Axis::named("time, s"), Axis::default());
        let wave: Vec<_> = (0..20_000)
            .map(|k| (f64::from(k), if k == 7777 { 9.0 } else { 0.0 }))
            .collect();
        panel.line("spike", BLUE, &wave);
        panel.dashed(
            "wanted",
            GREY,
            &[(0.0, f64::NAN), (1.0, 1.0), (19_000.0, 2.0)],
        );
        let page = Page {
            title: "Test".to_owned(),
            rows: vec![Row::of(200.0, [panel])],
            ..Page::default()
        };
        let [svg, png] = page.save(&folder.path().join("a.b")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        assert!(
            svg.contains("x &lt; y &amp; z")
                && svg.len() < 100_000
                && svg.starts_with("<svg width=\"900\""),
            "{}",
            svg.len()
        );
        assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
        assert!(
            thinned(wave.into_iter().map(|(x, y)| (x * 0.04, y)))
                .iter()
                .any(|(_, y)| *y == 9.0)
        );
    }

    #[test]
    fn a_folder_that_is_not_there_is_said() {
        let error = Page::default()
            .save(Path::new("/nowhere/at/all"))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("cannot write /nowhere/at/all.svg"),
            "{error}"
        );
    }
}
