//! The step of a process.

use crate::port::{Inputs, Outputs, Port};
use crate::snapshot::{Damaged, Snapshot, restore, save};

/// Whether the run goes on after a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Flow {
    /// The outputs leave, and the next tick follows.
    Go,
    /// The task is over: no output of this step leaves. For the process that makes the ticks.
    Over,
}

/// A process: what it reads and writes, and what it does at a tick.
///
/// `self` is set-up that never changes, `State` is all that survives a tick: two steps from equal states on equal inputs have equal outputs, bit for bit.
///
/// ```
/// use process::{Flow, Inputs, Outputs, Port, Process, Running};
/// use shared_types::{MAX_DOF, StateEstimate, wire::{Header, wire}};
///
/// wire! {
///     /// The fastest joint so far.
///     Fastest on "fastest" version 1 {
///         /// Tick, incarnation, stamps.
///         header: Header,
///         /// Its speed; rad/s.
///         speed: f64,
///     }
/// }
///
/// struct Watch;
///
/// impl Process for Watch {
///     type State = Fastest;
///     const READS: &[Port] = &[Port::of::<StateEstimate>()];
///     const WRITES: &[Port] = &[Port::of::<Fastest>()];
///     fn step(&self, state: &mut Fastest, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
///         if let Some(estimate) = inputs.get::<StateEstimate>() {
///             state.speed = estimate.qdot.iter().fold(state.speed, |most, rate| most.max(rate.abs()));
///         }
///         outputs.put(state);
///         Flow::Go
///     }
/// }
///
/// let process = Running::new(Watch, Fastest::default());
/// ```
pub trait Process {
    /// All that survives a tick.
    type State: Snapshot;

    /// The topics that it reads. A message of the first begins its step.
    const READS: &'static [Port];

    /// The topics that it writes, in the order in which their messages leave.
    const WRITES: &'static [Port];

    /// One tick: every input that is needed is there. No allocation after the first tick, and no panic, whatever the messages say.
    fn step(&self, state: &mut Self::State, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>)
    -> Flow;

    /// Why its task cannot be done, found before the first tick, in words.
    fn obstacle(&self) -> Option<&str> {
        None
    }

    /// A warning to its user, found before the first tick, in words.
    fn warning(&self) -> Option<String> {
        None
    }
}

/// A process with its state, whatever their types.
pub trait Step {
    /// See [`Process::READS`].
    fn reads(&self) -> &'static [Port];
    /// See [`Process::WRITES`].
    fn writes(&self) -> &'static [Port];
    /// See [`Process::step`].
    fn step(&mut self, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow;
    /// Appends the state, with its layout and checksum.
    fn save(&self, out: &mut Vec<u8>);
    /// Goes on from a state that [`save`](Self::save) has written.
    ///
    /// # Errors
    /// [`Damaged`]: the state stays as it is.
    fn restore(&mut self, from: &[u8]) -> Result<(), Damaged>;
    /// See [`Process::obstacle`].
    fn obstacle(&self) -> Option<&str>;
    /// See [`Process::warning`].
    fn warning(&self) -> Option<String>;
}

/// A process and its state.
#[derive(Clone, Debug)]
pub struct Running<P: Process> {
    process: P,
    state: P::State,
}

impl<P: Process> Running<P> {
    /// A process with its state before the first tick.
    pub fn new(process: P, state: P::State) -> Self {
        Self { process, state }
    }
}

impl<P: Process> From<(P, P::State)> for Running<P> {
    fn from((process, state): (P, P::State)) -> Self {
        Self { process, state }
    }
}

impl<P: Process> Step for Running<P> {
    fn reads(&self) -> &'static [Port] {
        P::READS
    }
    fn writes(&self) -> &'static [Port] {
        P::WRITES
    }
    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        self.process.step(&mut self.state, inputs, outputs)
    }
    fn save(&self, out: &mut Vec<u8>) {
        save(&self.state, out);
    }
    fn restore(&mut self, from: &[u8]) -> Result<(), Damaged> {
        restore(&mut self.state, from)
    }
    fn obstacle(&self) -> Option<&str> {
        self.process.obstacle()
    }
    fn warning(&self) -> Option<String> {
        self.process.warning()
    }
}
