//! Ticks for a process that only reads: it is shown each tick when the messages of all its topics have come, and no process waits for it in real time.

use std::collections::VecDeque;
use std::time::Duration;

use process::Packed;

use super::ports::{From, Input};
use crate::shell::Shell;
use crate::wait::Interrupted;

/// How often it looks for messages.
const ROUND: Duration = Duration::from_millis(10);

/// Most messages of one topic that wait for those of the others. Beyond it, ticks are shown incomplete.
const MOST_WAITING: usize = 4096;

/// Messages that have come and have not been shown, by input.
#[derive(Default)]
pub(super) struct Gathered {
    waiting: Vec<VecDeque<Packed>>,
    /// Nothing more comes: the rest is shown as it is.
    has_all: bool,
}

impl Gathered {
    /// The next tick, with its messages in the inputs; `None` after the last.
    pub(super) fn wait(
        &mut self,
        shell: &Shell,
        inputs: &mut [Input],
    ) -> Result<Option<u64>, Interrupted> {
        self.waiting.resize_with(inputs.len(), VecDeque::new);
        while !(self.is_whole() || self.has_all) {
            if !shell.poll(ROUND)? {
                self.has_all = true;
                break;
            }
            shell.look()?;
            for (input, waiting) in inputs.iter_mut().zip(&mut self.waiting) {
                if let From::Collector(collector) = &mut input.from {
                    collector.collect(|message| waiting.push_back(Packed::of(message)))?;
                }
            }
        }
        let oldest = self.waiting.iter().filter_map(VecDeque::front);
        let tick = oldest.map(|message| message.header().tick).min();
        for (input, waiting) in inputs.iter_mut().zip(&mut self.waiting) {
            input.hold(waiting.pop_front_if(|message| Some(message.header().tick) == tick));
        }
        Ok(tick)
    }

    fn is_whole(&self) -> bool {
        let has_all = self.waiting.iter().all(|topic| !topic.is_empty());
        has_all || self.waiting.iter().any(|topic| topic.len() > MOST_WAITING)
    }
}
