//! The progress of long operations: a bar on the last line of a terminal and lines above it; on a pipe only the lines.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use session::Progress;

use crate::out::{set_status, tell};

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
        const CELLS: u64 = 30;
        let seconds = self.began.elapsed().as_secs_f64();
        // A run may take longer than its path: the governor slows the path's clock.
        let length = self.length.max(self.position).max(1);
        let full = (self.position * CELLS / length) as usize;
        let rate = self.position as f64 / seconds.max(1e-3);
        let digits = usize::from(rate < 10.0);
        write!(
            f,
            "{} {}{} {}/{length} {}  {rate:.digits$}/s",
            self.title,
            "█".repeat(full),
            "░".repeat(CELLS as usize - full),
            self.position,
            self.unit
        )?;
        if self.position > 0 {
            let left = (length - self.position) as f64 / rate;
            write!(f, "  {left:.0} s left")?;
        }
        Ok(())
    }
}
