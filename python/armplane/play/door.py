"""Who may open the page: this machine alone, or whoever has the token. No other web page may speak to it."""

import contextlib
import http
import secrets
import urllib.parse

import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Response

COOKIE = "armplane-play"
HERE = {"localhost", "127.0.0.1", "::1"}


def refusal(request, token):
    """Why a request is turned away; `None` where it is not."""
    host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
    if origin is not None and urllib.parse.urlsplit(origin).netloc != host:
        return "this page speaks to no other web page"
    if token is None:
        here = urllib.parse.urlsplit(f"//{host}").hostname in HERE
        return None if here else "this page is open to its own machine only: armplane play --host"
    given = urllib.parse.parse_qs(urllib.parse.urlsplit(request.path).query).get("token", [])
    given += [part.strip().removeprefix(f"{COOKIE}=") for part in request.headers.get("Cookie", "").split(";")]
    return None if any(secrets.compare_digest(one.encode(), token.encode()) for one in given) else "open the address with its token, as armplane play prints it"


@contextlib.contextmanager
def guarded(token):
    """viser has no door of its own: while its server is made, websockets' `serve` gets one."""
    serve = websockets.asyncio.server.serve

    def with_door(handler, *args, process_request, **options):
        def check(connection, request):
            if why := refusal(request, token):
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", Headers({"Content-Type": "text/plain"}), f"{why}\n".encode())
            answer = process_request(connection, request)
            if answer is not None and token is not None and "token=" in request.path:
                answer.headers["Set-Cookie"] = f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
            return answer

        with_door.used = True
        return serve(handler, *args, process_request=check, **options)

    websockets.asyncio.server.serve = with_door
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
    if not hasattr(with_door, "used"):
        raise SystemExit("armplane play: this version of viser serves the page in another way, without a door: pip install 'viser<2'")
