//! Completions, manual pages, and errors for machines.

use serde_json::Value;

use crate::command::Desk;

#[test]
fn completions_are_those_of_the_commands() {
    let desk = Desk::new();
    for (shell, expected) in [
        ("bash", "_armplane()"),
        ("zsh", "#compdef armplane"),
        ("fish", "complete -c armplane"),
    ] {
        let said = desk.succeeds(&format!("generate completions {shell}"));
        assert_eq!(said.err.as_str(), "");
        assert!(
            said.out.contains(expected) && said.out.contains("completions"),
            "{shell}"
        );
    }
}

#[test]
fn every_command_has_a_manual_page_and_no_process_has() {
    let desk = Desk::new();
    let said = desk.succeeds("generate man pages");
    assert_eq!((said.out.as_str(), said.err.as_str()), ("", ""));
    let page = |name: &str| std::fs::read_to_string(desk.path().join("pages").join(name));
    for name in [
        "armplane.1",
        "armplane-run.1",
        "armplane-export.1",
        "armplane-generate-man.1",
    ] {
        assert!(
            page(name)
                .unwrap_or_else(|_| panic!("{name}"))
                .contains(".TH"),
            "{name}"
        );
    }
    assert!(page("armplane-plant.1").is_err() && page("armplane-bench-peer.1").is_err());
    assert_eq!(desk.armplane("generate man /proc/nowhere").code, 2);
}

#[test]
fn an_error_for_machines_is_one_object() {
    let desk = Desk::new();
    desk.file("bad.toml", "name = \"x\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = -1.0\n");
    let cases: [(&str, &str, &str); 7] = [
        ("run nothing", "input", "there is no scenario"),
        ("run bad.toml", "input", "the segment takes -1 s"),
        ("run --seed x", "usage", "invalid value 'x'"),
        ("frobnicate", "usage", "unrecognized subcommand"),
        ("export nowhere", "input", "there is no run nowhere"),
        ("fault controller explode", "usage", "explode"),
        ("generate man /proc/nowhere", "input", "cannot write"),
    ];
    for (args, kind, expected) in cases {
        let said = desk.armplane(&format!("{args} --json"));
        let last = said.err.lines().last().unwrap_or_default();
        let error: Value =
            serde_json::from_str(last).unwrap_or_else(|_| panic!("{args:?}: {}", said.err));
        let error = &error["error"];
        assert_eq!((said.code, said.out.as_str()), (2, ""), "{args:?}");
        assert_eq!(
            (error["kind"].as_str(), error["exit_code"].as_i64()),
            (Some(kind), Some(2)),
            "{args:?}: {error}"
        );
        assert!(
            error["message"]
                .as_str()
                .is_some_and(|message| message.contains(expected)),
            "{args:?}: {error}"
        );
    }
    let said = desk.armplane("run bad.toml --json");
    let error: Value =
        serde_json::from_str(said.err.lines().last().expect("a line")).expect("JSON");
    assert_eq!(
        (
            error["error"]["place"]["file"].as_str(),
            error["error"]["place"]["line"].as_u64()
        ),
        (Some("bad.toml"), Some(6))
    );
}
