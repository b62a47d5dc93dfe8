//! The past of a program without a state: at a cut it is started anew, given again what it has read from the first tick on, and its answers are compared
//! with those that it has sent.
//!
//! The launcher leaves the messages of each topic that the program reads or writes in a file of its own, one behind the other.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use process::Packed;
use shared_types::graph::Role;
use shared_types::wire::Header;

use super::error::JoinedError;
use super::ports::{Input, Output};
use crate::shell::{ProcessError, Shell};

/// The folder with these files, in that of a run's results.
pub fn past_of(results: &Path) -> PathBuf {
    results.join("messages.past")
}

/// The messages of a topic in order.
struct Tape {
    file: BufReader<File>,
    next: Packed,
    has_next: bool,
}

impl Tape {
    fn open(shell: &Shell, folder: &Path, topic: &str, bytes: usize) -> Result<Self, ProcessError> {
        let path = folder.join(topic);
        let cannot = |error| {
            ProcessError::setup(format_args!(
                "{} cannot read what `{topic}` had before tick {}: {}: {error}",
                shell.name(),
                shell.manifest().from,
                path.display()
            ))
        };
        let mut tape = Self {
            file: BufReader::with_capacity(1 << 16, File::open(&path).map_err(cannot)?),
            next: Packed::of(&vec![0; bytes]),
            has_next: true,
        };
        tape.advance();
        Ok(tape)
    }

    /// A torn message is the end.
    fn advance(&mut self) {
        self.has_next = self.has_next && self.file.read_exact(self.next.bytes_mut()).is_ok();
    }

    /// The tick of the next message.
    fn tick(&self) -> Option<u64> {
        self.has_next.then(|| self.next.header().tick)
    }

    /// The message of a tick, those before it passed over.
    fn at(&mut self, tick: u64) -> Option<&Packed> {
        while self.tick().is_some_and(|next| next < tick) {
            self.advance();
        }
        (self.tick() == Some(tick)).then_some(&self.next)
    }
}

/// The messages that a program has read and written before the cut at which the run goes on.
pub(super) struct Past {
    role: Role,
    inputs: Vec<Tape>,
    outputs: Vec<Tape>,
    /// The next tick, of the process that makes them.
    next: u64,
    /// The tick of the cut.
    end: u64,
}

impl Past {
    pub(super) fn open(
        shell: &Shell,
        folder: &Path,
        role: Role,
        inputs: &[Input],
        outputs: &[Output],
    ) -> Result<Self, ProcessError> {
        let inputs = inputs.iter().map(Input::layout);
        let outputs = outputs.iter().map(Output::layout);
        let read = |layout: &shared_types::layout::MessageLayout| {
            Tape::open(shell, folder, &layout.topic, layout.bytes)
        };
        Ok(Self {
            role,
            inputs: inputs.map(read).collect::<Result<_, _>>()?,
            outputs: outputs.map(read).collect::<Result<_, _>>()?,
            next: 0,
            end: shell.manifest().from,
        })
    }

    /// The next tick that the program was given, with its inputs; `None` at the cut, whose inputs the process that makes the ticks has then.
    pub(super) fn next(&mut self, inputs: &mut [Input]) -> Option<u64> {
        let tick = match self.role {
            Role::World => {
                let tick = self.next;
                self.next += 1;
                self.show(inputs, tick.checked_sub(1));
                (tick < self.end).then_some(tick)?
            }
            Role::Stage => {
                let tick = self.next_of_stage(inputs)?;
                self.show(inputs, Some(tick));
                tick
            }
            Role::Observer => {
                let tick = self.inputs.iter().filter_map(Tape::tick).min()?;
                self.show(inputs, Some(tick));
                tick
            }
        };
        Some(tick)
    }

    /// The next tick of which all has come that a program waits for.
    fn next_of_stage(&mut self, inputs: &[Input]) -> Option<u64> {
        let (last, others) = self.inputs.split_last_mut()?;
        loop {
            let tick = last.tick()?;
            let mut needed = others
                .iter_mut()
                .zip(inputs)
                .filter(|(_, input)| !input.is_target());
            if needed.all(|(tape, _)| tape.at(tick).is_some()) {
                return Some(tick);
            }
            last.advance();
        }
    }

    /// Shows the messages of a tick.
    fn show(&mut self, inputs: &mut [Input], tick: Option<u64>) {
        for (tape, input) in self.inputs.iter_mut().zip(inputs) {
            let message = tick.and_then(|tick| tape.at(tick)).cloned();
            if message.is_some() {
                tape.advance();
            }
            input.hold(message);
        }
    }

    /// Whether the program has answered a tick as it had.
    pub(super) fn compare(
        &mut self,
        process: &str,
        tick: u64,
        outputs: &[Output],
    ) -> Result<(), JoinedError> {
        for (tape, output) in self.outputs.iter_mut().zip(outputs) {
            let Some(sent) = tape.at(tick) else {
                continue;
            };
            if let Some(field) = output.other_than(sent.bytes()) {
                return Err(JoinedError::Differs {
                    process: process.to_owned(),
                    topic: output.topic(),
                    field,
                    tick,
                });
            }
        }
        Ok(())
    }
}

/// Bytes of a message that are not the program's.
pub(super) const HEADER: usize = size_of::<Header>();
