"""Waiting for conditions, and finding processes: for tests of programs that run beside them."""

import contextlib
import pathlib
import time


def wait(find, seconds):
    """The answer of `find`, as soon as that is something; its last answer where the time is up."""
    end = time.monotonic() + seconds
    while not (found := find()) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def having(*variables):
    """Ids of the processes with these environment variables, `NAME=VALUE` each."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if {one.encode() for one in variables} <= {*path.read_bytes().split(b"\0")}:
                found.append(int(path.parent.name))
    return found
