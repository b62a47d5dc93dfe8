"""`python -m armplane.play`: its arguments, and a folder that disappears however the page ends."""

import contextlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
from importlib.util import find_spec

from ..results import INSTALL, Parser, _program

NEEDED = ("viser", "numpy", "armplane._armplane")


def arguments():
    about = "Opens a page in the browser where you drag an arm by its hand."
    parser = Parser(prog="armplane play", description=about)
    add = parser.add_argument
    add("subject", nargs="?", default="puma560", metavar="ROBOT|SCENARIO|FILE")
    add("--host", default="127.0.0.1", help="address to listen on [default: 127.0.0.1]")
    add("--port", type=int, default=8080, help="the next free one if it is taken [default: 8080]")
    add("--no-open", action="store_true", help="print the address, open no browser")
    given = parser.parse_args()
    if not 0 < given.port < 65536:
        parser.error(f"there is no port {given.port}: give one from 1 to 65535")
    return given


@contextlib.contextmanager
def room():
    """A folder, and an open file. When the last process that holds the file is gone, killed or
    not, a shell removes the folder and what is left in memory."""
    folder = tempfile.mkdtemp(prefix="armplane-play-")
    end, keeper = os.pipe()
    # At an orderly end the page says so. A killed launcher counts as alive until it is reaped.
    script = 'read end || { sleep 2; "$1" clean; }; rm -rf "$0"'
    command = ["sh", "-c", script, folder, _program()]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    shell = subprocess.Popen(command, stdin=end, start_new_session=True, cwd="/", **quiet)
    os.close(end)
    try:
        yield folder, keeper
    finally:
        os.write(keeper, b"\n")
        os.close(keeper)
        shell.wait()


def why_not(given):
    """The sentence for a page that cannot be opened, `None` where it can."""
    if missing := [name for name in NEEDED if find_spec(name) is None]:
        return f"Python lacks {', '.join(missing)}: {INSTALL.format('play')}"
    family = socket.AF_INET6 if ":" in given.host else socket.AF_INET
    try:
        socket.create_server((given.host, 0), family=family).close()
    except OSError as error:
        remedy = "give one of its own addresses, or 0.0.0.0 for all"
        return f"this machine cannot listen on --host {given.host} ({error.strerror}): {remedy}"
    return None


def main():
    given = arguments()
    if why := why_not(given):
        print(f"armplane play: {why}", file=sys.stderr)
        return 2
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        with room() as (folder, keeper):
            from .page import Page

            is_here = given.host in ("127.0.0.1", "localhost", "::1")
            Page(given, folder, keeper, None if is_here else secrets.token_urlsafe(12)).run()
    except OSError as error:
        print(f"armplane play: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
