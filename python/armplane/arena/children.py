"""The programs that the arena starts: runs, and opponents."""

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

# An interrupted run may take so long to end; s.
PATIENCE_S = 20
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "start_new_session": True}


class End(threading.Thread):
    """Reads all that a program writes, and keeps the last of it: one that floods neither waits nor fills the memory."""

    KEPT = 1 << 16

    def __init__(self, stream):
        super().__init__(daemon=True)
        self.stream, self.kept = stream, b""
        self.start()

    def run(self):
        while part := self.stream.read1(self.KEPT):
            self.kept = (self.kept + part)[-self.KEPT :]

    def text(self):
        self.join(1)
        return self.kept.decode(errors="replace")


def killed(child):
    """Ends a program and all that it has started."""
    with suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


class Opponent:
    """A process that loads an opponent's file once, and controls one trial after another. `limit`: the longest time that it may take to load, or for a tick; s."""

    def __init__(self, file, limit):
        self.file, self.limit = file, limit
        self.answers, theirs = os.pipe()
        command = [sys.executable, "-m", "armplane.arena.host", file, str(theirs), str(limit)]
        self.child = subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=[theirs], **PIPES)
        os.close(theirs)
        self.ends = End(self.child.stdout), End(self.child.stderr)

    def controls(self, given, seconds):
        """Has it control a trial, which takes at most so long. Why it has not; `None` after [`Children.stop`] or a timeout."""
        with suppress(OSError):
            self.child.stdin.write(f"{json.dumps(given)}\n".encode())
            self.child.stdin.flush()
        last = time.monotonic() + seconds
        while time.monotonic() < last and not CHILDREN.stopped:
            if select.select([self.answers], [], [], 1)[0] or self.has_died():
                return "" if os.read(self.answers, 1) else self.last_words()
        return None

    def has_died(self):
        return self.child.poll() is not None

    def last_words(self):
        """Why it could not go on, where it has said so."""
        lines = self.ends[1].text().splitlines()
        if any(line.startswith("Timeout (") for line in lines):
            return f"it gave no answer within {self.limit} s: --join-limit allows more"
        return next((line.removeprefix("armplane: ") for line in reversed(lines) if line.startswith("armplane: ")), "it ended without a word")

    def end(self):
        killed(self.child)
        self.child.stdin.close()
        os.close(self.answers)


class Children:
    """The current runs, each in its own session, so that Ctrl-C ends them in order: first the arena, then its runs."""

    def __init__(self):
        self.lock, self.running, self.opponents, self.stopped = threading.Lock(), set(), {}, False

    def opponent(self, file, limit):
        """The process of an opponent's file for the trials of this thread."""
        thread = threading.get_ident()
        known = self.opponents.get(thread)
        if known is None or (known.file, known.limit) != (file, limit) or known.has_died():
            self.dismiss(thread)
            known = self.opponents[thread] = Opponent(file, limit)
        return known

    def dismiss(self, thread=None):
        """Ends the opponent of this thread, or of another."""
        if known := self.opponents.pop(thread or threading.get_ident(), None):
            known.end()

    def run(self, command, seconds, **environment):
        """Exit code, standard output and standard error of a program, or `None` after [`stop`] or a timeout. Whatever it has started ends with it."""
        with self.lock:
            if self.stopped:
                return None
            child = subprocess.Popen(command, env={**os.environ, **environment}, stdin=subprocess.DEVNULL, **PIPES)
            self.running.add(child)
        ends, is_late = [End(child.stdout), End(child.stderr)], False
        try:
            child.wait(seconds)
        except subprocess.TimeoutExpired:
            is_late = True
            child.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                child.wait(PATIENCE_S)
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
