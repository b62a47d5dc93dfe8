//! A process whose steps are done in another language: the loop of [`drive`](crate::drive()), turned inside out.
//!
//! The program asks for a tick ([`Joined::wait`]), reads inputs, fills outputs, and sends them ([`Joined::send`]). Outputs are private memory until all of
//! them have been checked: nothing half-written, and no NaN, reaches a topic.

mod error;
mod gathered;
mod kept;
mod past;
mod ports;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use process::{Damaged, Saved};
use shared_types::graph::{Process, Role};
use shared_types::job::{Job, Mode};
use shared_types::task_end::TaskEnd;

use crate::control_page::Patience;
use crate::saving::Saving;
use crate::shell::{ProcessError, Shell};
use crate::tick_source::TickSource;

pub use error::JoinedError;

pub use ports::{Input, Output};

pub use past::past_of;

use gathered::Gathered;
use past::Past;

/// Time for an answer where the graph gives none.
const USUAL_LIMIT: Duration = Duration::from_secs(10);

/// Most bytes of a program's state.
const MOST_STATE: usize = 1 << 20;

/// A process that has joined its run, for a program in any language.
pub struct Joined {
    shell: Shell,
    role: Role,
    inputs: Vec<Input>,
    outputs: Vec<Output>,
    /// Of a process that only reads: the messages whose tick is not whole yet.
    gathered: Gathered,
    source: Option<Source>,
    /// The tick that the program has been given and has not answered.
    in_hand: Option<u64>,
    /// The run is over for this process.
    is_over: bool,
    has_begun: bool,
    /// The state after the tick in hand, and whether the program has given one.
    state: (Vec<u8>, bool),
    /// The state that a predecessor has left.
    previous: Option<Vec<u8>>,
    /// The messages that come again, of a program that has left none.
    past: Option<Past>,
    saving: Saving,
    patience: Arc<Patience>,
}

/// Of the process that makes the ticks.
struct Source {
    ticks: TickSource,
    end: TaskEnd,
    /// The program has ended the task with the outputs that wait for their time.
    is_last: bool,
}

impl Joined {
    /// Joins a run, by default the one that started this program, under the name that its graph gives it.
    ///
    /// # Errors
    /// [`JoinedError`] if the run cannot be used, or has no such process.
    pub fn join(run: Option<&Path>, name: Option<&str>) -> Result<Self, JoinedError> {
        let shell = Shell::of_others(run, name)?;
        let job = shell.job()?;
        let missing = || ProcessError::setup(format_args!("the graph lacks {}", shell.name()));
        let process = job.graph.process(shell.name()).ok_or_else(missing)?;
        let role = process.role();
        let (inputs, outputs) = ports::open(&shell, &job.graph, process)?;
        let source = (role == Role::World).then(|| Source {
            ticks: shell.tick_source(shell.manifest().from),
            end: TaskEnd::of(&job.scenario),
            is_last: false,
        });
        let most = MOST_STATE + kept::most(&inputs, &outputs);
        let (saving, earlier) = Saving::open(&shell, most)?;
        let patience = shell.patience();
        patience.limit(shell.name(), role == Role::Observer, limit(process));
        let mut joined = Self {
            role,
            inputs,
            outputs,
            gathered: Gathered::default(),
            source,
            in_hand: None,
            is_over: false,
            has_begun: false,
            state: (Vec::new(), false),
            previous: None,
            past: None,
            saving,
            patience,
            shell,
        };
        if let Some(earlier) = earlier.as_deref().and_then(Saved::of) {
            joined.go_on(earlier.state, &job)?;
        }
        Ok(joined)
    }

    /// Goes on from what a predecessor has saved: nothing, where it had no state.
    fn go_on(&mut self, saved: &[u8], job: &Job) -> Result<(), ProcessError> {
        let Self {
            shell,
            inputs,
            outputs,
            ..
        } = self;
        if saved.is_empty() {
            self.past = Some(Past::open(
                shell,
                &past_of(&job.out),
                self.role,
                inputs,
                outputs,
            )?);
            return Ok(());
        }
        let other = || ProcessError::setup(format_args!("{}: {}", shell.name(), Damaged::Content));
        let ((phase, refused), state) = kept::read(saved, inputs, outputs).ok_or_else(other)?;
        if let Some(source) = &mut self.source {
            source.end.resume(phase, refused);
        }
        self.previous = Some(state);
        Ok(())
    }

