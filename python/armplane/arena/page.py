"""The table of the arena: for the terminal and as one page of HTML, our losses first."""

import html

import pandas
from scipy import stats

from . import GIVEN_CLOCK, NO_HINTS, OWN_CLOCK, picture

OURS = "armplane"
# Outcomes without a run.
NO_RUN = ("refused", "failed", "silent")
# Up to this time stretch a run keeps the given clock.
ON_TIME = 1.01
SCEPTIC = (
    "armplane plans the whole path before its first tick and computes with the plant's exact model; the others react, tick by tick.",
    "The kinematic packages stop at joint velocities. The servo under them is ours, the same for all (docs/arena.md); its numbers are parameters: --law pin_pink:k_p=400:k_v=40.",
    "Numbers are the authors' where their examples state them. Weights of metres against radians are not scaled to the arm.",
    "In the group 'paper' seven scenarios say which posture to take, which only armplane reads. --tracks runs them without these hints, and the others with a clock of their own.",
    "The model is exact, the encoders are quiet, nothing is late. --varied changes the payload, the noise and the delay.",
    "Plant, judge and tasks are armplane's. They are open, and every run repeats to the bit.",
)

# Columns compared pair by pair, smaller is better.
PAIRED = dict(
    one.split(": ")
    for one in """error orthogonal to ζ, mm: orthogonal_max_mm
error orthogonal to ζ, °: orthogonal_max_deg
error along ζ, mm: along_max_mm
error along ζ, °: along_max_deg
torque step, share of the limit: torque_step_max_ratio
peak joint speed, share of the limit: speed_max_ratio
peak torque, share of the limit: torque_max_ratio
time, of the plan: time_stretch""".splitlines()
)
# Of the table: the median of a column over the runs to the end, or its largest value.
NUMBERS = dict(
    one.split(": ")
    for one in """orthogonal to ζ, median, mm: orthogonal_max_mm
orthogonal, °: orthogonal_max_deg
along ζ, median, mm: along_max_mm
along, °: along_max_deg
step median: torque_step_max_ratio
speed, most: speed_max_ratio
torque, most: torque_max_ratio
time median: time_stretch
µs a tick: median_us""".splitlines()
)
FLAGS, NUMERIC = ["s1", "s2", "completed", "within_rate"], list({*PAIRED.values(), *NUMBERS.values()})


def _number(value):
    return "–" if pandas.isna(value) else f"{value:.3g}"


def _share(hits):
    """How many, and the 95 % interval of their share."""
    interval = stats.binomtest(int(hits.sum()), len(hits)).proportion_ci(method="wilson")
    return f"{hits.sum()} ({100 * interval.low:.0f}–{100 * interval.high:.0f}\u00a0%)"


def _of(hits):
    return f"{hits.sum()} of {len(hits)}"


def _law_row(rows):
    """A law's row of the main table."""
    done = rows[rows.completed]
    numbers = {heading: _number(rows[column].max() if heading.endswith("most") else done[column].median()) for heading, column in NUMBERS.items()}
    counts = {heading: rows[flag].sum() for heading, flag in {"S2": "s2", "to the end": "completed", "no run": "no_run"}.items()}
    return {"S1": _share(rows.s1), "S1, step within the drive's rate": _share(rows.clean), **counts, **numbers}


def why(rows):
    """The measures that runs without S1 and clean torque missed, most frequent first: "orthogonal 20, torque 7"."""
    # S1 has a narrower limit of orientation than what `missed` names, that of S2.
    missed = rows[~rows.no_run & ~rows.s1].missed.fillna("").astype(str).replace("", "orientation").str.split(", ").explode()
    steps = pandas.Series("torque step", rows.index[rows.s1 & ~rows.clean])
    found = pandas.concat([rows.outcome[rows.no_run], missed, steps]).value_counts()
    return ", ".join(f"{name} {count}" for name, count in found.items()) or "–"


