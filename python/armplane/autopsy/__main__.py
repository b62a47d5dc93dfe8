"""`armplane autopsy`: its arguments, a process for each log with limits of time and memory, and what it prints."""

import argparse
import json
import multiprocessing
import os
import pathlib
import resource
import sys

INSTALL = "pip install 'armplane[autopsy]' (docs/autopsy.md)"


def arguments():
    parser = argparse.ArgumentParser(prog="armplane autopsy", description="Says what happened in a robot's log, when, and why; above all, whether it was a singularity.")
    parser.add_argument("logs", nargs="+", metavar="LOG", help="a CSV, Parquet, MCAP or .db3 file, a folder of rosbag2, LeRobot or a run, or a folder of these")
    parser.add_argument("--robot", help="a built-in arm, a URDF or MJCF file [default: the log's /robot_description]")
    parser.add_argument("--tip", help="link at which the arm ends [default: the chain's last]")
    parser.add_argument("--map", action="append", default=[], metavar="ROLE=COLUMN,…", help="columns of t, q, qdot, tau, q_cmd, qdot_cmd, twist_cmd, pose, pose_cmd; * stands for any text")
    parser.add_argument("--picture", metavar="FILE", help="save a picture, .png, .svg or .pdf; of many logs, a folder")
    parser.add_argument("--json", action="store_true", help="print the answers as JSON, one line each")
    parser.add_argument("--limit", type=float, default=300, metavar="SECONDS", help="longest time for one log [default: %(default)s]")
    return parser.parse_args()


def _one(send, options, mapping, path, episode, picture):
    """In a process of its own: what a damaged file does to a library of others ends only this process."""
    from . import LogError, autopsy

    try:
        memory = int(0.75 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # Nothing that a library prints may come between the answers.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        send.send(autopsy(path, options.robot, options.tip, mapping, episode, picture))
    except (LogError, ValueError, OSError, ImportError) as error:
        send.send({"log": _name(path, episode), "error": " ".join(str(error).split())[:600]})
    except MemoryError:
        send.send({"log": _name(path, episode), "error": f"{path} needs more memory than there is: cut the log around the incident"})
    except Exception as error:  # The last resort: a sentence in place of a traceback.
        send.send({"log": _name(path, episode), "error": f"{path} cannot be judged ({type(error).__name__}: {str(error)[:120]}): please report it with the log"})


def _name(path, episode):
    return path.name if episode is None else f"{path.name}:{episode}"


def ask(options, mapping, path, episode, picture):
    """The answer about one log, or {"error": sentence}."""
    context = multiprocessing.get_context("fork")
    receive, send = context.Pipe(duplex=False)
    child = context.Process(target=_one, args=(send, options, mapping, path, episode, picture))
    child.start()
    send.close()
    try:
        if not receive.poll(options.limit):
            return {"log": _name(path, episode), "error": f"{path} took more than {options.limit:g} s: allow more by --limit, or cut the log"}
        return receive.recv()
    except EOFError:
        child.join()
        return {"log": _name(path, episode), "error": f"{path} made its reader crash (exit code {child.exitcode}): the file is damaged; write it again"}
    finally:
        child.kill()
        child.join()


def table(answers):
    """Many answers, worst first: singularities, then what else happened by certainty, then logs without an incident."""
    rows = [("when", "what", "cause", "log")]
    rows += [(f"{one['t']:.2f} s" if one["cause"] not in ("none", "another robot") else "–", one["what"], _cause(one), one["log"]) for one in answers]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join("  ".join([*(cell.ljust(width) for cell, width in zip(row, widths)), row[3]]) for row in rows)


def _cause(one):
    first = one["evidence"][0]
    return f"singularity ({first['name']})" if one["cause"] == "singularity" else one["cause"]


def worst(one):
    return (one["cause"] == "none", one["cause"] != "singularity", -one["evidence"][0]["weight"])


def main():
    options = arguments()
    try:
        import armplane

        armplane.Arm  # of the extension module
        from . import ROLES, LogError
        from .logs import find
    except ImportError as error:
        print(f"armplane: {error}: {INSTALL}", file=sys.stderr)
        return 2
    try:
        mapping = {}
        for text in options.map:
            role, equals, columns = text.partition("=")
            if not equals or role not in ROLES:
                raise LogError(f"--map {text} is not ROLE=COLUMN,…; the roles are {', '.join(ROLES)}")
            mapping[role] = columns.split(",")
        found = [one for path in options.logs for one in find(path)]
        if options.picture and len(found) > 1:
            pathlib.Path(options.picture).mkdir(parents=True, exist_ok=True)
    except (LogError, OSError) as error:
        print(f"armplane: {error}", file=sys.stderr)
        return 2
    answers, failed = [], 0
    for number, (path, episode) in enumerate(found):
        picture = options.picture and (options.picture if len(found) == 1 else str(pathlib.Path(options.picture) / f"{number:03}-{path.stem}.png"))
        answer = ask(options, mapping, path, episode, picture)
        if "error" in answer:
            failed += 1
            print(f"armplane: {answer['error']}", file=sys.stderr)
        else:
            answers.append(answer)
    answers.sort(key=worst)
    if options.json:
        for answer in answers:
            print(json.dumps(answer))
    elif len(found) == 1 and answers:
        print(answers[0]["text"])
    elif answers:
        print(table(answers))
    return 2 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