    /// Leaves the run, and tells a process that stands for this one, and why it could not go on; nothing: it could.
    pub fn leave(self, why: &str) {
        let stand_in = self.shell.stand_in();
        drop(self);
        if let Some(stand_in) = stand_in {
            crate::stand_in::part(&stand_in, why);
        }
    }

    /// The shell of the process.
    pub fn shell(&self) -> &Shell {
        &self.shell
    }

    /// The topics that it reads.
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// The topics that it reads, to be copied or not.
    pub fn inputs_mut(&mut self) -> &mut [Input] {
        &mut self.inputs
    }

    /// The topics that it writes.
    pub fn outputs(&self) -> &[Output] {
        &self.outputs
    }

    /// The topics that it writes, to be filled.
    pub fn outputs_mut(&mut self) -> &mut [Output] {
        &mut self.outputs
    }

    /// Calls `look` at least every 25 ms of every wait from now on; where it returns false, the wait ends with [`Interrupted::Asked`](crate::Interrupted).
    pub fn look_out(&self, look: impl FnMut() -> bool + 'static) {
        self.shell.shared.look_out.call(look);
    }

    /// The state that a predecessor has left: in real time after the last tick that it answered, in lockstep at the cut from which the run goes on.
    pub fn previous(&self) -> Option<&[u8]> {
        self.previous.as_deref()
    }

    /// Waits for the next tick; `None` when the run is over for this process.
    ///
    /// # Errors
    /// [`JoinedError`]: the graph breaks, an output has not been declared, or the tick before has not been answered.
    pub fn wait(&mut self) -> Result<Option<u64>, JoinedError> {
        if let Some(tick) = self.in_hand {
            return Err(JoinedError::Unanswered(self.named(), tick));
        }
        if self.is_over {
            return Ok(None);
        }
        if !std::mem::replace(&mut self.has_begun, true)
            && let Some(output) = self.outputs.iter().find(|output| !output.is_used())
        {
            return Err(JoinedError::Unwritten(self.named(), output.topic()));
        }
        let tick = match self.wait_again() {
            Some(tick) => tick,
            None => match self.role {
                Role::World => self.wait_as_world()?,
                Role::Stage => self.wait_as_stage()?,
                Role::Observer => self
                    .gathered
                    .wait(&self.shell, &mut self.inputs)
                    .map_err(ProcessError::from)?,
            },
        };
        (self.in_hand, self.is_over) = (tick, tick.is_none());
        self.state.1 = false;
        if let Some(tick) = tick {
            self.patience.begin(tick);
            if self.role == Role::Observer {
                self.shell.shared.entry().show(tick);
            }
        }
        Ok(tick)
    }

    /// Answers the tick in hand: checks all outputs, then sends them. `is_last`, of the process that makes the ticks: the task is over with them.
    ///
    /// # Errors
    /// [`JoinedError`]: no tick is in hand, a number is not finite, or the state is too large. Nothing has been sent then.
    pub fn send(&mut self, is_last: bool) -> Result<(), JoinedError> {
        let Some(tick) = self.in_hand.take() else {
            return Err(JoinedError::NothingAsked(self.named()));
        };
        self.patience.end();
        let checked = self.outputs.iter().find_map(Output::not_finite);
        if let Some((topic, field)) = checked {
            self.is_over = true;
            let process = self.named();
            return Err(JoinedError::NotFinite {
                process,
                topic,
                field,
                tick,
            });
        }
        if let Some(past) = &mut self.past {
            return past.compare(self.shell.name(), tick, &self.outputs);
        }
        if self.state.0.len() > MOST_STATE {
            return Err(JoinedError::State(self.named(), self.state.0.len()));
        }
        match &mut self.source {
            // They wait for their time.
            Some(source) => source.is_last = is_last,
            None => {
                self.save(tick + 1, (0, 0))?;
                self.send_outputs(tick)?;
            }
        }
        if self.role == Role::Observer {
            self.saving.commit();
        }
        Ok(())
    }

