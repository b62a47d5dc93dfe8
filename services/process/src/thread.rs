//! A list of steps on one thread, without shared memory: the same bytes as the processes.

use shared_types::fault::ScheduledFault;

use crate::edges::{Edges, Ended, Now};
use crate::member::{Board, Member, Sink};
use crate::saved::{NamedSaved, Saved};
use crate::scratch::Scratch;
use crate::snapshot::Damaged;
use crate::step::Flow;

/// Processes on one thread, in the order of the data.
pub struct Thread {
    members: Vec<Member>,
    /// The run's, of which a fault's `process` is the place in the graph.
    faults: Vec<ScheduledFault>,
    /// Those of sensors and drives in force at the tick in hand.
    in_force: Vec<ScheduledFault>,
    /// Present if faults concern processes or messages.
    edges: Option<Edges>,
    scratch: Scratch,
    tick: u64,
}

impl Thread {
    /// Before the first tick.
    #[must_use]
    pub fn new(members: Vec<Member>, faults: Vec<ScheduledFault>) -> Self {
        let is_of_joint =
            |fault: &ScheduledFault| fault.kind().is_some_and(|kind| kind.concerns_joint());
        Self {
            edges: (!faults.iter().all(is_of_joint)).then(|| Edges::new(&members, &faults)),
            // No tick allocates.
            in_force: Vec::with_capacity(faults.len()),
            members,
            faults,
            scratch: Scratch::default(),
            tick: 0,
        }
    }

    /// One tick of all of them, on the messages of `board`, in place; `false` when the task is over, before anything of the tick is sent. Each message
    /// that counts is given to `sink` with the place of its topic in [`TOPICS`].
    ///
    /// # Errors
    /// [`Ended`]: a fault has ended the run.
    pub fn tick(&mut self, board: &mut Board, sink: Sink<'_>) -> Result<bool, Ended> {
        let tick = self.tick;
        self.in_force.clear();
        let is_in_force = |fault: &&ScheduledFault| {
            fault.concerns(tick) && fault.kind().is_some_and(|kind| kind.concerns_joint())
        };
        self.in_force.extend(self.faults.iter().filter(is_in_force));
        for (me, member) in self.members.iter_mut().enumerate() {
            let faults: &[ScheduledFault] = if member.makes_ticks {
                &self.in_force
            } else {
                &[]
            };
            let flow = match &mut self.edges {
                Some(edges) => {
                    let scratch = &mut self.scratch;
                    edges.step(
                        member,
                        &mut Now {
                            me,
                            tick,
                            faults,
                            board,
                            scratch,
                            sink,
                        },
                    )?
                }
                None => {
                    let flow = member.step_in_place(tick, faults, board, &mut self.scratch);
                    if flow == Flow::Go {
                        member.show(board, sink);
                    }
                    flow
                }
            };
            if flow == Flow::Over {
                return Ok(false);
            }
        }
        self.tick += 1;
        Ok(true)
    }

    /// The tick that comes next.
    #[must_use]
    pub fn next_tick(&self) -> u64 {
        self.tick
    }

    /// The states of its processes before the tick that comes next, by their names, with the messages of the last tick on `board`. Without faults of
    /// processes and messages.
    pub fn save(&self, board: &mut Board) -> Vec<NamedSaved> {
        let parts = board.parts_mut();
        let save = |member: &Member| {
            let carries = member.makes_ticks && self.tick > 0;
            let carried = member.reads.first().filter(|_| carries);
            let carried = carried.and_then(|read| parts[read.topic].as_deref());
            let mut saved = Vec::new();
            let carried = carried.unwrap_or_default();
            Saved::write(self.tick, carried, &mut saved, |out| member.step.save(out));
            (member.name.clone(), saved)
        };
        self.members.iter().map(save).collect()
    }

    /// Goes on from what its processes have saved.
    ///
    /// # Errors
    /// [`Damaged`] if one has not been saved, or is not what was.
    pub fn restore(&mut self, saved: &[NamedSaved], board: &mut Board) -> Result<(), Damaged> {
        let mut parts = board.parts_mut();
        for member in &mut self.members {
            let own = saved.iter().find(|(name, _)| *name == member.name);
            let own = own
                .and_then(|(_, saved)| Saved::of(saved))
                .ok_or(Damaged::Content)?;
            member.step.restore(own.state)?;
            self.tick = own.tick;
            let place = member
                .reads
                .first()
                .and_then(|read| parts[read.topic].as_mut());
            if let Some(place) = place.filter(|place| place.len() == own.carried.len()) {
                place.copy_from_slice(own.carried);
            }
        }
        Ok(())
    }

    /// Why the task cannot be done, found before the first tick, in words.
    #[must_use]
    pub fn obstacle(&self) -> Option<&str> {
        self.members
            .iter()
            .find_map(|member| member.step.obstacle())
    }

    /// A warning to its user, found before the first tick, in words.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        self.members.iter().find_map(|member| member.step.warning())
    }
}
