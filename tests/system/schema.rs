//! The JSON Schemas of scenarios, graphs and `summary.json`, against the program that reads and writes them.

use serde_json::{Value, json};

use crate::clients::python;
use crate::command::{Desk, lacks, root, source};

fn schema(desk: &Desk, file: &str) -> Value {
    let said = desk.succeeds(&format!("generate schema {file}"));
    assert_eq!(said.err.as_str(), "");
    said.json()
}

/// What checks a document by a schema, and may make the schema strict first: without room for unknown keys.
const CHECK: &str = r#"
import json, jsonschema, tomllib

def strict(schema):
    if isinstance(schema, dict):
        if "properties" in schema:
            schema.setdefault("additionalProperties", False)
        return {key: strict(value) for key, value in schema.items()}
    return [strict(one) for one in schema] if isinstance(schema, list) else schema

def errors(schema, document):
    return [f"{error.json_path}: {error.message}" for error in jsonschema.Draft202012Validator(schema).iter_errors(document)]
"#;

/// The scenarios of the repository.
fn scenarios() -> Vec<String> {
    let folders = [
        "sim/scenarios",
        "examples/python",
        "examples/c",
        "examples/energy",
    ];
    let files = folders.iter().flat_map(|folder| {
        let entries = std::fs::read_dir(root().join(folder))
            .expect("a folder")
            .flatten();
        entries.map(move |file| format!("{folder}/{}", file.file_name().to_string_lossy()))
    });
    let is_scenario = |file: &String| {
        file.ends_with(".toml")
            && source(file)
                .lines()
                .any(|line| line.starts_with("robot = "))
    };
    files.filter(is_scenario).collect()
}

#[test]
fn every_scenario_of_the_repository_names_and_keeps_its_schema() {
    let (desk, all) = (Desk::new(), scenarios());
    assert!(all.len() >= 16, "{all:?}");
    for file in &all {
        let text = source(file);
        let named = text
            .lines()
            .next()
            .and_then(|line| line.strip_prefix("#:schema "));
        let path = root().join(file).with_file_name(named.unwrap_or_default());
        assert!(path.is_file(), "{file}");
    }
    if lacks("jsonschema, tomllib") {
        return;
    }
    let all: Vec<_> = all.iter().map(|file| root().join(file)).collect();
    desk.file("schema.json", schema(&desk, "scenario").to_string());
    desk.file("files.json", json!(all).to_string());
    let code = r#"
schema = json.load(open("schema.json"))
for path in json.load(open("files.json")):
    found = errors(schema, tomllib.load(open(path, "rb")))
    assert not found, (path, found)
wrong = {"name": "x", "robot": "puma560", "start": {"q_dg": []}, "segment": [{"duration_s": "1", "path": "straight"}]}
assert len(errors(schema, wrong)) == 3, errors(schema, wrong)
print("good")
"#;
    python(&desk, &[CHECK, code].concat());
}

#[test]
fn a_summary_keeps_its_schema_and_has_no_other_key() {
    if lacks("jsonschema, tomllib") {
        return;
    }
    let desk = Desk::new();
    desk.file(
        "s.toml",
        "name = \"s\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 0, 0]\n[[segment]]\nreorient = { singularity = \"wrist\", by_deg = 20 }\n\
         duration_s = 0.6\n[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_s = 0.2\n",
    );
    desk.file("schema.json", schema(&desk, "summary").to_string());
    desk.armplane("run s.toml --out r");
    let code = r#"
summary = json.load(open("r/summary.json"))
assert summary["faults"][0]["plan"] and summary["modes"]
found = errors(strict(json.load(open("schema.json"))), summary)
assert not found, found
print("good")
"#;
    python(&desk, &[CHECK, code].concat());
}

#[test]
fn the_schemas_are_those_of_the_types() {
    if lacks("") {
        return;
    }
    let mut make = Desk::new().program("python3");
    make.arg(root().join("docs/schema/make.py"))
        .arg("--check")
        .current_dir(root());
    let said = make.output().expect("python3 runs");
    assert!(said.status.success(), "{said:?}");
}
