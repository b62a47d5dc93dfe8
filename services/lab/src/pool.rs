//! Independent pieces of work on all cores, results in the order of the work.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use session::{Observer, Progress};

/// `work` on each item; which core does which does not matter to the result.
pub(crate) fn on_all_cores<T: Sync, R: Send>(
    name: &str,
    items: &[T],
    work: impl Fn(&T) -> R + Sync,
    observer: Observer<'_>,
) -> Vec<R> {
    observer(Progress::Begin {
        title: name,
        length: items.len() as u64,
        unit: "runs",
    });
    let (next, done) = (
        AtomicUsize::new(0),
        Mutex::new(Vec::with_capacity(items.len())),
    );
    let cores = thread::available_parallelism()
        .map_or(1, usize::from)
        .min(items.len());
    thread::scope(|scope| {
        for _ in 0..cores {
            scope.spawn(|| {
                while let Some((i, item)) = Some(next.fetch_add(1, Ordering::Relaxed))
                    .and_then(|i| Some((i, items.get(i)?)))
                {
                    let result = work(item);
                    done.lock()
                        .unwrap_or_else(std::sync::PoisonError::into_inner)
                        .push((i, result));
                    observer(Progress::Step);
                }
            });
        }
    });
    observer(Progress::End);
    let mut done = done
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}
