//! Random histories of the lockstep protocol, simulated on all cores.

use lockstep::simulation::{Defect, Outcome, history};
use session::{Failure, Observer};

use crate::pool::on_all_cores;

/// Histories that one core takes at a time.
const BATCH: u64 = 250;

/// All histories.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Simulated {
    /// How many.
    pub histories: u64,
    /// Deaths in them.
    pub deaths: u64,
    /// Steps of processes and launchers, repetitions included.
    pub steps: u64,
    /// The failures of the first histories that broke a guarantee, at most one of each [`BATCH`].
    pub failures: Vec<String>,
}

/// Runs the histories 0 to `histories` − 1 of a seed; with the number of a defect from 1 on it is put into the machine, which must be found.
///
/// # Errors
/// [`Failure::Input`] where there is no such defect.
pub fn simulate(
    seed: u64,
    histories: u64,
    defect: usize,
    observer: Observer<'_>,
) -> Result<Simulated, Failure> {
    let defect = match defect.checked_sub(1).map(|place| Defect::all().nth(place)) {
        None => Defect::None,
        Some(Some(defect)) => defect,
        Some(None) => {
            return Err(Failure::Input(format!(
                "there is no defect {defect}; there are 1 to {}",
                Defect::all().count()
            )));
        }
    };
    let batches: Vec<u64> = (0..histories.div_ceil(BATCH)).collect();
    let work = |batch: &u64| {
        let mut all = Simulated::default();
        for number in batch * BATCH..histories.min((batch + 1) * BATCH) {
            let Outcome {
                deaths,
                steps,
                failure,
            } = history(seed, number, defect);
            (all.histories, all.deaths, all.steps) =
                (all.histories + 1, all.deaths + deaths, all.steps + steps);
            all.failures.extend(failure);
            if !all.failures.is_empty() {
                break;
            }
        }
        all
    };
    let mut all = Simulated::default();
    for one in on_all_cores("histories", &batches, work, observer) {
        all.histories += one.histories;
        all.deaths += one.deaths;
        all.steps += one.steps;
        all.failures.extend(one.failures);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_histories_of_a_seed_are_the_same_on_any_number_of_cores() {
        let run = |defect| simulate(3, 2 * BATCH + 10, defect, &|_| ()).unwrap();
        let sound = run(0);
        assert_eq!(
            (sound.histories, &sound.failures, &sound),
            (2 * BATCH + 10, &Vec::new(), &run(0))
        );
        assert!(!run(1).failures.is_empty() && simulate(3, 1, 99, &|_| ()).is_err());
    }
}
