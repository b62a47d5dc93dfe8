//! A goal beyond reach, as the plan of the path finds it: said before the start, and where its leg has ended short of it (+).

use crate::controller::Setup;
use crate::linear::{angular, linear, served};
use crate::reference::guide::Guide;
use crate::types::Command;
use shared_types::bounds::within;

/// A goal that no posture of the arm has, found before the first tick, in words.
pub(crate) fn warning<const N: usize>(guide: &Guide<N>) -> Option<String> {
    let (leg, _) = guide.beyond_reach()?;
    Some(format!(
        "the goal of segment {leg} is beyond reach: the arm will go as far as the boundary and slide along it"
    ))
}

/// The command, marked as clipped where a leg whose goal is beyond reach has ended short of it, by more than the scenario's `goal` allows in the axes
/// that count.
#[inline]
pub(crate) fn marked<const N: usize>(command: Command<N>, setup: &Setup<N>) -> Command<N> {
    let (task, goal) = (&setup.task, &setup.scenario.goal);
    let is_over = setup
        .guide
        .beyond_reach()
        .is_some_and(|(leg, _)| command.segment as usize > leg);
    let served = served(task, &command.error);
    let arrived = within(linear(&served).norm() * 1e3, goal.position_mm)
        && within(angular(&served).norm().to_degrees(), goal.orientation_deg);
    Command {
        clipped: command.clipped || is_over && !arrived,
        ..command
    }
}
