//! A process saves itself, so that it can go on from there: in real time after every tick, for its replacement; in lockstep at every cut, for the
//! recorder.
//!
//! A cut at tick k is the moment at which every process has closed k − 1: the messages before it and the states at it are all that the run goes on from.
//! The message that closes the loop of k − 1 has left its writer and has not been read: it belongs to what its reader saves.

use std::path::{Path, PathBuf};

use process::{Saved, Step};
use shared_types::job::Mode;

use crate::checkpoint::{StateCell, newest};
use crate::shell::{ProcessError, Shell};

/// Ticks between two cuts.
pub const CUT_TICKS: u64 = 1000;

/// Room for a state to grow, at least; bytes.
const ROOM: usize = 4096;

/// The file of a process's cell in the directory of its run.
pub(crate) fn cell_of(run: &Path, process: &str) -> PathBuf {
    run.join(format!("checkpoint-{process}"))
}

/// The file from which a process goes on in a run that begins at a cut.
fn begin_of(run: &Path, process: &str) -> PathBuf {
    run.join(format!("cut-{process}"))
}

/// Leaves to a process what it goes on from, before it starts: what its predecessor has saved at the cut.
///
/// # Errors
/// When there is no room.
pub fn leave(run: &Path, process: &str, saved: &[u8]) -> std::io::Result<()> {
    std::fs::write(begin_of(run, process), saved)
}

/// The state that a process has saved at the cut of a tick; `None`: it has saved nothing there, or not yet.
pub(crate) fn saved_at(run: &Path, process: &str, tick: u64) -> std::io::Result<Option<Vec<u8>>> {
    let saved = newest(&cell_of(run, process))?;
    Ok(saved.filter(|saved| Saved::of(saved).is_some_and(|saved| saved.tick == tick)))
}

/// Saves a process as it goes on.
pub(crate) struct Saving {
    /// `None`: it cannot be saved.
    cell: Option<StateCell>,
    state: Vec<u8>,
    saved: Vec<u8>,
    /// Ticks between two times.
    every: u64,
    process: String,
}

impl Saving {
    /// Takes a step to where the process goes on from: in real time behind the last tick that its predecessor sent, in lockstep to the cut at which the
    /// run begins. With it the message that is carried over the cut.
    pub(crate) fn begin(
        shell: &Shell,
        step: &mut dyn Step,
    ) -> Result<(Self, Vec<u8>), ProcessError> {
        let mut saving = Self {
            cell: None,
            state: Vec::new(),
            saved: Vec::new(),
            every: match shell.mode() {
                Mode::Lockstep => CUT_TICKS,
                Mode::Realtime => 1,
            },
            process: shell.name().to_owned(),
        };
        step.save(&mut saving.state);
        let most = 2 * saving.state.len() + ROOM;
        saving.saved.reserve(most);
        let is_replaced = shell.mode() == Mode::Lockstep || !shell.makes_ticks();
        let earlier = match shell.manifest().from {
            0 if saving.state.is_empty() || !is_replaced => return Ok((saving, Vec::new())),
            0 => {
                let cell = saving.cell.insert(shell.state_cell(most)?);
                cell.previous().map(<[u8]>::to_vec)
            }
            tick => {
                saving.cell = Some(shell.state_cell(most)?);
                let path = begin_of(shell.run_dir(), shell.name());
                let saved = std::fs::read(&path).ok();
                let is_it = |saved: &Vec<u8>| Saved::of(saved).is_some_and(|one| one.tick == tick);
                let missing = || {
                    ProcessError::setup(format_args!(
                        "{}: no state of tick {tick} to go on from",
                        shell.name()
                    ))
                };
                Some(saved.filter(is_it).ok_or_else(missing)?)
            }
        };
        let Some(earlier) = earlier.as_deref().and_then(Saved::of) else {
            return Ok((saving, Vec::new()));
        };
        let damaged = |damaged| ProcessError::setup(format_args!("{}: {damaged}", shell.name()));
        step.restore(earlier.state).map_err(damaged)?;
        Ok((saving, earlier.carried.to_vec()))
    }

    /// Saves the process if it is time, before what is sent with the tick before `tick`, or, of the process that makes the ticks, is made of it.
    #[inline]
    pub(crate) fn save(
        &mut self,
        tick: u64,
        step: &dyn Step,
        carried: &[u8],
    ) -> Result<(), ProcessError> {
        match tick.is_multiple_of(self.every) {
            true => self.save_now(tick, step, carried),
            false => Ok(()),
        }
    }

    fn save_now(&mut self, tick: u64, step: &dyn Step, carried: &[u8]) -> Result<(), ProcessError> {
        let Some(cell) = &mut self.cell else {
            return Ok(());
        };
        step.save(&mut self.state);
        if self.state.is_empty() {
            return Ok(());
        }
        let state = &self.state;
        Saved {
            tick,
            state,
            carried,
        }
        .write(&mut self.saved);
        match cell.write(&self.saved) {
            true => Ok(()),
            false => Err(ProcessError::setup(format_args!(
                "the state of {} has grown to {} bytes, more than twice what it began with",
                self.process,
                state.len()
            ))),
        }
    }

    /// The state that was saved counts from now on; else it counts when the tick closes.
    pub(crate) fn commit(&self) {
        self.cell.iter().for_each(StateCell::commit);
    }
}
