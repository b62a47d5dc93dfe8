"""A run that the page steers: `armplane servo` with the page as an observer of its graph, fed with targets line by line."""

import collections
import contextlib
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

import numpy as np

from .. import wire
from ..arena.__main__ import OPPONENTS
from ..exchange import Exchange
from ..results import _program
from .robot import Robot

GRAPH = """extends = "servo"
[[process]]
name = "page"
external = true
reads = ["plant_state", "estimate", "singularity", "target", "servo_state", "control_state", "torque"]
"""
# A law of others takes the controller's place.
FOREIGN = """[[process]]
name = "controller"
command = {}
exchange = true
reads = ["estimate", "singularity", "target"]
writes = ["servo_state", "control_state", "torque"]
"""
FILES = {path.stem: str(path) for path in OPPONENTS}
# Longest session, s.
LONGEST_S = 600


def clean():
    """Removes what killed runs have left in shared memory."""
    subprocess.run([_program(), "clean"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


class Session:
    """One process graph. `keeper`: a file that its processes hold open, so that somebody outside can tell when they are gone."""

    def __init__(self, subject, folder, keeper, start=None, law=None, settings=()):
        self.folder, self.law, self.began = pathlib.Path(tempfile.mkdtemp(dir=folder)), law, time.monotonic()
        graph = self.folder / "graph.toml"
        graph.write_text(GRAPH + (FOREIGN.format(json.dumps([sys.executable, "-m", "armplane.arena.steered", FILES[law]])) if law in FILES else ""))
        command = [_program(), "servo", subject, "--from", "-", "--graph", graph, "--out", self.folder / "run", "--duration", LONGEST_S]
        if start is not None:
            command.append("--start=" + ",".join(f"{x:.9g}" for x in np.degrees(start)))
        for setting in [*settings, *([f"control.strategy={law}"] if law and law not in FILES else [])]:
            command += ["--set", setting]
        pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
        # In a session of its own: Ctrl-C in the terminal is the page's. A page that is killed ends it, too: its targets come to their end.
        self.process = subprocess.Popen(list(map(str, command)), text=True, start_new_session=True, pass_fds=[keeper], **pipes)
        self.lines, self.seen, self.robot, self.run, self.ending = collections.deque(maxlen=50), None, None, None, None
        self._lock = threading.Lock()
        self.listener = threading.Thread(target=self._listen, daemon=True)
        self.listener.start()

    def _listen(self):
        for line in self.process.stderr:
            if found := re.search(r"ARMPLANE_EXCHANGE=(\S+)", line):
                threading.Thread(target=self._observe, args=(found[1],), daemon=True).start()
            elif line.strip() and not line.startswith(" "):
                self.lines.append(line.strip())

    def _observe(self, path):
        try:
            exchange = Exchange(path)
            self.job = exchange.job()
            robot = self.robot = Robot(self.job, exchange.arm())
        except Exception as error:
            self.lines.append(f"{type(error).__name__}: {error}")
            self.process.send_signal(signal.SIGINT)
            return
        exchange.ready()
        self.run, n = os.path.basename(os.path.dirname(path)), robot.dof
        topics, state = exchange.topics, exchange.topics["plant_state"].message
        view = lambda field: np.frombuffer(field, count=n)
        parts = ((view(state.qdot), robot.arm.velocity), (view(state.tau), robot.arm.effort))
        self.peaks = np.zeros((2, n))
        while (request := exchange.next()) != wire.REQUEST_STOP:
            if request == wire.REQUEST_TICK:
                for peak, (values, limits) in zip(self.peaks, parts):
                    np.maximum(peak, np.abs(values) / limits, out=peak)
                self.seen = {name: type(one.message).from_buffer_copy(one.message) for name, one in topics.items()}
            exchange.answer()

    def say(self, line):
        """Gives a target."""
        # A run that has ended reads no more; the page sees that by itself.
        with self._lock, contextlib.suppress(BrokenPipeError, ValueError):
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()

    @property
    def q(self):
        """Joint positions of the arm now, `None` before its first tick."""
        return None if self.seen is None else np.array(self.seen["plant_state"].q[: self.robot.dof])

    def end(self, kept=None, tell=None):
        """Ends it at rest. A thread waits for that, moves the run to `kept`, tells so, and removes the rest."""
        self.say("end")
        with self._lock, contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        self.ending = threading.Thread(target=self._finish, args=(kept, tell))
        self.ending.start()

    def _finish(self, kept, tell):
        for number in (None, signal.SIGINT, signal.SIGKILL):
            if number:
                self.process.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(5)
                break
        if self.process.poll() is None or self.process.returncode < 0:
            clean()
        if kept:
            try:
                self._keep(kept)
                tell(f"Saved. Look: armplane view {kept}. The same bytes again: armplane run {kept}/scenario.toml")
            except OSError as error:
                tell(f"The run cannot be saved as {kept.absolute()}: {error.strerror or error}. Start armplane play in a folder in which you may write.")
        shutil.rmtree(self.folder, ignore_errors=True)

    def _keep(self, kept):
        kept.parent.mkdir(exist_ok=True)
        shutil.move(self.folder / "run", kept)
        # Without the page, which has only watched: the run repeats itself in the graph of every steered run.
        scenario = kept / "scenario.toml"
        text = scenario.read_text().splitlines(keepends=True)
        scenario.write_text("".join(line for line in text if not line.startswith(("graph =", "checksums ="))))
        (kept / "graph.toml").unlink()

    def fault(self, *words):
        """`armplane fault` into this run; what it says."""
        done = subprocess.run([_program(), "fault", *words, "--run", self.run], capture_output=True, text=True, check=False)
        return (done.stdout + done.stderr).strip().splitlines()[-1]
