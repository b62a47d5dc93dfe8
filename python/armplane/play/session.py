"""A run that the page steers: `armplane servo`, fed with targets line by line, and observed."""

import collections
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress

import numpy as np

from ..arena import OPPONENTS
from ..joined import Joined, ProcessError
from ..results import _program, as_settings
from .robot import Robot

# A run that a killed page has not joined ends after a minute.
GRAPH = """extends = "servo"
[[process]]
name = "page"
external = true
join_limit_s = 60
reads = ["plant_state", "singularity", "servo_state", "control_state"]
"""
# A law of others takes the controller's place.
FOREIGN = """[[process]]
name = "controller"
command = {}
reads = ["estimate", "singularity", "target"]
writes = ["servo_state", "control_state", "torque"]
"""
# Longest session, s.
LONGEST_S = 600


class Session:
    """One process graph. Its processes hold the file `keeper` open: while one of them lives,
    nobody removes what they use."""

    def __init__(self, subject, folder, keeper, start=None, law=None):
        """`start`: the posture in which it begins, rad and m; `None` for the subject's own."""
        self.folder = pathlib.Path(tempfile.mkdtemp(dir=folder))
        self.law, self.began, self.lines = law, time.monotonic(), collections.deque(maxlen=50)
        # Of the arm; and of the last tick, by topic: `None` until there has been one.
        self.robot, self.job, self.run, self.seen = None, None, None, None
        graph, settings = self.folder / "graph.toml", {} if start is None else {"start": {"q": start}}
        if law in OPPONENTS:
            program = [sys.executable, "-m", "armplane.arena.steered", str(OPPONENTS[law])]
            graph.write_text(GRAPH + FOREIGN.format(json.dumps(program)))
        else:
            graph.write_text(GRAPH)
            settings |= {"control.strategy": law} if law else {}
        command = [_program(), "servo", subject, "--from=-", f"--graph={graph}", f"--out={self.folder / 'run'}", f"--duration={LONGEST_S}"]
        command += [f"--set={one}" for one in as_settings(settings)]
        # In a session of its own: Ctrl-C in the terminal is for the page. If the page is killed, the targets end, and so does the run.
        self.process = subprocess.Popen(
            command, text=True, stdin=subprocess.PIPE, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True, pass_fds=[keeper]
        )
        self._lock = threading.Lock()
        self.listener = threading.Thread(target=self._listen, daemon=True)
        self.listener.start()

    def _listen(self):
        for line in self.process.stderr:
            if found := re.search(r"ARMPLANE_RUN=(\S+) ARMPLANE_PROCESS=page", line):
                threading.Thread(target=self._observe, args=(found[1],), daemon=True).start()
            elif line.strip() and not line.startswith(" "):
                self.lines.append(line.strip())

    def _observe(self, folder):
        """The page's part in the graph: it copies every tick."""
        try:
            joined = Joined(folder, "page")
            self.job, self.run = joined.job, os.path.basename(folder)
            robot = self.robot = Robot(self.job)
        except Exception as error:
            self.lines.append(f"{type(error).__name__}: {error}")
            self.process.send_signal(signal.SIGINT)
            return
        self.rate_hz, self._paces = joined.now.rate_hz, collections.deque(maxlen=10)
        n, arm, topics = robot.dof, robot.arm, joined.inputs
        plant = topics["plant_state"]
        qdot, tau = (np.frombuffer(field, count=n) for field in (plant.qdot, plant.tau))
        # Largest speed and torque so far, as shares of their limits.
        self.peaks = np.zeros((2, n))
        try:
            while joined.wait():
                shares = np.abs([qdot / arm.velocity, tau / arm.effort])
                np.maximum(self.peaks, shares, out=self.peaks)
                self.seen = {name: type(one).from_buffer_copy(one) for name, one in topics.items()}
                joined.send()
        except ProcessError as error:
            self.lines.append(str(error))
        joined.leave()

    def say(self, line):
        """Gives a target."""
        # A run that has ended reads no more; the page sees that by itself.
        with self._lock, suppress(BrokenPipeError, ValueError):
            self.process.stdin.write(f"{line}\n")
            self.process.stdin.flush()

    @property
    def q(self):
        """Joint positions of the arm now, `None` before its first tick."""
        return self.seen and np.array(self.seen["plant_state"].q[: self.robot.dof])

    def pace(self):
        """Simulated by real time, over the last ten calls."""
        now = time.monotonic(), self.seen["plant_state"].header.tick / self.rate_hz
        self._paces.append(now)
        real, simulated = np.subtract(now, self._paces[0])
        return simulated / real if real > 0.5 else 1

    def end(self, kept=None, tell=None):
        """Ends it at rest. A thread waits for that, moves the run to `kept`, and tells so."""
        self.say("end")
        with self._lock, suppress(BrokenPipeError):
            self.process.stdin.close()
        self.ending = threading.Thread(target=self._finish, args=(kept, tell))
        self.ending.start()

    def _finish(self, kept, tell):
        for number in (None, signal.SIGINT, signal.SIGKILL):
            if number:
                self.process.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(5)
                break
        if self.process.returncode is None or self.process.returncode < 0:
            # Leftovers of a killed run in shared memory.
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            subprocess.run([_program(), "clean"], **quiet)
        if kept:
            try:
                self._keep(kept)
                again = f"The same bytes again: armplane run {kept}/scenario.toml"
                tell(f"Saved. Look: armplane view {kept}. {again}")
            except OSError as error:
                shutil.rmtree(kept, ignore_errors=True)
                # Of a folder on another disk, the first file's.
                why = error.strerror or str(error.args[0][0][2]).split(": '")[0]
                remedy = "Start armplane play in a folder that you may write and that has room."
                tell(f"Cannot save {kept.absolute()}: {why}. {remedy}")
        shutil.rmtree(self.folder, ignore_errors=True)

    def _keep(self, kept):
        kept.parent.mkdir(exist_ok=True)
        shutil.move(self.folder / "run", kept)
        # Without the page, which has only watched: the run repeats in the graph of any session.
        scenario = kept / "scenario.toml"
        text = scenario.read_text().splitlines(keepends=True)
        others = [line for line in text if not line.startswith(("graph =", "checksums ="))]
        scenario.write_text("".join(others))
        (kept / "graph.toml").unlink()

    def fault(self, *words):
        """`armplane fault` into this run; its last line."""
        command = [_program(), "fault", *words, "--run", self.run]
        done = subprocess.run(command, capture_output=True, text=True)
        return (done.stdout + done.stderr).strip().splitlines()[-1]
