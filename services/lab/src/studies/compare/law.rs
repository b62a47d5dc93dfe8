//! The laws that are compared, and a scenario under one of them.

use control::Kind;
use session::{Failure, load};
use shared_types::codes::singularity_name;
use shared_types::scenario::{Scenario, Strategy};

/// The laws of these names; all that are compared by default where there is no name.
///
/// # Errors
/// [`Failure::Input`] where there is no such law.
pub fn laws(names: &[String]) -> Result<Vec<Strategy>, Failure> {
    if names.is_empty() {
        return Ok(Strategy::ALL
            .into_iter()
            .filter(|law| law.follows_paths())
            .collect());
    }
    let law = |name: &String| {
        let known = || Strategy::ALL.iter().map(|law| law.name());
        Strategy::ALL
            .into_iter()
            .find(|law| law.name() == name)
            .ok_or_else(|| Failure::Input(load::unknown("control law", name, known(), "")))
    };
    names.iter().map(law).collect()
}

/// The same scenario under another law.
#[must_use]
pub(super) fn under(scenario: &Scenario, law: Strategy) -> Scenario {
    let mut scenario = scenario.clone();
    scenario.control.strategy = law;
    scenario
}

/// The name of the singularity that a line passes.
#[must_use]
pub fn name_of(kind: Kind) -> String {
    singularity_name(kind.code(), 0)
}
