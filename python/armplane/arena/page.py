"""The table of the arena: for the terminal and as one page of HTML, our losses first."""

import collections
import html
import math
import statistics

from . import picture

OURS = "armplane"
GIVEN_CLOCK, OWN_CLOCK, NO_HINTS = "given clock", "own clock", "no hints"
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


def wilson(hits, all_, z=1.96):
    """The 95 % interval of a share."""
    if not all_:
        return 0.0, 1.0
    share, n = hits / all_, all_
    middle, half = share + z * z / (2 * n), z * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def _number(value):
    return "–" if value is None else f"{value:.3g}"


def _count(rows, so):
    return sum(bool(so(row)) for row in rows)


def _middle(rows, name):
    values = [row[name] for row in rows if row.get(name) is not None and row.get("completed")]
    return statistics.median(values) if values else None


def _most(rows, name):
    return max((row[name] for row in rows if row.get(name) is not None), default=None)


# Columns compared pair by pair, smaller is better: heading and column.
PAIRED = """
error orthogonal to ζ, mm: orthogonal_max_mm
error orthogonal to ζ, °: orthogonal_max_deg
error along ζ, mm: along_max_mm
error along ζ, °: along_max_deg
torque step, share of the limit: torque_step_max_ratio
peak joint speed, share of the limit: speed_max_ratio
peak torque, share of the limit: torque_max_ratio
time, of the plan: time_stretch
"""
# Of the table: heading, and the column whose median or largest value it has.
NUMBERS = """
⊥ ζ median, mm: orthogonal_max_mm
°: orthogonal_max_deg
∥ ζ median, mm: along_max_mm
°: along_max_deg
step median: torque_step_max_ratio
speed, most: speed_max_ratio
torque, most: torque_max_ratio
time median: time_stretch
µs a tick: median_us
"""
_pairs = lambda text: [line.split(": ") for line in text.strip().splitlines()]
HEADINGS = ["law", "S1", "S1, step within the drive's rate", "S2", "to the end", "no run", *(heading for heading, _ in _pairs(NUMBERS))]


def _law_row(name, rows):
    """A law's row under the `HEADINGS`."""
    counts = [_count(rows, lambda row: row.get("s2")), _count(rows, lambda row: row.get("completed")), _count(rows, lambda row: row["outcome"] in NO_RUN)]
    numbers = [(_most if heading.endswith("most") else _middle)(rows, column) for heading, column in _pairs(NUMBERS)]
    return [name, _share(rows, lambda row: row.get("s1")), _share(rows, clean), *map(str, counts), *map(_number, numbers)]


def clean(row):
    """S1, and the drives accept every torque step."""
    return bool(row.get("s1") and row.get("within_rate"))


def on_time(row):
    """The same without taking longer than the path's own time."""
    return clean(row) and row.get("time_stretch", math.inf) <= ON_TIME


def _share(rows, so):
    hits = _count(rows, so)
    low, high = wilson(hits, len(rows))
    return f"{hits} ({100 * low:.0f}–{100 * high:.0f}\u00a0%)"


def why(rows):
    """The measures that runs without S1 and clean torque missed, most frequent first: "orthogonal 20, torque 7"."""
    found = collections.Counter()
    for row in rows:
        if row["outcome"] in NO_RUN:
            found[row["outcome"]] += 1
        elif not row.get("s1"):
            # S1 has a narrower limit of orientation than what `missed` names, that of S2.
            found.update(row.get("missed", "").split(", ") if row.get("missed") else ["orientation"])
        elif not clean(row):
            found["torque step"] += 1
    return ", ".join(f"{name} {count}" for name, count in found.most_common()) or "–"


