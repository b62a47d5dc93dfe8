//! The law that wins a comparison, and by how much. PURE.

use recorder::Bounds;
use shared_types::bounds::larger;
use viz::digits;

use crate::row::Row;
use crate::text::percent;

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

/// The load that a law puts on the joints: the largest speed or torque, as a share of its limit.
fn load(row: &Row) -> f64 {
    let joints = &row.joints;
    larger(joints.speed_max_ratio, joints.torque_commanded_max_ratio)
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

/// The bars that each law that fails has missed, a line each; then the margin by which the best law wins, where there is another.
pub(super) fn findings(rows: &[Row]) -> Vec<String> {
    let failed = rows.iter().filter(|row| !succeeds(row));
    let missed = |row: &Row| {
        let missed = row.task.missed.join(", ");
        match row.completed {
            true => format!("{} fails: {missed}", row.law),
            false => format!("{} fails: {missed}; {}", row.law, row.reason),
        }
    };
    failed.map(missed).chain(margin(rows)).collect()
}

fn margin(rows: &[Row]) -> Option<String> {
    let (ranked, winners) = ranked(rows);
    let best = ranked.first()?;
    // A law that ended early has no error that could be compared.
    if rows.len() > 1 && !best.completed {
        return Some("no law succeeds, and none ran to its end".to_owned());
    }
    let next = ranked.get(winners)?;
    let winners = &ranked[..winners];
    let with_load = |row: &&Row| format!("{} (load {})", row.law, percent(load(row)));
    let names: Vec<_> = winners.iter().map(with_load).collect();
    let names = names.join(", ");
    let begin = match (succeeds(best), winners.len()) {
        (true, 1) => format!("{names} wins"),
        (true, _) => format!("{names} tie"),
        (false, _) => format!("no law succeeds; {names} comes closest"),
    };
    let end = match succeeds(next) {
        true => "succeeds too",
        false => "fails",
    };
    let worse = |of: fn(&Row) -> f64, unit: &str| match of(best) {
        better if better > 0.0 => {
            let (value, times) = (digits(of(next)), of(next) / better);
            format!("{value}{unit} ({times:.1} ×)")
        }
        _ => format!("{}{unit}", digits(of(next))),
    };
    let [mm, deg] = [
        worse(|row| row.task.orthogonal_max_mm, " mm"),
        worse(|row| row.task.orthogonal_max_deg, "°"),
    ];
    let next = match next.completed {
        true => format!("{}: {mm} and {deg}, {end}", with_load(next)),
        false => format!("{}, which ended early", next.law),
    };
    let most = |of: fn(&Row) -> f64| digits(winners.iter().map(|row| of(row)).fold(0.0, larger));
    Some(format!(
        "{begin}: at most {} mm and {}° off, orthogonal to ζ; next {next}",
        most(|row| row.task.orthogonal_max_mm),
        most(|row| row.task.orthogonal_max_deg),
    ))
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
        assert_eq!((margin(&rows[..1]), findings(&rows).len()), (None, 2));
        let early = |law: &str| Row {
            completed: false,
            ..row(law, false, 0.0)
        };
        let none = margin(&[early("e"), early("f")]).unwrap();
        assert!(!none.contains("mm"), "no error to compare: {none}");
    }
}
