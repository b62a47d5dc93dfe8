//! The JSON Schemas of scenario files and of `summary.json`, against what the program takes and writes.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use shared_types::fault::Fault;
use shared_types::scenario as of;

use crate::command::{Desk, Known};
use crate::exchange::{lacks, root};

fn schema(desk: &Desk, file: &str) -> Value {
    let said = desk.succeeds(&format!("generate schema {file}"));
    assert_eq!(said.err.as_str(), "");
    said.json()
}

/// The violations of a schema of the keywords that ours use.
fn violations(root: &Value, schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let known = [
        "$schema",
        "$defs",
        "$ref",
        "title",
        "description",
        "type",
        "properties",
        "required",
        "additionalProperties",
        "items",
        "minItems",
        "maxItems",
        "minimum",
        "const",
        "oneOf",
        "anyOf",
    ];
    let rules = schema.as_object().expect("a schema is an object");
    assert!(
        rules.keys().all(|rule| known.contains(&rule.as_str())),
        "a keyword that this test does not know: {schema}"
    );
    let mut bad = Vec::new();
    if let Some(name) = rules.get("$ref").and_then(Value::as_str) {
        let target = root
            .pointer(name.trim_start_matches('#'))
            .unwrap_or_else(|| panic!("{name} is not there"));
        bad.extend(violations(root, target, value, at));
    }
    let is_of = |kind: &str| match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        "null" => value.is_null(),
        other => panic!("the type {other}"),
    };
    if let Some(kind) = rules.get("type").and_then(Value::as_str)
        && !is_of(kind)
    {
        return vec![format!("{at}: {value} is no {kind}")];
    }
    if rules.get("const").is_some_and(|constant| constant != value) {
        bad.push(format!("{at}: {value} is not {}", rules["const"]));
    }
    if value
        .as_f64()
        .zip(rules.get("minimum").and_then(Value::as_f64))
        .is_some_and(|(value, least)| value < least)
    {
        bad.push(format!("{at}: {value} is too small"));
    }
    for (rule, is_right) in [
        ("oneOf", (|n| n == 1) as fn(usize) -> bool),
        ("anyOf", |n| n > 0),
    ] {
        let Some(ways) = rules.get(rule).and_then(Value::as_array) else {
            continue;
        };
        let fitting = ways
            .iter()
            .filter(|way| violations(root, way, value, at).is_empty())
            .count();
        if !is_right(fitting) {
            bad.push(format!("{at}: {value} fits {fitting} of {rule}"));
        }
    }
    if let Some(items) = value.as_array() {
        let bound =
            |rule: &str, or: u64| rules.get(rule).and_then(Value::as_u64).unwrap_or(or) as usize;
        if !(bound("minItems", 0)..=bound("maxItems", u64::from(u32::MAX))).contains(&items.len()) {
            bad.push(format!("{at}: {} items", items.len()));
        }
        let each = rules
            .get("items")
            .into_iter()
            .flat_map(|schema| items.iter().enumerate().map(move |item| (schema, item)));
        bad.extend(
            each.flat_map(|(schema, (i, item))| {
                violations(root, schema, item, &format!("{at}/{i}"))
            }),
        );
    }
    if let Some(fields) = value.as_object() {
        let required = rules
            .get("required")
            .and_then(Value::as_array)
            .into_iter()
            .flatten();
        bad.extend(
            required
                .filter(|key| !fields.contains_key(key.as_str().unwrap()))
                .map(|key| format!("{at}: {key} is missing")),
        );
        for (key, value) in fields {
            let at = format!("{at}/{key}");
            match (
                rules.get("properties").and_then(|all| all.get(key)),
                rules.get("additionalProperties"),
            ) {
                (Some(schema), _) => bad.extend(violations(root, schema, value, &at)),
                (None, Some(Value::Bool(false))) => bad.push(format!("{at} is not known")),
                (None, Some(schema)) => bad.extend(violations(root, schema, value, &at)),
                (None, None) => {}
            }
        }
    }
    bad
}

/// The same schema without room for unknown keys.
fn strict(mut schema: Value) -> Value {
    match &mut schema {
        Value::Object(rules) => {
            if rules.contains_key("properties") {
                rules.entry("additionalProperties").or_insert(json!(false));
            }
            rules
                .values_mut()
                .for_each(|value| *value = strict(value.take()));
        }
        Value::Array(all) => all
            .iter_mut()
            .for_each(|value| *value = strict(value.take())),
        _ => {}
    }
    schema
}

