//! The laws of a comparison: armplane's own, and controllers of others.

use std::path::Path;

use model::Robot;
use session::{Controller, Failure, load};
use shared_types::graph::Graph;
use shared_types::scenario::{Scenario, Strategy};

use crate::trial::Trial;

/// One law of a comparison.
#[derive(Clone, Debug)]
pub enum Law {
    /// armplane's own.
    Own(Strategy),
    /// A controller of others under this name.
    Other(String, Controller),
}

/// The laws of these names; all of armplane's that are compared by default where there is no name. `NAME=FILE.py` and `NAME=GRAPH.toml` are controllers of
/// others, which may take `join_limit_s` to join a run.
///
/// # Errors
/// [`Failure::Input`] where there is no such law or file.
pub fn laws(names: &[String], join_limit_s: u32) -> Result<Vec<Law>, Failure> {
    let all = || Strategy::ALL.into_iter();
    if names.is_empty() {
        return Ok(all()
            .filter(|law| law.follows_paths())
            .map(Law::Own)
            .collect());
    }
    let law = |name: &String| {
        if let Some((name, file)) = name.split_once('=') {
            let controller = Controller::new(Path::new(file), join_limit_s)?;
            return Ok(Law::Other(name.to_owned(), controller));
        }
        let known = all().map(|law| law.name());
        all()
            .find(|law| law.name() == name)
            .map(Law::Own)
            .ok_or_else(|| {
                Failure::Input(load::unknown(
                    "control law",
                    name,
                    known,
                    "or give NAME=FILE.py",
                ))
            })
    };
    names.iter().map(law).collect()
}

impl Law {
    /// Its name in tables.
    pub fn name(&self) -> &str {
        match self {
            Self::Own(law) => law.name(),
            Self::Other(name, _) => name,
        }
    }

    /// armplane's own.
    ///
    /// # Errors
    /// [`Failure::Input`] with the reason, where `what` takes no other.
    pub fn own(&self, what: &str) -> Result<Strategy, Failure> {
        match self {
            Self::Own(law) => Ok(*law),
            Self::Other(name, _) => Err(Failure::Input(format!(
                "{what} takes armplane's own laws, and {name} is a controller of others"
            ))),
        }
    }

    /// The graph of its trials; `None`: on one thread.
    pub(super) fn graph(
        &self,
        plant: Option<&str>,
        robot: &Robot,
        task: &Scenario,
    ) -> Result<Option<Graph>, Failure> {
        match self {
            Self::Own(_) => plant
                .map(|plant| session::simulated(plant, robot, task))
                .transpose(),
            Self::Other(_, controller) => {
                session::opposed(controller, plant, robot, task).map(Some)
            }
        }
    }

    /// A trial of a task in its graph.
    pub(super) fn trial<'a>(
        &self,
        robot: &'a Robot,
        task: &Scenario,
        graph: Option<&'a Graph>,
    ) -> Trial<'a> {
        let law = match self {
            Self::Own(law) => *law,
            Self::Other(..) => task.control.strategy,
        };
        Trial {
            graph,
            ..Trial::under(law, robot, task)
        }
    }
}
