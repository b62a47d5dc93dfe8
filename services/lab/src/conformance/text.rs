//! The results of `verify` and `replay` as text for people, and as JSON.

use std::fmt;

use message_log::{Difference, FieldDifference};
use serde_json::{Value, json};
use session::table::{number, table};
use shared_types::job::Job;
use shared_types::scenario::Scenario;
use shared_types::summary::TopicSummary;
use viz::plot::digits;

use super::outputs::Topic;
use super::replay::Replayed;
use super::verify::{Place, Ran, Verified};

/// The runs of `verify`, compared.
pub struct VerifiedText<'a> {
    /// That was run.
    pub scenario: &'a Scenario,
    /// The result.
    pub verified: &'a Verified,
}

/// Why the first run is the reference, where it is.
const WHY: &str = "one thread cannot have the death of the plant, a fault of the recorder, or a program of the graph's own:\n\
                   run 1 is the reference of the others";

impl fmt::Display for VerifiedText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            scenario,
            verified:
                Verified {
                    reference,
                    runs,
                    place,
                    is_identical,
                },
        } = self;
        let mut hashes = table(&["topic", "messages", "hash of the contents in the reference"]);
        for (name, topic) in &reference.ran.topics {
            hashes.add_row([name.into(), number(topic.count), topic.hash.clone().into()]);
        }
        writeln!(f, "{hashes}")?;
        let mut rows = table(&["", "condition", "ticks/s", "topics"]);
        let mut row = |name: String, ran: &Ran, topics: String| {
            rows.add_row([
                name.into(),
                ran.condition.clone().into(),
                number(format!("{:.0}", ran.ticks_per_s)),
                topics.into(),
            ]);
        };
        let (name, first) = if reference.is_run {
            ("run 1, reference", 2)
        } else {
            ("reference", 1)
        };
        row(name.to_owned(), &reference.ran, String::new());
        for (number, ran) in (first..).zip(runs) {
            let others = ran
                .topics
                .iter()
                .filter(|topic| !reference.ran.topics.contains(topic))
                .map(|(name, _)| name.as_str());
            let missing = reference
                .ran
                .topics
                .iter()
                .filter(|(name, _)| ran.topics.iter().all(|(one, _)| one != name));
            let others: Vec<_> = others
                .chain(missing.map(|(name, _)| name.as_str()))
                .collect();
            let topics = if others.is_empty() {
                "all equal".to_owned()
            } else {
                format!("≠ {}", others.join(", "))
            };
            row(format!("run {number}"), ran, topics);
        }
        writeln!(f, "{rows}")?;
        let all = reference
            .is_run
            .then_some(&reference.ran)
            .into_iter()
            .chain(runs);
        for (number, ran) in (1..).zip(all).filter(|(_, ran)| !ran.failure.is_empty()) {
            writeln!(f, "run {number} did not come to its end: {}", ran.failure)?;
        }
        if let Some(Place {
            run,
            tick,
            topic,
            difference:
                Difference {
                    field,
                    expected,
                    found,
                },
        }) = place
        {
            writeln!(
                f,
                "run {} first differs at tick {tick}, topic {topic}, field {field}:\n{found} instead of {expected}",
                run + 1
            )?;
        }
        if reference.is_run {
            writeln!(f, "{WHY}")?;
        }
        let verdict = if *is_identical {
            "the same bytes everywhere"
        } else {
            "NOT the same bytes"
        };
        let count = runs.len() + usize::from(reference.is_run);
        writeln!(
            f,
            "{}, seed {}, {} ticks, {count} runs: {verdict}",
            scenario.name, scenario.seed, reference.ran.ticks
        )
    }
}

