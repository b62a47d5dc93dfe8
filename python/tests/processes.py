"""Running programs, waiting for conditions, and finding processes: for tests of programs that run beside them."""

import subprocess
import time

import psutil


def ended(command, **options):
    """A program that has run to its end, with what it said; its words are separated by spaces."""
    return subprocess.run(command.split(), capture_output=True, text=True, timeout=1800, **options)


def wait(find, seconds):
    """The answer of `find`, as soon as that is something; its last answer where the time is up."""
    end = time.monotonic() + seconds
    while not (found := find()) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def having(word="", **variables):
    """Ids of the processes with these environment variables and, if it is given, a word among their arguments."""
    found = [(one.pid, *map(one.info.get, ("environ", "cmdline"))) for one in psutil.process_iter(["environ", "cmdline"])]
    return [pid for pid, environment, words in found if variables.items() <= (environment or {}).items() and (not word or word in words)]