class Summary:
    """The rows of a table, law by law. *Clean* is S1 where the drives accept every torque step, *on time* without taking longer than the path's own time."""

    def __init__(self, rows, skipped, versions, digest, command=""):
        self.skipped, self.digest, self.command = skipped, digest, command
        self.versions = ", ".join(f"{name} {version}" for name, version in versions.items())
        table = pandas.DataFrame(rows)
        table = table.reindex(columns=table.columns.union([*FLAGS, *NUMERIC, "missed", "reason"])).astype(dict.fromkeys(NUMERIC, float))
        table[FLAGS] = table[FLAGS].eq(True)
        table["clean"] = table.s1 & table.within_rate
        table["on_time"] = table.clean & (table.time_stretch <= ON_TIME)
        table["no_run"] = table.outcome.isin(NO_RUN)
        self.given, self.others = table[table.condition == GIVEN_CLOCK], table[table.condition != GIVEN_CLOCK]
        self.laws = {law: rows.set_index("task") for law, rows in self.given.groupby("law", sort=False)}
        self.groups = self.given.groupby("task", sort=False).group.first()

    def rivals(self):
        """Ours and the best of the others, by S1 with clean torque."""
        theirs = [name for name in self.laws if not name.startswith(OURS)]
        return [OURS, max(theirs, key=lambda name: self.laws[name].clean.sum())] if theirs and OURS in self.laws else []

    def contests(self):
        """Up to three tasks of the rivals, with a heading each: one that only the second does, one that only the first does, one that both do."""
        if not (rivals := self.rivals()):
            return []
        one, two = (self.laws[law].clean for law in rivals)
        found = {f"only {rivals[1]} does it": ~one & two, f"only {rivals[0]} does it": one & ~two, "both do it": one & two}
        return [(heading, tasks.idxmax()) for heading, tasks in found.items() if tasks.any()]

    def main(self):
        """The first table, a row for each law."""
        return pandas.DataFrame({law: _law_row(rows) for law, rows in self.laws.items()}).T

    def reasons(self):
        return pandas.DataFrame({"missed, in so many runs": {law: why(rows) for law, rows in self.laws.items()}})

    def conditions(self):
        """The second table, each cell S1 with clean torque of so many. A track counts all tasks, with the rows that it does not change."""
        given, varied = self.given, dict(list(self.others.groupby("condition", sort=False)))
        rows = {f"given clock, up to × {ON_TIME}": given.assign(clean=given.on_time)}
        for track in (OWN_CLOCK, NO_HINTS):
            if track in varied:
                rows[track] = pandas.concat([varied.pop(track), given]).drop_duplicates(["law", "task"])
        if varied:
            rows["nothing varied"] = given.merge(pandas.concat(varied.values())[["law", "task"]].drop_duplicates())
        table = pandas.DataFrame({name: some.groupby("law").clean.agg(_of) for name, some in (rows | varied).items()})
        if OWN_CLOCK in table:
            own = rows[OWN_CLOCK]
            table[OWN_CLOCK] += own.time_stretch.where(own.completed).groupby(own.law).median().map(", × {:.3g}".format)
        return table.rename(columns={OWN_CLOCK: f"{OWN_CLOCK}, median time"}).reindex([*self.laws]).fillna("–")

    def losses(self):
        """Where another law beats ours: the tasks that only it does, and numbers better by more than a tenth on tasks that both do by S2."""
        ours, lines = self.laws.get(OURS), []
        for name, their in self.laws.items():
            if name == OURS or ours is None:
                continue
            our = ours.loc[their.index]
            alone, times = their.index[their.clean & ~our.clean], (our.on_time.sum(), their.on_time.sum())
            if len(alone):
                lines.append(f"{name} does {len(alone)} that we do not (S1, step within the rate): {', '.join(alone)}")
            if times[1] > times[0]:
                lines.append(f"{name} keeps the given clock in {times[1]} tasks, we in {times[0]} (S1, step within the rate, up to × {ON_TIME})")
            both = our.s2 & their.s2
            for heading, column in PAIRED.items():
                mine, its = our[column][both].median(), their[column][both].median()
                if mine > max(1.1 * its, 1e-6):
                    lines.append(f"{heading}: {name} {_number(its)}, we {_number(mine)}; medians of the {both.sum()} tasks that both do by S2")
        return lines

    def text(self):
        sizes = self.groups.value_counts()
        groups = self.given.pivot_table("clean", "law", "group", "sum").reindex([*self.laws]).rename(columns=lambda group: f"{group}, {sizes[group]}")
        return "\n".join([
            f"{len(self.groups)} tasks, hash {self.digest}; our losses:", *(f"  {line}" for line in self.losses() or ["none"]), "", *_markdown(self.main()), "",
            "Why not S1 with the step within the rate (runs; one may miss several):", *(f"  {name}: {why(rows)}" for name, rows in self.laws.items()), "",
            "S1 with the step within the rate, by track and with one thing varied:", *_markdown(self.conditions()), "",
            "S1 with the step within the rate, by group:", *_markdown(groups), *(f"left out: {name}: {reason}" for name, reason in self.skipped.items()),
        ])  # fmt: skip

    def html(self, races=()):
        """One self-contained page. `races`: the input of [`picture.races`]."""
        listed = lambda lines: f"<ul>{''.join(f'<li>{html.escape(line)}' for line in lines)}</ul>"
        map_head = f"<tr><th>task{''.join(f'<th><div>{html.escape(name)}</div>' for name in self.laws)}"
        map_body = "".join(self._line(task, group) for task, group in sorted(self.groups.items(), key=lambda one: (one[1], one[0])))
        skipped = listed(f"{name}: {reason}" for name, reason in self.skipped.items()) if self.skipped else "<p>None."
        return (
            f"<!doctype html><meta charset=utf-8><title>armplane arena</title>{_STYLE}<h1>armplane arena</h1><p>{len(self.groups)} tasks, table {self.digest}, with {html.escape(self.versions)}<p><code>{html.escape(self.command)}</code>"
            f"<h2>Where we lose</h2>{listed(self.losses() or ['Nowhere by more than a tenth.'])}<h2>What a sceptic will say</h2>{listed(SCEPTIC)}"
            f"<h2>Table</h2><div class=wide>{_table(self.main())}</div><p>S1, S2: armplane compare --help. Intervals: 95 %, Wilson. Medians: of the runs to the end. Step, speed, "
            f"torque: share of the joint's limit. No run: refused in words, failed, or silent.<h2>Why not</h2>{_table(self.reasons())}<p>Of the runs without S1 and torque steps "
            f"that the drives accept; a run may miss several.<h2>Tracks, and one thing varied</h2><div class=wide>{_table(self.conditions())}</div><p>S1 with torque "
            f"steps that the drives accept.<h2>Races</h2>{picture.races(races) or '<p>None.'}<h2>Task by task</h2><table class=map>{map_head}{map_body}</table><p>1: S1. "
            f"/: S1 with torque steps that the drives do not accept. 2: S2. ·: missed. R: refused in words. ×: failed.<h2>Left out</h2>{skipped}"
        )

    def _line(self, task, group):
        def one(rows):
            if task not in rows.index:
                return "<td>"
            row = rows.loc[task]
            sign, color = _mark(row)
            return f'<td style="background:{color}" title="{html.escape(f"{row.outcome}: {row.missed or row.reason}", quote=True)}">{sign}'

        return f"<tr><td>{html.escape(f'{group}: {task}')}" + "".join(map(one, self.laws.values())) + "</tr>"


