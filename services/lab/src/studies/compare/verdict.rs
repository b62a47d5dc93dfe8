//! The law that wins a comparison, and by how much. PURE.

use viz::plot::digits;

use super::score::{Bounds, Score};

/// Errors that differ by less than this share are the same.
const SAME: f64 = 1.01;

/// The laws of a comparison in order: success by the strict bar, by the other one, to the end, not to the end; then the error orthogonal to ζ.
fn ranked(scores: &[Score]) -> Vec<&Score> {
    let mut ranked: Vec<&Score> = scores.iter().collect();
    ranked.sort_by(|a, b| class(a).cmp(&class(b)).then(error(a).total_cmp(&error(b))));
    ranked
}

fn class(score: &Score) -> usize {
    [score.s1, score.s2, score.completed]
        .into_iter()
        .position(|so| so)
        .unwrap_or(3)
}

/// The error orthogonal to ζ, as a multiple of what S1 allows.
fn error(score: &Score) -> f64 {
    let s1 = Bounds::s1();
    (score.orthogonal_max_mm / s1.orthogonal_mm).max(score.orthogonal_max_deg / s1.orthogonal_deg)
}

/// The laws that win: the best one, and those that cannot be told from it.
fn winners(scores: &[Score]) -> Vec<&Score> {
    let ranked = ranked(scores);
    let Some(best) = ranked.first().copied() else {
        return Vec::new();
    };
    ranked
        .into_iter()
        .take_while(|one| class(one) == class(best) && error(one) <= SAME * error(best))
        .collect()
}

/// Each law's verdict in a table: it wins, succeeds, or fails.
pub(super) fn verdicts(scores: &[Score]) -> Vec<String> {
    let winners = winners(scores);
    let of = |score: &Score| match (
        score.s1 || score.s2,
        winners.iter().any(|one| std::ptr::eq(*one, score)),
    ) {
        (true, true) if scores.len() > winners.len() => format!("wins, {}", score.success()),
        (true, _) => format!("succeeds, {}", score.success()),
        (false, _) => "fails".to_owned(),
    };
    scores.iter().map(of).collect()
}

/// The bars that each law that fails has missed, a line each.
pub(super) fn failures(scores: &[Score]) -> Vec<String> {
    let failed = scores.iter().filter(|score| !(score.s1 || score.s2));
    failed
        .map(|score| format!("{} misses {}", score.law, score.missed.join(", ")))
        .collect()
}

/// The margin by which the best law wins, in one sentence; `None` where there is nothing to compare.
pub(super) fn margin(scores: &[Score]) -> Option<String> {
    let winners = winners(scores);
    let (best, next) = (*winners.first()?, *ranked(scores).get(winners.len())?);
    let names = winners
        .iter()
        .map(|one| one.law.as_str())
        .collect::<Vec<_>>()
        .join(" and ");
    let times = |worse: f64, better: f64| {
        if better > 0.0 {
            format!(" ({:.1} ×)", worse / better)
        } else {
            String::new()
        }
    };
    let begin = if best.s1 || best.s2 {
        format!("{names} win{}", if winners.len() > 1 { "" } else { "s" })
    } else {
        format!("no law succeeds; nearest is {names}")
    };
    let end = if next.s1 || next.s2 {
        "succeeds too"
    } else {
        "fails"
    };
    Some(format!(
        "{begin}: at most {} mm and {}° off, orthogonal to ζ; next {}: {} mm{} and {}°{}, {end}",
        digits(best.orthogonal_max_mm),
        digits(best.orthogonal_max_deg),
        next.law,
        digits(next.orthogonal_max_mm),
        times(next.orthogonal_max_mm, best.orthogonal_max_mm),
        digits(next.orthogonal_max_deg),
        times(next.orthogonal_max_deg, best.orthogonal_max_deg),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn score(law: &str, s1: bool, mm: f64, deg: f64) -> Score {
        let missed = if s1 { vec![] } else { vec!["speed"] };
        Score {
            law: law.to_owned(),
            completed: true,
            s1,
            s2: s1,
            orthogonal_max_mm: mm,
            orthogonal_max_deg: deg,
            missed: missed.iter().map(ToString::to_string).collect(),
            ..Score::default()
        }
    }

    #[test]
    fn success_comes_before_accuracy_and_equals_win_together() {
        let scores = [
            score("a", false, 0.001, 0.0),
            score("b", true, 0.02, 0.001),
            score("c", true, 0.02, 0.001),
            score("d", true, 0.5, 0.1),
        ];
        assert_eq!(
            verdicts(&scores),
            ["fails", "wins, S1", "wins, S1", "succeeds, S1"]
        );
        let margin = margin(&scores).expect("there is a next one");
        assert!(
            margin.starts_with("b and c win: at most 0.020 mm")
                && margin.contains("next d: 0.500 mm (25.0 ×)"),
            "{margin}"
        );
    }

    #[test]
    fn one_law_alone_wins_nothing() {
        let alone = [score("a", true, 0.1, 0.1)];
        assert_eq!(
            (verdicts(&alone), margin(&alone)),
            (vec!["succeeds, S1".to_owned()], None)
        );
        let failed = [score("a", false, 0.1, 0.1), score("b", false, 1.0, 0.1)];
        assert!(
            margin(&failed).is_some_and(|text| text.starts_with("no law succeeds; nearest is a"))
        );
    }
}
