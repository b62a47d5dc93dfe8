//! A picture with its numbers.

use serde_json::Value;
use viz::plot::Page;

/// A figure with its numbers.
pub struct Figure {
    /// `fig4`.
    pub name: &'static str,
    /// The picture.
    pub page: Page,
    /// Its numbers.
    pub numbers: Value,
}
