//! The progress of long operations on a terminal: a bar on standard error, and lines above it; on a pipe only the lines.

use std::fmt::Write;
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use session::Progress;

use crate::out::{plain, tell};

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
            (
                Progress::Begin {
                    title,
                    length,
                    unit,
                },
                _,
            ) => *bar = Some(begin(title, length, unit)),
            (Progress::Title(title), Some(bar)) => bar.set_message(plain(title).into_owned()),
            (Progress::Position(position), Some(bar)) => {
                // A run may take longer than its path: the governor slows the path's clock.
                if bar.length().is_some_and(|length| position > length) {
                    bar.set_length(position);
                }
                bar.set_position(position);
            }
            (Progress::Step, Some(bar)) => bar.inc(1),
            (Progress::Line(line), Some(bar)) => bar.suspend(|| tell(&line)),
            (Progress::Line(line), None) => tell(&line),
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
    let template =
        format!("{{msg}} {{wide_bar:.cyan/dim}} {{pos}}/{{len}} {unit}  {{rate}}/s  {{eta}}");
    let bar = ProgressBar::new(length).with_message(plain(title).into_owned());
    ProgressStyle::with_template(&template).map_or(bar.clone(), |style| {
        bar.with_style(style.with_key("rate", rate))
    })
}

/// Steps per second, whole ones where there are ten or more.
fn rate(state: &ProgressState, to: &mut dyn Write) {
    let rate = state.per_sec();
    // A progress line that cannot be written is no reason to stop.
    let _ = if rate >= 10.0 {
        write!(to, "{rate:.0}")
    } else {
        write!(to, "{rate:.1}")
    };
}
