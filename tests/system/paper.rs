//! Every equation and figure of the paper has code that cites it and a test that covers it; what has neither, or only one, is listed.

use std::path::{Path, PathBuf};

/// What Chang & Khatib 1995 states and shows, and how code and tests refer to it.
const PAPER: [(&str, &str); 9] = [
    ("Eq. 1", "s(q) = s₁·s₂·…"),
    ("Eq. 2", "neighbourhoods D_si"),
    ("Eq. 3", "Γ = JᵀF + [I − JᵀJ̄ᵀ]Γ₀"),
    ("Eq. 4", "J̄ and Λ"),
    ("Eq. 5", "Γ₀ = −A[∇V₀ + k_vq q̇]"),
    ("Figure 1", "pseudo-inverse: the hand is disturbed"),
    ("Figure 2", "dynamically consistent: it is not"),
    ("Figure 4", "elbow and wrist locked at once"),
    ("Figure 5", "ζ of the wrist turned, then a rotation about it"),
];

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

/// Whether a line of documentation cites it: `[CK95 Eq. 3 to 5]` cites Eq. 3 and Eq. 5, `[CK95 Eq. 3, Eq. 5]` too.
fn cites(line: &str, item: &str) -> bool {
    let Some(citation) = line.split("[CK95 ").nth(1).and_then(|rest| rest.split(']').next()) else { return false };
    let number = item.split(' ').next_back().unwrap_or_default();
    let kind = item.split(' ').next().unwrap_or_default();
    citation.contains(kind) && citation.split(|c: char| !c.is_ascii_digit()).any(|found| found == number)
}

/// Whether a `// covers: CK95 …` names it and a test follows.
fn covers(text: &str, item: &str) -> bool {
    let lines: Vec<&str> = text.lines().map(str::trim_start).collect();
    let number = item.split(' ').next_back().unwrap_or_default();
    lines.iter().enumerate().any(|(at, line)| {
        let Some(named) = line.strip_prefix("// covers: CK95 ") else { return false };
        let figures = named.split("Figure").nth(1).unwrap_or_default();
        let of_this_kind = if item.starts_with("Figure") { figures } else { named.split('(').next().unwrap_or_default() };
        let yes =
            of_this_kind.split(|c: char| !c.is_ascii_digit()).skip(usize::from(!item.starts_with("Figure"))).any(|found| found == number);
        yes && lines[at + 1..].iter().take(3).any(|line| line.starts_with("#[test]"))
    })
}

#[test]
fn each_equation_and_figure_is_cited_by_code_and_covered_by_a_test() {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    let mut sources = Vec::new();
    texts(&root.join("services/control/src"), &mut sources);
    let mut scenarios = String::new();
    for entry in std::fs::read_dir(root.join("sim/scenarios")).unwrap().flatten() {
        scenarios += &std::fs::read_to_string(entry.path()).unwrap();
    }
    let mut list = String::new();
    let mut missing = 0;
    for (item, says) in PAPER {
        // A figure is code where a scenario reproduces it.
        let code = if item.starts_with("Figure") {
            scenarios.contains(&format!("Chang & Khatib 1995, {item}."))
        } else {
            sources.iter().flat_map(|text| text.lines()).any(|line| line.trim_start().starts_with("//") && cites(line, item))
        };
        let test = sources.iter().any(|text| covers(text, item));
        missing += usize::from(!code) + usize::from(!test);
        let word = |there: bool| if there { "yes" } else { "NO" };
        list += &format!("\n{item:9} code {:3} test {:3} {says}", word(code), word(test));
    }
    assert_eq!(missing, 0, "what the paper says, and what of it is here:{list}");
}

#[test]
fn the_check_sees_what_is_missing() {
    let text =
        "/// [CK95 Eq. 3 to 5]\n// covers: CK95 Eq. 3 (Figures 1 and 2)\n#[test]\nfn a() {}\n// covers: CK95 Eq. 4\nfn no_test() {}\n";
    assert!(cites(text, "Eq. 3") && cites(text, "Eq. 5") && !cites(text, "Eq. 1"));
    assert!(covers(text, "Eq. 3") && covers(text, "Figure 1") && covers(text, "Figure 2"));
    assert!(!covers(text, "Eq. 4") && !covers(text, "Figure 4") && !covers(text, "Eq. 1"));
}