def _markdown(frame):
    """The lines of a table."""
    rows = [["law", *frame], ["---"] * (1 + len(frame.columns)), *frame.itertuples()]
    return [f"| {' | '.join(map(str, row))} |" for row in rows]


def _table(frame):
    with pandas.option_context("display.max_colwidth", None):
        return frame.rename_axis(index=None, columns="law").to_html(border=0)


def _mark(row):
    """Sign and colour of a cell of the map."""
    if row.s1:
        return ("1", "#7bc47f") if row.clean else ("/", "#d7e4a0")
    if row.s2:
        return "2", "#cfe8ff"
    return {"refused": ("R", "#ddd"), "failed": ("×", "#d98880"), "silent": ("×", "#d98880")}.get(row.outcome, ("·", "#f3b3ad"))


_STYLE = """<style>body{font:14px sans-serif;margin:2em;max-width:84em}table{border-collapse:collapse}td,th{padding:2px 7px;text-align:right;border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left;white-space:nowrap}th{vertical-align:bottom}.wide{overflow-x:auto;font-size:12px}.wide td,.wide th{padding:2px 5px}
.wide td{white-space:nowrap}.words td,.words th{text-align:left}.map td+td{text-align:center}.map th div{writing-mode:vertical-rl;transform:rotate(180deg);margin:auto}.map th{height:13em}</style>"""
