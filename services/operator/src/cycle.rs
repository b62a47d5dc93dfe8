//! The operator's pure step: the target in force at a tick.

use process::{Flow, Inputs, Outputs, Port, Process, Running};
use shared_types::scenario::Servo;
use shared_types::target_file::Row;
use shared_types::wire::wire;
use shared_types::{SensorSample, Target, TargetContent};

/// The targets of a session, tick by tick.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    /// In the order of their ticks.
    rows: Vec<Row>,
}

wire! {
    /// The operator between two ticks.
    OperatorState checkpoint version 1 {
        /// How many rows of the session have come.
        next: u64,
        /// The target in force.
        held: TargetContent,
    }
}

impl Cycle {
    /// At the start of a session with checked text; without text, there are no targets.
    pub(crate) fn begin(session: &Servo, rate_hz: u32) -> Running<Self> {
        let rows = session.rows(rate_hz);
        Running::new(Self { rows }, OperatorState::default())
    }
}

impl Process for Cycle {
    type State = OperatorState;
    /// A target that comes from outside, while the session lasts, is in force from its tick on.
    const READS: &'static [Port] = &[Port::of::<SensorSample>()];
    const WRITES: &'static [Port] = &[Port::of::<Target>()];

    /// The target at the tick of a sample: the last one that is due.
    fn step(
        &self,
        state: &mut OperatorState,
        inputs: &Inputs<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Flow {
        if let Some(given) = inputs.get::<Target>() {
            state.held = given.target;
        }
        let tick = inputs.tick;
        let row = |next: u64| self.rows.get(next as usize).filter(|row| row.tick <= tick);
        while let Some(row) = row(state.next) {
            state.held = row.target;
            state.next += 1;
        }
        outputs.put(&Target {
            target: state.held,
            ..Target::default()
        });
        Flow::Go
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use process::{Scratch, Step};
    use shared_types::Message;

    #[test]
    fn a_target_holds_until_the_next_one() {
        let targets = "# armplane targets 1, length m\n0.002, twist, base, 1, 1 0 0 0 0 0\n0.002, twist, base, 1, 2 0 0 0 0 0\n0.004, end\n";
        let session = Servo {
            targets: targets.to_owned(),
            ..Servo::default()
        };
        let at = |cycle: &mut Running<Cycle>, tick: u64| {
            let (mut out, mut scratch) = (Target::default(), Scratch::default());
            let mut outputs = Outputs::new(&mut scratch);
            outputs.add(Target::TOPIC, bytemuck::bytes_of_mut(&mut out));
            let _ = cycle.step(&Inputs::of(tick, &[]), &mut outputs);
            out.target
        };
        let mut cycle = Cycle::begin(&session, 1000);
        let all: Vec<_> = (0..6).map(|tick| at(&mut cycle, tick)).collect();
        assert_eq!(
            all.iter()
                .map(|target| (target.kind, target.twist[0]))
                .collect::<Vec<_>>(),
            [(0, 0.0), (0, 0.0), (1, 2.0), (1, 2.0), (4, 0.0), (4, 0.0)]
        );
        assert_eq!(
            at(&mut Cycle::begin(&session, 1000), 3),
            all[3],
            "a replacement goes on where its predecessor was"
        );
    }
}
