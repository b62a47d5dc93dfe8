//! Two runs beside each other: how their settings, outcomes and messages differ.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};
use session::table::count;
use session::{Failure, Run};
use shared_types::job::Job;
use shared_types::summary::Summary;

use super::compared::{Place, differing, places, record_of};

/// Most characters of a value that are shown to people.
const LONGEST: usize = 80;

/// A value that two runs do not share; null in the one that lacks it.
#[derive(Serialize)]
pub struct Change {
    /// Its path: `scenario.` with the keys of `--set`, `program.` or `results.`.
    pub key: String,
    /// Of both runs.
    pub values: [Value; 2],
}

/// The differences between two runs.
#[derive(Serialize)]
pub struct Differing {
    /// Their folders.
    pub runs: [PathBuf; 2],
    /// Whether there is none, as far as both records can be read.
    pub same: bool,
    /// Of scenario, program and outcome, but for what depends on the machine.
    pub changes: Vec<Change>,
    /// Topics whose messages differ.
    pub topics: Vec<String>,
    /// The first message that differs.
    pub difference: Option<Place>,
    /// The run that kept no messages, so that hashes alone were compared.
    pub without: Option<PathBuf>,
    /// Why the messages could not be compared.
    pub remark: Option<String>,
    /// Each way in which a record is damaged or does not match its run's summary, in a clause.
    pub damage: Vec<String>,
}

/// Compares what two runs have left in their folders.
///
/// # Errors
/// [`Failure::Input`] where one of them is not the folder of a run that has ended.
pub fn diff(folders: [&Path; 2]) -> Result<Differing, Failure> {
    let read = |folder: &Path| {
        let run = Run::find(Some(folder))?;
        Ok::<_, Failure>((run.job()?, run.summary()?, run.folder))
    };
    let [first, second] = folders.map(read);
    let both = [first?, second?];
    let trees = both
        .each_ref()
        .map(|(job, summary, _)| values(job, summary));
    let changes = changes(&trees);
    let without = both.iter().find(|(job, ..)| !job.record);
    let without = without.map(|(_, _, folder)| folder.clone());
    // The records of now are compared: the hashes are of the records as they were written.
    let found = match without {
        Some(_) => Ok(Vec::new()),
        None => first_places(&both),
    };
    let mut topics = differing(both.each_ref().map(|(_, summary, _)| &summary.topics));
    topics.extend(found.iter().flatten().map(|place| place.topic.clone()));
    topics.sort();
    topics.dedup();
    let mut damage: Vec<_> = both.iter().flat_map(damage_of).collect();
    damage.dedup();
    Ok(Differing {
        same: changes.is_empty() && topics.is_empty() && found.is_ok(),
        changes,
        topics,
        without,
        remark: found.as_ref().err().map(ToString::to_string),
        damage,
        difference: found.ok().and_then(|places| places.into_iter().next()),
        runs: both.map(|(_, _, folder)| folder),
    })
}

fn damage_of((job, summary, folder): &(Job, Summary, PathBuf)) -> Vec<String> {
    let run = Run {
        folder: folder.clone(),
    };
    let (damage, _) = run.message_damage(job, Some(summary));
    let named = |clause| format!("{}: {clause}", folder.display());
    damage.into_iter().map(named).collect()
}

fn first_places(runs: &[(Job, Summary, PathBuf); 2]) -> Result<Vec<Place>, Failure> {
    let [first, second] = runs
        .each_ref()
        .map(|(job, _, folder)| record_of(folder, job));
    let (first, second) = (first?, second?);
    if first.contents.layouts() != second.contents.layouts() {
        return Err(Failure::input("their messages have different layouts"));
    }
    places(&first, &second)
}

/// The causes of a run, and how it ended.
fn values(job: &Job, summary: &Summary) -> Value {
    let robot = (&job.robot.name, &job.robot.urdf, &job.robot.description);
    json!({
        "scenario": job.scenario,
        "program": {"version": job.version, "mode": job.mode, "graph": job.graph, "robot": robot},
        "results": {"outcome": summary.outcome, "reason": summary.reason, "ticks": summary.ticks},
    })
}

