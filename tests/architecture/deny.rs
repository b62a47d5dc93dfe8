//! The bans of `deny.toml` on the whole tree of dependencies, as `cargo deny check bans` has them: who may depend on what, however it is reached.

use std::process::Command;

use serde_json::Value;

/// The strings of an array of a TOML table.
fn strings<'a>(table: &'a Value, key: &str) -> Vec<&'a str> {
    let array = table[key].as_array().into_iter().flatten();
    array.filter_map(Value::as_str).collect()
}

/// The crates that depend on a crate, by `cargo tree`; `None` if the tree does not have it.
fn users(library: &str) -> Option<Vec<String>> {
    let tree = Command::new(env!("CARGO"))
        .args([
            "tree",
            "--workspace",
            "--locked",
            "--depth=1",
            "--prefix=none",
        ])
        .args(["--invert", library])
        .output()
        .expect("cargo is there");
    let text = String::from_utf8(tree.stdout).expect("text");
    let mut names = text.lines().filter_map(|line| line.split(' ').next());
    names.next().filter(|_| tree.status.success())?;
    let names = names.filter(|name| !name.is_empty() && !name.starts_with('['));
    Some(names.map(str::to_owned).collect())
}

#[test]
fn no_crate_reaches_a_library_but_by_its_wrapper() {
    let deny: Value = toml::from_str(&crate::text("deny.toml")).expect("it is TOML");
    let bans = deny["bans"]["deny"].as_array().expect("an array");
    let (mut found, mut wrong) = (0, Vec::new());
    for ban in bans {
        let library = ban["crate"].as_str().expect("a name");
        let wrappers = strings(ban, "wrappers");
        let users = users(library);
        found += usize::from(users.is_some());
        let strangers = users.into_iter().flatten();
        let strangers = strangers.filter(|user| !wrappers.contains(&user.as_str()));
        wrong.extend(strangers.map(|user| format!("{user} depends on {library}")));
    }
    assert!(
        bans.len() > 4 && found > 2,
        "{found} of {} are there",
        bans.len()
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
}
