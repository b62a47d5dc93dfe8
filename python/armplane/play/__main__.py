"""`python -m armplane.play`: the arguments, and a folder for the runs that disappears however the page ends."""

import argparse
import contextlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
from importlib.util import find_spec

from ..results import _program


def arguments():
    parser = argparse.ArgumentParser(prog="armplane play", description="Opens a page in the browser on which you take the hand of an arm and drag it.")
    parser.add_argument("subject", nargs="?", default="puma560", metavar="ROBOT|SCENARIO|FILE", help="a built-in robot or scenario, a URDF, MJCF or scenario file [default: puma560]")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; other than this machine's own, the page's address has a token [default: 127.0.0.1]")
    parser.add_argument("--port", type=int, default=8080, help="port; the next free one if it is taken [default: 8080]")
    parser.add_argument("--no-open", action="store_true", help="print the address, open no browser")
    return parser.parse_args()


@contextlib.contextmanager
def room():
    """A folder, and an open file. When the last process that holds the file is gone, killed or not, a shell removes the folder and what is left in memory."""
    folder = tempfile.mkdtemp(prefix="armplane-play-")
    end, keeper = os.pipe()
    command = ["sh", "-c", 'cat; "$1" clean; rm -rf "$0"', folder, _program()]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    shell = subprocess.Popen(command, stdin=end, start_new_session=True, cwd="/", **quiet)
    os.close(end)
    try:
        yield folder, keeper
    finally:
        os.close(keeper)
        shell.wait()


def main():
    given = arguments()
    if missing := [name for name in ("viser", "numpy", "armplane._armplane") if find_spec(name) is None]:
        print(f"armplane play: Python lacks {', '.join(missing)}: pip install the wheel that `python/build` makes, with its extra [play] (docs/play.md)", file=sys.stderr)
        return 2
    try:
        socket.create_server((given.host, 0), family=socket.AF_INET6 if ":" in given.host else socket.AF_INET).close()
    except OSError as error:
        print(f"armplane play: this machine cannot listen on --host {given.host} ({error.strerror}): give one of its own addresses, or 0.0.0.0 for all", file=sys.stderr)
        return 2
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        with room() as (folder, keeper):
            from .page import Page

            token = None if given.host in ("127.0.0.1", "localhost", "::1") else secrets.token_urlsafe(12)
            Page(given, folder, keeper, token).run()
    except OSError as error:
        print(f"armplane play: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
