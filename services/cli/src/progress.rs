//! The progress of long operations: a bar on the last line of a terminal and lines above it; on a pipe only the lines.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use session::Progress;

use crate::out::{columns, set_status, tell};

static BAR: Mutex<Option<Bar>> = Mutex::new(None);

struct Bar {
    title: String,
    unit: &'static str,
    position: u64,
    length: u64,
    began: Instant,
}

/// Shows what an operation tells.
pub(crate) fn observe(progress: Progress<'_>) {
    let mut bar = BAR.lock().unwrap_or_else(PoisonError::into_inner);
    match (progress, bar.as_mut()) {
        (Progress::Line(line), _) => return tell(&line),
        (
            Progress::Begin {
                title,
                length,
                unit,
            },
            _,
        ) => {
            *bar = Some(Bar {
                title: title.to_owned(),
                unit,
                position: 0,
                length,
                began: Instant::now(),
            });
        }
        (Progress::Title(title), Some(bar)) => title.clone_into(&mut bar.title),
        (Progress::Position(position), Some(bar)) => bar.position = position,
        (Progress::Step, Some(bar)) => bar.position += 1,
        (Progress::End, _) => *bar = None,
        (_, None) => {}
    }
    set_status(bar.as_ref().map(ToString::to_string));
}

impl std::fmt::Display for Bar {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let seconds = self.began.elapsed().as_secs_f64();
        // A run may take longer than its path: the governor slows the path's clock.
        let length = self.length.max(self.position).max(1);
        let rate = self.position as f64 / seconds.max(1e-3);
        let digits = usize::from(rate < 10.0);
        let (title, position, unit) = (&self.title, self.position, self.unit);
        let mut numbers = format!("{position}/{length} {unit}  {rate:.digits$}/s");
        if position > 0 {
            let left = (length - position) as f64 / rate;
            numbers += &format!("  {left:.0} s left");
        }
        // The numbers come first where there is little room.
        let words = title.chars().count() + numbers.chars().count() + 3;
        let cells = columns().saturating_sub(words).min(30) as u64;
        let full = (position * cells / length) as usize;
        let (full, empty) = ("█".repeat(full), "░".repeat(cells as usize - full));
        write!(f, "{title} {full}{empty} {numbers}")
    }
}
