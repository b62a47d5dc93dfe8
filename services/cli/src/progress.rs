//! The progress of long operations on a terminal: a bar on standard error, and lines above it; on a pipe only the lines.

use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};
use session::Progress;

/// Shows what an operation tells.
#[derive(Default)]
pub(crate) struct Terminal {
    bar: Mutex<Option<ProgressBar>>,
}

impl Terminal {
    /// Takes one piece of news.
    pub(crate) fn show(&self, progress: Progress<'_>) {
        let mut bar = self.bar.lock().unwrap_or_else(PoisonError::into_inner);
        match (progress, &*bar) {
            (Progress::Begin { title, length, unit }, _) => *bar = Some(begin(title, length, unit)),
            (Progress::Title(title), Some(bar)) => bar.set_message(title.to_owned()),
            (Progress::Position(position), Some(bar)) => bar.set_position(position),
            (Progress::Step, Some(bar)) => bar.inc(1),
            (Progress::Line(line), Some(bar)) => bar.suspend(|| eprintln!("{line}")),
            (Progress::Line(line), None) => eprintln!("{line}"),
            (Progress::End, Some(_)) => {
                if let Some(bar) = bar.take() {
                    bar.finish_and_clear();
                }
            }
            (_, None) => {}
        }
    }
}

fn begin(title: &str, length: u64, unit: &str) -> ProgressBar {
    let template = format!("{{msg}} {{wide_bar:.cyan/dim}} {{pos}}/{{len}} {unit}  {{per_sec}}  {{eta}}");
    let bar = ProgressBar::new(length).with_message(title.to_owned());
    ProgressStyle::with_template(&template).map_or(bar.clone(), |style| bar.with_style(style))
}
