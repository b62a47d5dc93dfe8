"""The programs that the arena starts: runs, and the opponents that take part in them."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

# An interrupted run may take so long to end, and one whose opponent has died to notice; s.
PATIENCE_S, NOTICES_S = 20, 2
# A run's own words to a process that is to join it.
RUN = re.compile(rb"ARMPLANE_RUN=(\S+)")
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "start_new_session": True}


class End(threading.Thread):
    """Reads all that a program writes, and keeps the last of it: one that floods neither waits nor fills the memory."""

    KEPT = 1 << 16

    def __init__(self, stream, look=lambda _: None):
        super().__init__(daemon=True)
        self.stream, self.look, self.kept = stream, look, b""
        self.start()

    def run(self):
        while part := self.stream.read1(self.KEPT):
            self.kept = (self.kept + part)[-self.KEPT :]
            self.look(self.kept)

    def text(self):
        self.join(1)
        return self.kept.decode(errors="replace")


def killed(child):
    """Ends a program and all that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


class Opponent:
    """A process that loads an opponent's file once, and joins one run after another."""

    def __init__(self, file):
        self.file = file
        self.child = subprocess.Popen([sys.executable, "-m", "armplane.arena.host", file, "-"], stdin=subprocess.PIPE, **PIPES)
        self.ends = End(self.child.stdout), End(self.child.stderr)

    def takes(self, given):
        """Has it join the run of this environment."""
        with suppress(OSError):
            self.child.stdin.write(f"{json.dumps(given)}\n".encode())
            self.child.stdin.flush()

    def has_died(self):
        return self.child.poll() is not None

    def last_words(self):
        """Why it could not go on, where it has said so."""
        lines = self.ends[1].text().splitlines()
        return next((line.removeprefix("armplane: ") for line in reversed(lines) if line.startswith("armplane: ")), "")

    def end(self):
        killed(self.child)
        self.child.stdin.close()


class Children:
    """The current runs, each in its own session, so that Ctrl-C ends them in order: first the arena, then its runs."""

    def __init__(self):
        self.lock, self.running, self.opponents, self.stopped = threading.Lock(), set(), {}, False

    def opponent(self, file):
        """The process of an opponent's file for the runs of this thread."""
        thread = threading.get_ident()
        known = self.opponents.get(thread)
        if known is None or known.file != file or known.has_died():
            self.dismiss(thread)
            known = self.opponents[thread] = Opponent(file)
        return known

    def dismiss(self, thread=None):
        """Ends the opponent of this thread, or of another."""
        if known := self.opponents.pop(thread or threading.get_ident(), None):
            known.end()

    def run(self, command, seconds, opponent=None, **environment):
        """Exit code, standard output and standard error of a program, or `None` after [`stop`] or a timeout. Whatever it has started ends with it.

        An `opponent` joins it, with the environment.
        """
        with self.lock:
            if self.stopped:
                return None
            child = subprocess.Popen(command, env={**os.environ, **environment}, stdin=subprocess.DEVNULL, **PIPES)
            self.running.add(child)
        asked = []

        def look(text):
            if opponent and not asked and (found := RUN.search(text)):
                asked.append(found)
                opponent.takes({**environment, "ARMPLANE_RUN": found[1].decode(), "ARMPLANE_PROCESS": "controller"})

        ends, is_late, last = [End(child.stdout), End(child.stderr, look)], False, time.monotonic() + seconds
        try:
            while child.poll() is None and not is_late:
                has_died = opponent and opponent.has_died()
                with suppress(subprocess.TimeoutExpired):
                    child.wait(NOTICES_S if has_died else 1)
                is_late = time.monotonic() > last
                if child.poll() is None and (has_died or is_late):
                    child.send_signal(signal.SIGINT)
                    with suppress(subprocess.TimeoutExpired):
                        child.wait(PATIENCE_S)
                    break
        finally:
            killed(child)
            self.running.discard(child)
        return None if is_late or self.stopped else (child.returncode, *(end.text() for end in ends))

    def stop(self):
        with self.lock:
            self.stopped = True
            for child in self.running:
                child.send_signal(signal.SIGINT)

    def close(self):
        """Ends all opponents."""
        for thread in [*self.opponents]:
            self.dismiss(thread)


CHILDREN = Children()