/// The scenarios of the repository.
fn scenarios() -> Vec<PathBuf> {
    let folders = [
        "sim/scenarios",
        "examples/python",
        "examples/c",
        "examples/energy",
    ];
    let files = folders
        .iter()
        .flat_map(|folder| {
            std::fs::read_dir(root().join(folder))
                .expect("a folder")
                .flatten()
        })
        .map(|file| file.path());
    let is_scenario = |path: &PathBuf| {
        path.extension()
            .is_some_and(|extension| extension == "toml")
            && std::fs::read_to_string(path)
                .expect("text")
                .lines()
                .any(|line| line.starts_with("robot = "))
    };
    files.filter(is_scenario).collect()
}

#[test]
fn every_scenario_of_the_repository_names_and_keeps_its_schema() {
    let schema = schema(&Desk::new(), "scenario");
    let all = scenarios();
    assert!(all.len() >= 16, "{all:?}");
    for path in all {
        let text = std::fs::read_to_string(&path).expect("text");
        let named = text
            .lines()
            .next()
            .and_then(|line| line.strip_prefix("#:schema "))
            .map(|file| path.with_file_name(file));
        assert!(
            named.as_ref().is_some_and(|file| file.is_file()),
            "{}: {named:?}",
            path.display()
        );
        let value: Value = toml::from_str(&text).expect("TOML");
        assert_eq!(
            violations(&schema, &schema, &value, ""),
            Vec::<String>::new(),
            "{}",
            path.display()
        );
    }
    let wrong = json!({"name": "x", "robot": "puma560", "start": {"q_dg": []}, "segment": [{"duration_s": "1", "path": "straight"}]});
    assert_eq!(
        violations(&schema, &schema, &wrong, "").len(),
        3,
        "the check finds what is wrong"
    );
}

#[test]
fn a_summary_keeps_its_schema_and_has_no_other_key() {
    let desk = Desk::new();
    desk.file(
        "s.toml",
        "name = \"s\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 0, 0]\n[[segment]]\nreorient = { singularity = \"wrist\", by_deg = 20 }\n\
         duration_s = 0.6\n[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_s = 0.2\n",
    );
    let said = desk.armplane("run s.toml --json");
    let summary = said.json();
    assert!(
        summary["faults"][0]["plan"].is_object() && !summary["modes"].list().is_empty(),
        "{summary}"
    );
    let strict = strict(schema(&desk, "summary"));
    assert_eq!(
        violations(&strict, &strict, &summary, ""),
        Vec::<String>::new()
    );
}

/// The keys that serde names when it is given another one.
fn taken<T: DeserializeOwned>() -> BTreeSet<String> {
    let error = toml::from_str::<T>("zz = 1")
        .err()
        .expect("zz is no key")
        .message()
        .to_owned();
    let (_, listed) = error
        .split_once("expected")
        .unwrap_or_else(|| panic!("{error}"));
    listed
        .split('`')
        .skip(1)
        .step_by(2)
        .map(str::to_owned)
        .collect()
}

#[test]
fn each_table_of_a_scenario_has_the_keys_that_the_program_takes() {
    let schema = schema(&Desk::new(), "scenario");
    let keys = |table: &Value| {
        table["properties"]
            .as_object()
            .expect("a table")
            .keys()
            .cloned()
            .collect::<BTreeSet<_>>()
    };
    assert_eq!(keys(&schema), taken::<of::Scenario>());
    macro_rules! check {
        ($($table:ident),*) => { $( assert_eq!(keys(&schema["$defs"][stringify!($table)]), taken::<of::$table>(), stringify!($table)); )* };
    }
    check!(
        Start,
        Segment,
        Servo,
        Slide,
        Turn,
        Reorient,
        Plant,
        Estimator,
        Analysis,
        Control,
        Baseline,
        Damping,
        HoldAndBlend,
        Goal,
        View,
        Record
    );
    assert_eq!(keys(&schema["$defs"]["Fault"]), taken::<Fault>());
}

#[test]
fn the_schemas_are_those_of_the_types() {
    if lacks("") {
        return;
    }
    let said = Command::new("python3")
        .arg(root().join("docs/schema/make.py"))
        .arg("--check")
        .output()
        .expect("python3 runs");
    assert!(
        said.status.success(),
        "{}",
        String::from_utf8_lossy(&said.stderr)
    );
}
