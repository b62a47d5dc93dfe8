//! Every equation of the paper has code that cites it and a test that covers it.

use std::path::{Path, PathBuf};

fn texts(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            texts(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(std::fs::read_to_string(path).unwrap());
        }
    }
}

#[test]
fn each_equation_is_cited_where_it_is_implemented_and_covered_by_a_test() {
    let mut sources = Vec::new();
    texts(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("services/control/src"), &mut sources);
    let lines = || sources.iter().flat_map(|text| text.lines()).map(str::trim_start);
    for equation in 1..=5 {
        let cited = format!("[CK95 Eq. {equation}]");
        assert!(lines().any(|line| line.starts_with("///") && line.contains(&cited)), "no code cites equation {equation}");
        let covered = format!("covers: CK95 Eq. {equation}");
        let has_test = sources.iter().any(|text| {
            let mut rest = text.lines().map(str::trim_start).skip_while(|line| !(line.starts_with("//") && line.contains(&covered)));
            rest.next().is_some()
                && rest.take(4).any(|line| line.starts_with("#[test]") || line.starts_with("fn ") || line.starts_with("proptest!"))
        });
        assert!(has_test, "no test covers equation {equation}");
    }
}
