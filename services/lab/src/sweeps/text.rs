//! A sweep's outcome and its report as text for people.

use std::fmt;

use session::table::{number, table};
use viz::plot::digits;

use super::merge::Merged;
use super::outcomes::Outcomes;
use super::report::Report;
use super::work::Done;

/// The runs that have no result; nothing where all have one.
impl fmt::Display for Outcomes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            computed,
            refused,
            failed,
            reason,
            ..
        } = self;
        let runs = computed + refused + failed;
        match (refused, failed) {
            (0, 0) => Ok(()),
            (refused, 0) => writeln!(
                f,
                "refused    {refused} of {runs} runs, for example: {reason}"
            ),
            (refused, failed) => {
                writeln!(
                    f,
                    "refused    {refused} of {runs} runs; {failed} ended in a defect of this program; for example: {reason}"
                )
            }
        }
    }
}

/// Runs and their rate.
impl fmt::Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name,
            shard,
            runs,
            found,
            simulated_s,
            wall_s,
            cores,
            outcomes,
            ..
        } = self;
        let of_shard = shard
            .map(|shard| format!(", shard {shard}"))
            .unwrap_or_default();
        let before = if *found > 0 {
            format!(", {found} of them before")
        } else {
            String::new()
        };
        writeln!(f, "{name}{of_shard}: {runs} runs{before}")?;
        let computed = runs - found;
        if computed > 0 {
            let (rate, speed) = (computed as f64 / wall_s, simulated_s / wall_s);
            writeln!(
                f,
                "time       {computed} runs in {wall_s:.1} s on {cores} cores: {rate:.1} runs/s, {speed:.0} × real time"
            )?;
        }
        outcomes.fmt(f)
    }
}

impl fmt::Display for Merged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {} runs, whole", self.name, self.runs)?;
        self.outcomes.fmt(f)
    }
}

/// Outcomes, distributions, and the worst runs with their commands.
impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [runs, of] = self.runs;
        let outcomes: Vec<String> = self
            .outcomes
            .iter()
            .map(|(outcome, count)| format!("{outcome} {count}"))
            .collect();
        let counted = if runs == of {
            format!("{runs} runs")
        } else {
            format!("{runs} of {of} runs, those of complete partitions")
        };
        writeln!(f, "{}: {counted}; {}", self.name, outcomes.join(", "))?;
        if let Some(reason) = &self.refused {
            writeln!(f, "refused    for example: {reason}")?;
        }
        let mut rows = table(&["", "runs", "smallest", "median", "90 %", "99 %", "largest"]);
        for spread in &self.spreads {
            let values = spread.values.map(|value| number(digits(value)));
            rows.add_row(
                [spread.column.clone().into(), number(spread.runs)]
                    .into_iter()
                    .chain(values)
                    .collect::<Vec<_>>(),
            );
        }
        writeln!(f, "{rows}")?;
        if !self.worst.is_empty() {
            writeln!(
                f,
                "The worst by {}, each with the command that repeats it as a recording:",
                self.by
            )?;
        }
        for worst in &self.worst {
            let settings: Vec<String> = worst
                .settings
                .iter()
                .map(|(key, value)| format!("{key} = {value}"))
                .collect();
            writeln!(
                f,
                "run {}: {}, {}; {}",
                worst.run,
                digits(worst.value),
                worst.outcome,
                settings.join(", ")
            )?;
            writeln!(f, "  {}", worst.command)?;
        }
        if !self.remark.is_empty() {
            writeln!(f, "{}", self.remark)?;
        }
        writeln!(f, "\n{}", self.folder.display())?;
        writeln!(
            f,
            "  report.svg, report.png  distributions and map\n  report.json             all of this for machines"
        )?;
        Ok(())
    }
}
