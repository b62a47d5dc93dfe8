//! The operator's pure step: the target in force at a tick.

use shared_types::scenario::Servo;
use shared_types::target_file::Row;
use shared_types::{Header, SensorSample, Target, TargetContent};

/// The targets of a session, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle {
    /// In the order of their ticks.
    rows: Vec<Row>,
    /// The first that is still to come.
    next: usize,
    held: TargetContent,
}

impl Cycle {
    /// At the start of a session with checked text; without text, there are no targets.
    pub fn new(session: &Servo, rate_hz: u32) -> Self {
        Self {
            rows: session.rows(rate_hz),
            next: 0,
            held: TargetContent::default(),
        }
    }

    /// Takes a target that comes while the session lasts: it is in force from the next step on.
    pub fn feed(&mut self, target: &TargetContent) {
        self.held = *target;
    }

    /// The target at the tick of a sample: the last one that is due. A fresh cycle gives the same
    /// at any tick. No allocation.
    pub fn step(&mut self, sample: &SensorSample, out: &mut Target) {
        let tick = sample.header.tick;
        while let Some(row) = self.rows.get(self.next).filter(|row| row.tick <= tick) {
            self.held = row.target;
            self.next += 1;
        }
        *out = Target {
            header: Header {
                tick,
                ..Header::default()
            },
            target: self.held,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_holds_until_the_next_one() {
        let targets = "# armplane targets 1, length m\n0.002, twist, base, 1, 1 0 0 0 0 0\n0.002, twist, base, 1, 2 0 0 0 0 0\n0.004, end\n";
        let session = Servo {
            targets: targets.to_owned(),
            ..Servo::default()
        };
        let at = |cycle: &mut Cycle, tick: u64| {
            let (mut sample, mut out) = (SensorSample::default(), Target::default());
            sample.header.tick = tick;
            cycle.step(&sample, &mut out);
            out.target
        };
        let mut cycle = Cycle::new(&session, 1000);
        let all: Vec<_> = (0..6).map(|tick| at(&mut cycle, tick)).collect();
        assert_eq!(
            all.iter()
                .map(|target| (target.kind, target.twist[0]))
                .collect::<Vec<_>>(),
            [(0, 0.0), (0, 0.0), (1, 2.0), (1, 2.0), (4, 0.0), (4, 0.0)]
        );
        assert_eq!(
            at(&mut Cycle::new(&session, 1000), 3),
            all[3],
            "a replacement goes on where its predecessor was"
        );
    }
}