/// The leaves of two trees that differ.
fn changes(trees: &[Value; 2]) -> Vec<Change> {
    fn leaves(path: &str, tree: &Value, run: usize, found: &mut BTreeMap<String, [Value; 2]>) {
        let mut below = |key: &dyn fmt::Display, tree| {
            let dot = if path.is_empty() { "" } else { "." };
            leaves(&format!("{path}{dot}{key}"), tree, run, found);
        };
        match tree {
            Value::Object(map) => map.iter().for_each(|(key, tree)| below(key, tree)),
            Value::Array(list) => list
                .iter()
                .enumerate()
                .for_each(|(i, tree)| below(&i, tree)),
            leaf => found.entry(path.to_owned()).or_default()[run] = leaf.clone(),
        }
    }
    let mut found = BTreeMap::new();
    for (run, tree) in trees.iter().enumerate() {
        leaves("", tree, run, &mut found);
    }
    found.retain(|_, [first, second]| first != second);
    let change = |(key, values)| Change { key, values };
    found.into_iter().map(change).collect()
}

impl fmt::Display for Differing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.runs.each_ref().map(|folder| folder.display());
        for Change { key, values } in &self.changes {
            let [before, after] = shown(values);
            writeln!(f, "{key}: {before} → {after}")?;
        }
        if let Some(place) = &self.difference {
            writeln!(f, "{place}")?;
        }
        // Of a record that cannot be read the remark says the same.
        let remark = self.remark.iter().filter(|_| self.damage.is_empty());
        for clause in remark.chain(&self.damage) {
            writeln!(f, "{clause}")?;
        }
        let hashes = self.without.as_ref().map_or(String::new(), |folder| {
            let folder = folder.display();
            format!(", by their recorded hashes: {folder} kept no messages")
        });
        let readable = match self.damage.is_empty() {
            true => "",
            false => ", as far as they can be read",
        };
        if self.same {
            return writeln!(
                f,
                "{first} and {second}: the same scenario, program, outcome and messages{hashes}{readable}"
            );
        }
        let [values, topics] = [self.changes.len(), self.topics.len()].map(|all| all as u64);
        let messages = match self.remark {
            Some(_) => "their messages could not be compared".to_owned(),
            None => format!("messages of {}", count(topics, "topic")),
        };
        let values = count(values, "value");
        writeln!(f, "{first} and {second} DIFFER: {values}, {messages}")
    }
}

/// Two values in a few words each, from shortly before the first character in which they differ.
fn shown(values: &[Value; 2]) -> [String; 2] {
    let texts = values.each_ref().map(|value| match value {
        Value::Null => "–".to_owned(),
        Value::String(text) => text.replace('\n', " "),
        other => other.to_string(),
    });
    let pairs = texts[0].chars().zip(texts[1].chars());
    let common = pairs.take_while(|(one, other)| one == other).count();
    let skipped = common.saturating_sub(LONGEST / 2);
    texts.map(|text| {
        let mut rest = text.chars().skip(skipped);
        let shown: String = rest.by_ref().take(LONGEST).collect();
        let before = if skipped > 0 { "… " } else { "" };
        let behind = if rest.next().is_some() { " …" } else { "" };
        format!("{before}{shown}{behind}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_differ_late_are_shown_where_they_differ() {
        let long = |end: &str| Value::String("same ".repeat(100) + end);
        let [one, other] = shown(&[long("of 1 mm"), long("of 2 mm")]);
        assert!(
            one.contains("1 mm") && other.contains("2 mm"),
            "{one} {other}"
        );
        assert!(one.chars().count() <= LONGEST + 4);
        let short = shown(&[Value::Null, json!(0.5)]);
        assert_eq!(short, ["–", "0.5"]);
    }
}
