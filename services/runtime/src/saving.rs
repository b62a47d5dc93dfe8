//! A process saves itself, so that it can go on from there: in real time after every tick, for its replacement; in lockstep at every cut, for the
//! recorder.
//!
//! A cut at tick k is the moment at which every process has closed k − 1: the messages before it and the states at it are all that the run goes on from.
//! The message that closes the loop of k − 1 has left its writer and has not been read: it belongs to what its reader saves.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use process::{CUT_TICKS, Saved, Step};
use shared_types::job::Mode;

use crate::checkpoint::{StateCell, newest};
use crate::shell::{ProcessError, Shell};

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
    /// `None`: nobody needs its state.
    cell: Option<Rc<StateCell>>,
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
        let mut state = Vec::new();
        step.save(&mut state);
        let (saving, earlier) = Self::open(shell, 2 * state.len() + ROOM)?;
        let Some(earlier) = earlier.as_deref().and_then(Saved::of) else {
            return Ok((saving, Vec::new()));
        };
        let damaged = |damaged| ProcessError::setup(format_args!("{}: {damaged}", shell.name()));
        step.restore(earlier.state).map_err(damaged)?;
        Ok((saving, earlier.carried.to_vec()))
    }

    /// Room for states of at most so many bytes, and what the process goes on from: the bytes of a [`Saved`].
    pub(crate) fn open(
        shell: &Shell,
        most: usize,
    ) -> Result<(Self, Option<Vec<u8>>), ProcessError> {
        let (is_lockstep, from) = (shell.mode() == Mode::Lockstep, shell.manifest().from);
        let mut saving = Self {
            cell: None,
            saved: Vec::new(),
            every: if is_lockstep { CUT_TICKS } else { 1 },
            process: shell.name().to_owned(),
        };
        // In real time nothing follows the process that makes the ticks, and one that only reads begins anew.
        if !is_lockstep && (shell.own().makes_ticks || shell.own().is_polled()) {
            return Ok((saving, None));
        }
        saving.saved.reserve(most);
        let (cell, earlier) = shell.state_cell(most)?;
        saving.cell = Some(cell);
        if from == 0 {
            return Ok((saving, earlier));
        }
        let saved = std::fs::read(begin_of(shell.run_dir(), shell.name())).ok();
        let is_it = |saved: &Vec<u8>| Saved::of(saved).is_some_and(|one| one.tick == from);
        let missing = || {
            ProcessError::setup(format_args!(
                "{}: no state of tick {from} to go on from",
                shell.name()
            ))
        };
        match saved.filter(is_it) {
            // One that only reads may have joined later.
            None if !shell.own().is_polled() => Err(missing()),
            saved => Ok((saving, saved)),
        }
    }

    /// Whether what is saved before a tick is kept.
    #[inline]
    pub(crate) fn is_due(&self, tick: u64) -> bool {
        self.cell.is_some() && tick.is_multiple_of(self.every)
    }

    /// Saves the process if it is time, before what is sent with the tick before `tick`, or, of the process that makes the ticks, is made of it.
    #[inline]
    pub(crate) fn save(
        &mut self,
        tick: u64,
        step: &dyn Step,
        carried: &[u8],
    ) -> Result<(), ProcessError> {
        match self.is_due(tick) {
            true => self.save_now(tick, carried, |state| step.save(state)),
            false => Ok(()),
        }
    }

    /// Saves the state that `state` appends.
    pub(crate) fn save_now(
        &mut self,
        tick: u64,
        carried: &[u8],
        state: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), ProcessError> {
        let Some(cell) = &self.cell else {
            return Ok(());
        };
        Saved::write(tick, carried, &mut self.saved, state);
        match cell.write(&self.saved) {
            true => Ok(()),
            false => Err(ProcessError::setup(format_args!(
                "the state of {} has grown to {} bytes, for which there is no room",
                self.process,
                self.saved.len()
            ))),
        }
    }

    /// The state that was saved counts from now on; else it counts when the tick closes.
    pub(crate) fn commit(&self) {
        self.cell.iter().for_each(|cell| cell.commit());
    }
}