    /// Whether a state that is given for the tick in hand is kept.
    pub fn keeps(&self) -> bool {
        let next = self.in_hand.map(|tick| tick + 1);
        self.past.is_none() && next.is_some_and(|next| self.saving.is_due(next))
    }

    /// Saves the program if it is time. Without a state of its own it is given its past again.
    fn save(&mut self, next: u64, end: (u32, u64)) -> Result<(), ProcessError> {
        let (state, is_given) = &self.state;
        let is_cut = self.shell.mode() == Mode::Lockstep;
        if !self.saving.is_due(next) || !(is_cut || *is_given) {
            return Ok(());
        }
        let (inputs, outputs) = (&self.inputs, &self.outputs);
        self.saving.save_now(next, &[], |out| {
            if *is_given {
                kept::write(out, end, inputs, outputs, state);
            }
        })
    }

    /// Gives the state after the tick in hand, with which a replacement goes on.
    pub fn keep(&mut self, state: &[u8]) {
        self.state.0.clear();
        self.state.0.extend_from_slice(state);
        self.state.1 = true;
    }

    fn named(&self) -> String {
        self.shell.name().to_owned()
    }

    fn send_outputs(&mut self, tick: u64) -> Result<(), ProcessError> {
        for output in &mut self.outputs {
            output.send(tick)?;
        }
        Ok(())
    }

    /// The next tick of those that come again; `None`: none does, or no more.
    fn wait_again(&mut self) -> Option<Option<u64>> {
        let past = self.past.as_mut()?;
        if self.shell.is_stopping() {
            return Some(None);
        }
        let tick = past.next(&mut self.inputs);
        if let Some(source) = &mut self.source {
            source.end.take(self.inputs.iter().find_map(Input::phase));
        }
        if tick.is_none() {
            self.past = None;
        }
        tick.map(Some)
    }

    /// The outputs of the tick before leave when their time has come; then what closes the loop is taken in, and the next tick made at once.
    fn wait_as_world(&mut self) -> Result<Option<u64>, ProcessError> {
        let Some(mut source) = self.source.take() else {
            return Ok(None);
        };
        let tick = self.next_of_world(&mut source);
        self.source = Some(source);
        tick
    }

    fn next_of_world(&mut self, source: &mut Source) -> Result<Option<u64>, ProcessError> {
        if !self.shell.shared.has_started.get() {
            let goes_on = source.ticks.begin()?;
            return Ok(goes_on.then(|| source.ticks.coming()));
        }
        let Some(tick) = source.ticks.next()? else {
            return Ok(None);
        };
        self.send_outputs(tick)?;
        for input in &mut self.inputs {
            input.arriving(tick, source.ticks.deadline_ns())?;
        }
        source.end.take(self.inputs.iter().find_map(Input::phase));
        if source.is_last || source.end.is_over(tick + 1) {
            source.ticks.finish()?;
            return Ok(None);
        }
        let tick = source.ticks.coming();
        self.save(tick, source.end.saved())?;
        self.saving.commit();
        Ok(Some(tick))
    }

    /// The last topic that the graph lists comes last, for it lists them in the order of the data: it is waited for, and the others are there.
    fn wait_as_stage(&mut self) -> Result<Option<u64>, ProcessError> {
        let Some((last, others)) = self.inputs.split_last_mut() else {
            return Ok(None);
        };
        'ticks: while let Some(tick) = last.next()? {
            for input in others.iter_mut() {
                if !input.of_tick(tick)? {
                    continue 'ticks;
                }
            }
            return Ok(Some(tick));
        }
        Ok(None)
    }
}

fn limit(process: &Process) -> Duration {
    match process.answer_limit_s {
        0 => USUAL_LIMIT,
        limit_s => Duration::from_secs(u64::from(limit_s)),
    }
}
