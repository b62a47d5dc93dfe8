//! The law that wins a comparison. PURE.

use recorder::Bounds;

use crate::row::Row;

/// Errors within this ratio of the best tie with it.
const SAME: f64 = 1.1;

/// The order of two laws: success by the strict bar, by the other one, to the end, not to the end; then the error orthogonal to ζ, as a multiple of
/// what S1 allows.
fn rank(row: &Row) -> (usize, f64) {
    let (s1, task) = (Bounds::s1(), &row.task);
    let class = [task.s1, task.s2, row.completed];
    let error = (task.orthogonal_max_mm / s1.orthogonal_mm)
        .max(task.orthogonal_max_deg / s1.orthogonal_deg);
    (class.into_iter().position(|so| so).unwrap_or(3), error)
}

/// The laws in order, the best first, and how many of them win: the best one, and those that tie with it.
fn ranked(rows: &[Row]) -> (Vec<&Row>, usize) {
    let mut ranked: Vec<&Row> = rows.iter().collect();
    ranked.sort_by(|a, b| {
        let (a, b) = (rank(a), rank(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    let best = ranked.first().map_or((0, 0.0), |best| rank(best));
    let wins = |row: &&&Row| rank(row).0 == best.0 && rank(row).1 <= SAME * best.1;
    let winners = ranked.iter().take_while(wins).count();
    (ranked, winners)
}

fn succeeds(row: &Row) -> bool {
    row.task.s1 || row.task.s2
}

/// Each law's verdict in a table: it wins, ties with others, succeeds, or fails.
pub(super) fn verdicts(rows: &[Row]) -> Vec<String> {
    let (ranked, winners) = ranked(rows);
    let is_winner = |row: &Row| ranked[..winners].iter().any(|one| std::ptr::eq(*one, row));
    let of = |row: &Row| match (succeeds(row), is_winner(row)) {
        (true, true) if rows.len() > winners => {
            let word = if winners > 1 { "ties" } else { "wins" };
            format!("{word}, {}", row.success())
        }
        (true, _) => format!("succeeds, {}", row.success()),
        (false, _) => "fails".to_owned(),
    };
    rows.iter().map(of).collect()
}

/// Conditions of S2 by their codes, as people read them.
const CONDITIONS: [(&str, &str); 9] = [
    ("stopped", "stopped before the end"),
    ("task", "a segment not completed"),
    ("joint stop", "a joint at its stop"),
    ("end", "off the goal"),
    ("beyond", "a path beyond reach"),
    ("speed", "a joint above its speed limit"),
    ("torque", "torque at its limit for over 10 ms"),
    ("orthogonal", "error orthogonal to ζ"),
    ("along", "error along ζ"),
];

/// The bars that each law that fails has missed, a line each.
pub(super) fn findings(rows: &[Row]) -> Vec<String> {
    let failed = rows.iter().filter(|row| !succeeds(row));
    let in_words = |code: &String| {
        let known = CONDITIONS.iter().find(|(known, _)| known == code);
        known.map_or(code.as_str(), |(_, words)| words).to_owned()
    };
    let missed = |row: &Row| {
        let missed: Vec<_> = row.task.missed.iter().map(in_words).collect();
        let missed = missed.join(", ");
        match row.completed {
            true => format!("{} fails: {missed}", row.law),
            false => format!("{} fails: {missed}; {}", row.law, row.reason),
        }
    };
    failed.map(missed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::summary::TaskSummary;

    fn row(law: &str, s1: bool, mm: f64) -> Row {
        Row {
            law: law.to_owned(),
            completed: true,
            task: TaskSummary {
                s1,
                orthogonal_max_mm: mm,
                ..TaskSummary::default()
            },
            ..Row::default()
        }
    }

    #[test]
    fn success_comes_before_accuracy_and_equals_win_together() {
        let rows = [
            row("a", false, 0.001),
            row("b", true, 0.02),
            row("c", true, 0.0219),
            row("d", true, 0.0221),
        ];
        let (order, winners) = ranked(&rows);
        let order: Vec<_> = order.iter().map(|row| &*row.law).collect();
        assert_eq!((order, winners), (vec!["b", "c", "d", "a"], 2));
        assert_eq!(findings(&rows).len(), 1);
    }
}
