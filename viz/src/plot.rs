//! Pictures for people: a page of panels, described once, saved as SVG and as PNG.
//!
//! ```ignore
//! let mut panel = Panel::new("position error, mm", Axis::named("time, s"), Axis::default());
//! panel.line("hand", BLUE, &[(0.0, 1.0), (1.0, 0.5)]);
//! Page { title: "A run".into(), rows: vec![Row::of(220.0, [panel])], ..Page::default() }.save(Path::new("out/run"))?;
//! ```
//!
//! * [`Page`]: title, subtitle, [`Row`]s of [`Panel`]s, and notes (the numbers) below.
//! * [`Panel`]: axes (linear, logarithmic, or names), lines, dashed lines, dots, arms as stick figures, horizontal bars, shaded bands; a legend
//!   of what has a name. `equal` gives both axes the same scale.
//! * [`numbered`]: the colours that tell several lines apart.
//!
//! Axes and marks are plotters' charts; titles and legends stand above them. Sizes are in points of the page, drawn four times as fine.

mod axis;
mod color;
mod digits;
mod page;
mod panel;
mod pen;

pub use axis::{Axis, Scale};
pub(crate) use color::rgb;
pub use color::{BLUE, Color, FAINT, GREY, INK, RED, numbered};
pub use digits::digits;
pub use page::{Page, PlotError, Row};
pub use panel::Panel;
pub(crate) use pen::thinned;