impl Verified {
    /// For machines.
    #[must_use]
    pub fn json(&self, scenario: &Scenario) -> Value {
        let Self {
            reference,
            runs,
            place,
            is_identical,
        } = self;
        let of = |ran: &Ran| {
            let topic = |(name, topic): &(String, TopicSummary)| {
                let is_equal = reference
                    .ran
                    .topics
                    .iter()
                    .any(|(one, wanted)| one == name && wanted == topic);
                (
                    name.clone(),
                    json!({"count": topic.count, "hash": topic.hash, "equal": is_equal}),
                )
            };
            let topics: serde_json::Map<_, _> = ran.topics.iter().map(topic).collect();
            json!({"condition": ran.condition, "ticks": ran.ticks, "ticks_per_s": ran.ticks_per_s, "failure": ran.failure, "topics": topics})
        };
        let difference = place.as_ref().map(|place| {
            let Difference { field, expected, found } = &place.difference;
            json!({"run": place.run + 1, "tick": place.tick, "topic": place.topic, "field": field, "expected": expected, "found": found})
        });
        let all = reference
            .is_run
            .then_some(&reference.ran)
            .into_iter()
            .chain(runs);
        json!({
            "scenario": scenario.name, "seed": scenario.seed, "identical": is_identical, "faults": scenario.fault.len(),
            "reference_run": reference.is_run.then_some(1), "reference": of(&reference.ran), "runs": all.map(of).collect::<Vec<_>>(),
            "difference": difference,
        })
    }
}

/// The outputs of a process, computed again and compared with the recorded ones.
pub struct ReplayedText<'a> {
    /// Of the recorded run.
    pub job: &'a Job,
    /// The result.
    pub replayed: &'a Replayed,
}

impl fmt::Display for ReplayedText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { job, replayed } = self;
        let process = &replayed.process;
        if let Some((
            tick,
            topic,
            Difference {
                field,
                expected,
                found,
            },
        )) = replayed.first()
        {
            let mut rows = table(&[
                "topic and element",
                "messages",
                "largest",
                "at tick",
                "recorded",
                "replayed",
            ]);
            for topic in &replayed.topics {
                for FieldDifference {
                    messages,
                    largest,
                    tick,
                    difference,
                    ..
                } in &topic.fields
                {
                    rows.add_row([
                        format!("{} {}", topic.name, difference.field).into(),
                        number(messages),
                        number(digits(*largest)),
                        number(tick),
                        number(&difference.expected),
                        number(&difference.found),
                    ]);
                }
            }
            writeln!(f, "{rows}")?;
            writeln!(
                f,
                "{process} first differs at tick {tick}, topic {topic}, field {field}:\n{found} instead of {expected}"
            )?;
        }
        if replayed.without_input > 0 {
            writeln!(
                f,
                "{} outputs could not be computed: their inputs are not in the record",
                replayed.without_input
            )?;
        }
        for damage in &replayed.damage {
            writeln!(f, "damaged: {damage}")?;
        }
        if !replayed.ended.is_empty() {
            writeln!(f, "{}", replayed.ended)?;
        }
        let messages: u64 = replayed.topics.iter().map(|topic| topic.messages).sum();
        let verdict = match (replayed.first(), replayed.is_complete()) {
            (Some(_), _) => "NOT the same bytes",
            (None, true) => "the same bytes",
            (None, false) => "the same bytes, of an INCOMPLETE record",
        };
        writeln!(
            f,
            "{}, seed {}, {process}, {messages} messages: {verdict}",
            job.scenario.name, job.scenario.seed
        )
    }
}

impl Replayed {
    /// For machines; `settings` are those that override values of the recorded scenario.
    #[must_use]
    pub fn json(&self, job: &Job, settings: &[String]) -> Value {
        let first = self.first().map(|(tick, topic, Difference { field, expected, found })| {
            json!({"tick": tick, "topic": topic, "field": field, "recorded": expected, "replayed": found})
        });
        let topic = |topic: &Topic| {
            let field = |field: &FieldDifference| {
                json!({
                    "field": field.field, "messages": field.messages, "largest": field.largest, "tick": field.tick,
                    "element": field.difference.field, "recorded": field.difference.expected, "replayed": field.difference.found,
                })
            };
            json!({"topic": topic.name, "messages": topic.messages, "fields": topic.fields.iter().map(field).collect::<Vec<_>>()})
        };
        json!({
                "run": job.run, "scenario": job.scenario.name, "seed": job.scenario.seed, "version": job.version, "process": self.process,
                "set": settings, "identical": first.is_none(), "difference": first, "topics": self.topics.iter().map(topic).collect::<Vec<_>>(),
                "without_input": self.without_input, "damage": self.damage, "ended": self.ended,
        })
    }
}
