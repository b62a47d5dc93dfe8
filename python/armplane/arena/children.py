"""The programs that the arena starts: runs, and opponents."""

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
import uuid
from contextlib import suppress
from pathlib import Path

# An interrupted run may take so long to end; s.
PATIENCE_S = 20


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


class Child(subprocess.Popen):
    """A program in a session of its own, with more variables in its environment, and the last of what it says."""

    def __init__(self, command, variables, **more):
        super().__init__(command, env={**os.environ, **variables}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, **more)
        self.ends = End(self.stdout), End(self.stderr)

    def end(self):
        """Ends it and all in its session."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self.wait()


class Opponent(Child):
    """A process that loads an opponent's file once, and controls one trial after another. `limit`: the longest time that it may take to load, or for a tick; s."""

    def __init__(self, file, limit):
        self.file, self.limit, self.mark = file, limit, str(uuid.uuid4())
        self.answers, theirs = os.pipe()
        command = [sys.executable, "-m", "armplane.arena.host", file, str(theirs), str(limit)]
        super().__init__(command, {"ARMPLANE_OPPONENT": self.mark}, stdin=subprocess.PIPE, pass_fds=[theirs])
        os.close(theirs)

    def controls(self, given, seconds):
        """Has it control a trial, which takes at most so long. Why it has not; `None` after [`Children.stop`] or a timeout."""
        with suppress(OSError):
            self.stdin.write(f"{json.dumps(given)}\n".encode())
            self.stdin.flush()
        # It gives signs of life, one at least in a tenth of the limit, as far as its ticks are shorter.
        now = time.monotonic()
        last, due = now + seconds, now + self.limit + 1
        while now < last and not CHILDREN.stopped:
            if select.select([self.answers], [], [], 1)[0]:
                said = os.read(self.answers, 1 << 10)
                if not said or said.endswith(b"\n"):
                    return "" if said else self.last_words()
                due = time.monotonic() + 1.1 * self.limit + 1
            elif self.poll() is not None:
                return self.last_words()
            if (now := time.monotonic()) > due:
                return f"it gave no answer within {self.limit} s: --join-limit allows more"
        return None

    def last_words(self):
        """Why it could not go on, where it has said so, or how it ended."""
        with suppress(subprocess.TimeoutExpired):
            self.wait(1)
        code, lines = self.poll(), self.ends[1].text().splitlines()
        how = "it closed its pipe" if code is None else f"it ended with signal {-code}" if code < 0 else f"it ended with exit code {code}"
        return next((line.removeprefix("armplane: ") for line in reversed(lines) if line.startswith("armplane: ")), how)

    def end(self):
        """Ends it and all that it has started."""
        super().end()
        for environment in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if f"ARMPLANE_OPPONENT={self.mark}".encode() in environment.read_bytes().split(b"\0"):
                    os.kill(int(environment.parent.name), signal.SIGKILL)
        self.stdin.close()
        os.close(self.answers)


class Children:
    """The current runs, each in its own session, so that Ctrl-C ends them in order: first the arena, then its runs."""

    def __init__(self):
        self.lock, self.running, self.opponents, self.stopped = threading.Lock(), set(), {}, False

    def opponent(self, file, limit):
        """The process of an opponent's file for the trials of this thread."""
        thread = threading.get_ident()
        known = self.opponents.get(thread)
        if known is None or (known.file, known.limit) != (file, limit) or known.poll() is not None:
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
            child = Child(command, environment, stdin=subprocess.DEVNULL)
            self.running.add(child)
        is_late = False
        try:
            child.wait(seconds)
        except subprocess.TimeoutExpired:
            is_late = True
            child.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                child.wait(PATIENCE_S)
        finally:
            child.end()
            self.running.discard(child)
        return None if is_late or self.stopped else (child.returncode, *(end.text() for end in child.ends))

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