class Summary:
    """The rows of a table, law by law."""

    def __init__(self, rows, skipped, versions, digest, command=""):
        self.skipped, self.digest, self.command = skipped, digest, command
        self.versions = ", ".join(f"{name} {version}" for name, version in versions.items())
        self.others = {}
        for row in rows:
            self.others.setdefault(row["condition"], {}).setdefault(row["law"], []).append(row)
        self.laws = self.others.pop(GIVEN_CLOCK, {})
        given = [row for rows in self.laws.values() for row in rows]
        self.tasks, self.cells = {row["task"]: row["group"] for row in given}, {(row["law"], row["task"]): row for row in given}

    def rivals(self):
        """Ours and the best of the others, by S1 with clean torque."""
        theirs = [name for name in self.laws if not name.startswith(OURS)]
        return [OURS, max(theirs, key=lambda name: sum(map(clean, self.laws[name])))] if theirs and OURS in self.laws else []

    def contests(self, first, second):
        """Up to three tasks of two laws, with a heading each: one that only the second does, one that only the first does, one that both do."""
        headings = {(False, True): f"only {second} does it", (True, False): f"only {first} does it", (True, True): "both do it"}
        done = {task: (clean(self.cells[first, task]), clean(self.cells[second, task])) for task in self.tasks}
        found = {both: task for task, both in reversed(done.items())}
        return [(heading, found[both]) for both, heading in headings.items() if both in found]

    def conditions(self):
        """The second table: headings and rows, each cell S1 with clean torque of so many. A track counts all tasks, with the rows that it does not change."""
        tracks = {name: rows for name, rows in self.others.items() if name in (OWN_CLOCK, NO_HINTS)}
        varied = {name: rows for name, rows in self.others.items() if name not in tracks}
        body = []
        for law, base in self.laws.items():
            of = lambda rows: f"{_count(rows, clean)} of {len(rows)}" if rows else "–"
            line = [law, f"{sum(map(on_time, base))} of {len(base)}"]
            for name, found in tracks.items():
                changed = {row["task"]: row for row in found.get(law, ())}
                rows = [changed.get(row["task"], row) for row in base]
                stretch = _middle(rows, "time_stretch") if name == OWN_CLOCK else None
                line.append(of(rows) + (f", × {stretch:.3g}" if stretch else ""))
            some = next((rows[law] for rows in varied.values() if law in rows), [])
            if varied:
                line.append(of([self.cells[law, row["task"]] for row in some]))
            body.append(line + [of(found.get(law)) for found in varied.values()])
        headings = ["law", f"given clock, up to × {ON_TIME}", *(f"{name}, median time" if name == OWN_CLOCK else name for name in tracks)]
        return [*headings, *(["nothing varied", *varied] if varied else [])], body

    def losses(self):
        """Where another law beats ours: the tasks that only it does, and numbers better by more than a tenth on tasks that both do by S2."""
        ours, lines = self.laws.get(OURS), []
        for name, theirs in self.laws.items() if ours else ():
            if name == OURS:
                continue
            pairs = [(self.cells[OURS, row["task"]], row) for row in theirs]
            alone = [their["task"] for our, their in pairs if clean(their) and not clean(our)]
            if alone:
                lines.append(f"{name} does {len(alone)} that we do not (S1, step within the rate): {', '.join(alone)}")
            times = [sum(map(on_time, side)) for side in zip(*pairs)]
            if times[1] > times[0]:
                lines.append(f"{name} keeps the given clock in {times[1]} tasks, we in {times[0]} (S1, step within the rate, up to × {ON_TIME})")
            both = [(our, their) for our, their in pairs if our.get("s2") and their.get("s2")]
            for heading, column in _pairs(PAIRED):
                if not both:
                    break
                our, their = (statistics.median(row[column] for row in side) for side in zip(*both))
                if our > 1.1 * their and our > 1e-6:
                    lines.append(f"{heading}: {name} {_number(their)}, we {_number(our)}; medians of the {len(both)} tasks that both do by S2")
        return lines

    def text(self):
        table = lambda headings, body: ["| " + " | ".join(row) + " |" for row in [headings, ["---"] * len(headings), *body]]
        lines = [f"{len(self.tasks)} tasks, hash {self.digest}; our losses:", *(f"  {line}" for line in self.losses() or ["none"]), ""]
        lines += table(HEADINGS, [_law_row(*law) for law in self.laws.items()])
        lines += ["", "Why not S1 with the step within the rate (runs; one may miss several):", *(f"  {name}: {why(rows)}" for name, rows in self.laws.items())]
        lines += ["", "S1 with the step within the rate, by track and with one thing varied:", *table(*self.conditions())]
        groups = sorted(set(self.tasks.values()))
        counts = lambda rows: [str(_count(rows, lambda row: clean(row) and row["group"] == group)) for group in groups]
        headings = ["law", *(f"{group}, {list(self.tasks.values()).count(group)}" for group in groups)]
        lines += ["", "S1 with the step within the rate, by group:", *table(headings, [[name, *counts(rows)] for name, rows in self.laws.items()])]
        return "\n".join([*lines, *(f"left out: {name}: {reason}" for name, reason in self.skipped.items())])

    def html(self, races=()):
        """One self-contained page. `races`: the input of [`picture.races`]."""
        cell = lambda text, tag="td": f"<{tag}>{html.escape(str(text))}</{tag}>"
        table = lambda head, body: "<table><tr>" + "".join(cell(one, "th") for one in head) + "".join("<tr>" + "".join(map(cell, line)) for line in body) + "</table>"
        listed = lambda lines: "<ul>" + "".join(f"<li>{html.escape(line)}" for line in lines) + "</ul>"
        map_head = "<tr><th>task" + "".join(f"<th><div>{html.escape(name)}</div>" for name in self.laws)
        map_body = "".join(self._line(task, group) for task, group in sorted(self.tasks.items(), key=lambda one: (one[1], one[0])))
        skipped = listed(f"{name}: {reason}" for name, reason in self.skipped.items()) if self.skipped else "<p>None."
        main = table(HEADINGS, [_law_row(*law) for law in self.laws.items()])
        reasons = table(["law", "missed, in so many runs"], [[name, why(rows)] for name, rows in self.laws.items()])
        return (
            f"<!doctype html><meta charset=utf-8><title>armplane arena</title>{_STYLE}<h1>armplane arena</h1><p>{len(self.tasks)} tasks, table {self.digest}, with {html.escape(self.versions)}<p><code>{html.escape(self.command)}</code>"
            f"<h2>Where we lose</h2>{listed(self.losses() or ['Nowhere by more than a tenth.'])}<h2>What a sceptic will say</h2>{listed(SCEPTIC)}"
            f"<h2>Table</h2><div class=wide>{main}</div><p>S1, S2: armplane compare --help. Intervals: 95 %, Wilson. Medians: of the runs to the end. Step, speed, "
            f"torque: share of the joint's limit. No run: refused in words, failed, or silent.<h2>Why not</h2>{reasons}<p>Of the runs without S1 and torque steps "
            f"that the drives accept; a run may miss several.<h2>Tracks, and one thing varied</h2><div class=wide>{table(*self.conditions())}</div><p>S1 with torque "
            f"steps that the drives accept.<h2>Races</h2>{picture.races(races) or '<p>None.'}<h2>Task by task</h2><table class=map>{map_head}{map_body}</table><p>1: S1. "
            f"/: S1 with torque steps that the drives do not accept. 2: S2. ·: missed. R: refused in words. ×: failed.<h2>Left out</h2>{skipped}"
        )

    def _line(self, task, group):
        def one(name):
            row = self.cells.get((name, task))
            if row is None:
                return "<td>"
            why = html.escape(f"{row['outcome']}: {row.get('missed') or row.get('reason', '')}", quote=True)
            sign, color = _mark(row)
            return f'<td style="background:{color}" title="{why}">{sign}'

        return f"<tr><td>{html.escape(f'{group}: {task}')}" + "".join(one(name) for name in self.laws) + "</tr>"


def _mark(row):
    """Sign and colour of a cell of the map."""
    if row.get("s1"):
        return ("1", "#7bc47f") if clean(row) else ("/", "#d7e4a0")
    if row.get("s2"):
        return "2", "#cfe8ff"
    return {"refused": ("R", "#ddd"), "failed": ("×", "#d98880"), "silent": ("×", "#d98880")}.get(row["outcome"], ("·", "#f3b3ad"))


_STYLE = """<style>body{font:14px sans-serif;margin:2em;max-width:84em}table{border-collapse:collapse}td,th{padding:2px 7px;text-align:right;border-bottom:1px solid #ddd}
td:first-child,th:first-child{text-align:left;white-space:nowrap}th{vertical-align:bottom}.wide{overflow-x:auto;font-size:12px}.wide td,.wide th{padding:2px 5px}
.wide td{white-space:nowrap}.words td,.words th{text-align:left}.map td+td{text-align:center}.map th div{writing-mode:vertical-rl;transform:rotate(180deg);margin:auto}.map th{height:13em}
figure{display:inline-block;margin:0 1em 1em 0}figcaption{font-weight:bold}svg text{font-size:11px}h3{margin-bottom:0}</style>"""
