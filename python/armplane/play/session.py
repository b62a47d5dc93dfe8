"""A run that the page steers: `armplane servo` with the page as an observer of its graph, fed with targets line by line."""

import collections
import ctypes
import os
import pathlib
import re
import signal
import subprocess
import tempfile
import threading
import time

import numpy as np

from .. import wire
from ..exchange import Exchange
from ..results import _program
from .robot import Robot

GRAPH = """extends = "servo"
[[process]]
name = "page"
external = true
reads = ["plant_state", "estimate", "singularity", "target", "servo_state", "control_state", "torque"]
"""
# The page looks at the newest messages so often, s; its largest ratios are those of every tick.
LOOK_S = 0.008
# Longest session, s: its recording grows by 2 MB a second.
LONGEST_S = 600
_LIBC = ctypes.CDLL(None)
_PDEATHSIG = 1


def end_with_parent():
    """In a new process: SIGINT when the process that started it is gone."""
    _LIBC.prctl(_PDEATHSIG, signal.SIGINT)


def clean():
    """Removes what killed runs have left in shared memory."""
    subprocess.run([_program(), "clean"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


class Session:
    """One process graph. Make it on a thread that lives as long as the page: the graph ends with it."""

    def __init__(self, subject, folder, start=None, law=None, settings=()):
        self.folder, self.law, self.began = pathlib.Path(tempfile.mkdtemp(dir=folder)), law, time.monotonic()
        graph = self.folder / "graph.toml"
        graph.write_text(GRAPH)
        command = [_program(), "servo", subject, "--from", "-", "--graph", graph, "--out", self.folder / "run", "--duration", str(LONGEST_S)]
        if start is not None:
            command.append("--start=" + ",".join(f"{x:.9g}" for x in np.degrees(start)))
        for setting in [*settings, *([f"control.strategy={law}"] if law else [])]:
            command += ["--set", setting]
        pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL}
        self.process = subprocess.Popen(list(map(str, command)), text=True, preexec_fn=end_with_parent, start_new_session=True, **pipes)
        self.lines, self.seen, self.robot, self.run = collections.deque(maxlen=50), None, None, None
        self.asked = self.latency = None
        self._lock = threading.Lock()
        self.listener = threading.Thread(target=self._listen, daemon=True)
        self.listener.start()

    def _listen(self):
        for line in self.process.stderr:
            found = re.search(r"ARMPLANE_EXCHANGE=(\S+)", line)
            if found:
                threading.Thread(target=self._observe, args=(found[1],), daemon=True).start()
            elif line.strip() and not line.startswith(" "):
                self.lines.append(line.strip())

    def _observe(self, path):
        try:
            exchange = Exchange(path)
            self.job = exchange.job()
            robot = Robot(self.job, exchange.arm())
        except Exception as error:
            self.lines.append(f"{type(error).__name__}: {error}")
            self.process.send_signal(signal.SIGINT)
            return
        exchange.ready()
        self.run, n = os.path.basename(os.path.dirname(path)), robot.dof
        topics, state = exchange.topics, exchange.topics["plant_state"].message
        view = lambda field: np.frombuffer(field, count=n)
        parts = ((view(state.qdot), robot.arm.velocity), (view(state.tau), robot.arm.effort))
        self.peaks, last = np.zeros((2, n)), 0.0
        while (request := exchange.next()) != wire.REQUEST_STOP:
            if request == wire.REQUEST_TICK:
                for peak, (values, limits) in zip(self.peaks, parts):
                    np.maximum(peak, np.abs(values) / limits, out=peak)
                now = time.monotonic()
                if now - last > LOOK_S:
                    last, self.robot = now, robot
                    if self.asked and np.abs(state.V_BE).max() > 5e-3:
                        self.latency, self.asked = now - self.asked, None
                    elif topics["servo_state"].message.reason not in (wire.REASON_FOLLOWING, wire.REASON_RESTING, wire.REASON_FAST):
                        # It has a reason to wait, which is no delay of the page.
                        self.asked = None
                    self.seen = {name: type(one.message).from_buffer_copy(one.message) for name, one in topics.items()}
            exchange.answer()

    def say(self, line):
        """Gives a target."""
        with self._lock:
            try:
                self.process.stdin.write(line + "\n")
                self.process.stdin.flush()
            except (BrokenPipeError, ValueError):
                # It has ended; the page sees that by itself.
                pass

    @property
    def q(self):
        """Joint positions of the arm now, `None` before its first tick."""
        return None if self.seen is None else np.array(self.seen["plant_state"].q[: self.robot.dof])

    def end(self):
        """Ends it at rest; `ended` says when that is done."""
        self.say("end")
        with self._lock:
            try:
                self.process.stdin.close()
            except BrokenPipeError:
                pass
        self.ending = time.monotonic()

    def ended(self):
        """Whether the graph is gone. One that does not end by itself is interrupted, then killed."""
        if self.process.poll() is None and hasattr(self, "ending"):
            late = time.monotonic() - self.ending
            if late > 10:
                self.process.kill()
            elif late > 5:
                self.process.send_signal(signal.SIGINT)
        return self.process.poll() is not None

    def fault(self, *words):
        """`armplane fault` into this run; what it says."""
        command = [_program(), "fault", *words, "--run", self.run]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return (done.stdout + done.stderr).strip()
