"""`armplane autopsy`: its arguments, a process for each log with limits of time and memory, and what it prints."""

import json
import pathlib
import sys

from ..limited import Ended, limited
from ..results import Parser, extra


def arguments():
    parser = Parser(prog="armplane autopsy", description="Says what happened in a robot's log, when, and why; above all, whether it was a singularity.")
    add = parser.add_argument
    add("logs", nargs="+", metavar="LOG", help="a CSV, Parquet, MCAP or .db3 file, a folder of rosbag2, LeRobot or a run, or a folder of these")
    add("--robot", help="a built-in arm, a URDF or MJCF file [default: the log's /robot_description]")
    add("--tip", help="link at which the arm ends [default: the chain's last]")
    add("--map", action="append", default=[], metavar="ROLE=COLUMN,…", help="columns of t, q, qdot, tau, q_cmd, qdot_cmd, twist_cmd, pose, pose_cmd; * stands for any text")
    add("--picture", metavar="FILE", help="save a picture, .png, .svg or .pdf; of many logs, a folder")
    add("--json", action="store_true", help="print the answers as JSON, one line each")
    add("--limit", type=float, default=300, metavar="SECONDS", help="longest time for one log [default: %(default)s]")
    return parser.parse_args()


def ask(options, mapping, path, episode, picture):
    """The answer about one log, or {"error": sentence}."""
    from . import autopsy

    try:
        return limited(options.limit, autopsy, path, options.robot, options.tip, mapping, episode, picture)
    except Ended as error:
        return {"error": f"{path} {error}: cut the log around the incident, allow more by --limit, or write it again where it is damaged"}
    except (ValueError, OSError, ImportError) as error:
        return {"error": " ".join(str(error).split())[:600]}


def table(answers):
    """Many answers as rows: when, what, why, and the log."""
    rows = [("when", "what", "cause", "log")]
    for one in answers:
        when = f"{one['t']:.2f} s" if one["cause"] not in ("none", "another robot") else "–"
        rows.append((when, one["what"], f"singularity ({one['evidence'][0]['name']})" if one["cause"] == "singularity" else one["cause"], one["log"]))
    widths = [max(map(len, column)) for column in list(zip(*rows))[:3]] + [0]
    return "\n".join("  ".join(map(str.ljust, row, widths)) for row in rows)


def worst(one):
    """Singularities first, then what else happened by certainty, then logs without an incident."""
    return (one["cause"] == "none", one["cause"] != "singularity", -one["evidence"][0]["weight"])


def main():
    options = arguments()
    try:
        with extra("autopsy"):
            import armplane

            armplane.Arm  # of the extension module
            from . import ROLES
            from .logs import find
        mapping = {role: columns.split(",") for role, _, columns in (text.partition("=") for text in options.map)}
        if wrong := next((text for text in options.map if "=" not in text or text.partition("=")[0] not in ROLES), None):
            raise ValueError(f"--map {wrong} is not ROLE=COLUMN,…; the roles are {', '.join(ROLES)}")
        found = [one for path in options.logs for one in find(path)]
        if options.picture and len(found) > 1:
            pathlib.Path(options.picture).mkdir(parents=True, exist_ok=True)
    except (ImportError, ValueError, OSError) as error:
        print(f"armplane: {error}", file=sys.stderr)
        return 2
    answers = []
    for number, (path, episode) in enumerate(found):
        picture = options.picture and (options.picture if len(found) == 1 else str(pathlib.Path(options.picture) / f"{number:03}-{path.stem}.png"))
        answers.append(ask(options, mapping, path, episode, picture))
        if "error" in answers[-1]:
            print(f"armplane: {answers[-1]['error']}", file=sys.stderr)
    good = sorted((one for one in answers if "error" not in one), key=worst)
    if options.json:
        print("".join(f"{json.dumps(answer)}\n" for answer in good), end="")
    elif good:
        print(good[0]["text"] if len(found) == 1 else table(good))
    return 2 if len(good) < len(answers) else 0


if __name__ == "__main__":
    sys.exit(main())
