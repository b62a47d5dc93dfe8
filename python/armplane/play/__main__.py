"""`python -m armplane.play`: the arguments, and a guard that outlives the page and leaves nothing behind."""

import argparse
import contextlib
import ctypes
import os
import pathlib
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import traceback
import webbrowser
from importlib.util import find_spec

_LIBC = ctypes.CDLL(None)
_PDEATHSIG, _SUBREAPER = 1, 36
# A page that is killed, or ends by a defect of its own, is started again so often.
STARTS, DEFECT = 5, 70


def arguments():
    parser = argparse.ArgumentParser(prog="armplane play", description="Opens a page in the browser on which you take the hand of an arm and drag it.")
    parser.add_argument("subject", nargs="?", default="puma560", metavar="ROBOT|SCENARIO|FILE", help="a built-in robot or scenario, a URDF, MJCF or scenario file [default: puma560]")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; other than this machine's own, the page's address has a token [default: 127.0.0.1]")
    parser.add_argument("--port", type=int, default=8080, help="port; the next free one if it is taken [default: 8080]")
    parser.add_argument("--no-open", action="store_true", help="print the address, open no browser")
    return parser.parse_args()


def show(given, folder, token, is_first):
    """The page, until it is told to end."""
    from .page import Page

    page = Page(given.subject, folder, given.host, given.port, token)
    name = "localhost" if token is None else socket.gethostname() if given.host in ("0.0.0.0", "::") else given.host
    address = f"http://{f'[{name}]' if ':' in name else name}:{page.server.get_port()}/" + (f"?token={token}" if token else "")
    # Nobody may be there to read it.
    with contextlib.suppress(OSError):
        print(f"armplane play: {address}  (Ctrl-C ends it)", flush=True)
    if is_first and not given.no_open:
        webbrowser.open(address)
    page.run()


def child(given, folder, token, is_first):
    _LIBC.prctl(_PDEATHSIG, signal.SIGTERM)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        show(given, folder, token, is_first)
    except SystemExit as end:
        if end.code:
            print(end.code, file=sys.stderr)
        return 1 if end.code else 0
    except BaseException:
        traceback.print_exc()
        return DEFECT
    return 0


def sweep():
    """Removes what guards that were killed have left."""
    from .session import clean

    def is_left(folder):
        guard = folder.name.split("-")[2]
        return folder.owner() == pathlib.Path.home().owner() and guard.isdecimal() and not os.path.exists(f"/proc/{guard}")

    left = [*filter(is_left, pathlib.Path(tempfile.gettempdir()).glob("armplane-play-*-*"))]
    for folder in left:
        shutil.rmtree(folder, ignore_errors=True)
    if left:
        clean()


def main():
    given = arguments()
    if missing := [name for name in ("viser", "numpy", "armplane._armplane") if find_spec(name) is None]:
        print(f"armplane play: Python lacks {', '.join(missing)}: pip install the wheel that `python/build` makes, with its extra [play] (docs/play.md)", file=sys.stderr)
        return 2
    token = None if given.host in ("127.0.0.1", "localhost", "::1") else secrets.token_urlsafe(12)
    try:
        socket.create_server((given.host, 0), family=socket.AF_INET6 if ":" in given.host else socket.AF_INET).close()
    except OSError as error:
        print(f"armplane play: this machine cannot listen on --host {given.host} ({error.strerror}): give one of its own addresses, or 0.0.0.0 for all", file=sys.stderr)
        return 2
    sweep()
    folder, page = tempfile.mkdtemp(prefix=f"armplane-play-{os.getpid()}-"), 0
    # The runs of a page that was killed become this process's children, and end by themselves.
    _LIBC.prctl(_SUBREAPER, 1)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda number, _: page and os.kill(page, signal.SIGTERM))
    try:
        for start in range(STARTS):
            page = os.fork()
            if page == 0:
                os._exit(child(given, folder, token, start == 0))
            _, status = os.waitpid(page, 0)
            code = os.waitstatus_to_exitcode(status)
            if code >= 0 and code != DEFECT:
                return code
            why = f"was ended by signal {-code}" if code < 0 else "ended by a defect of its own"
            print(f"armplane play: the page {why} and is started again", file=sys.stderr, flush=True)
        return 1
    finally:
        while True:
            try:
                os.wait()
            except ChildProcessError:
                break
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
