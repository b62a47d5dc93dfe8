"""The page's door: open to this machine, or to whoever has the token; to no other web page."""

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
        return None if here else "this page is for its own machine only: armplane play --host"
    query = urllib.parse.parse_qs(urllib.parse.urlsplit(request.path).query)
    cookies = [part.strip() for part in request.headers.get("Cookie", "").split(";")]
    given = query.get("token", []) + [one.removeprefix(f"{COOKIE}=") for one in cookies]
    if any(secrets.compare_digest(one.encode(), token.encode()) for one in given):
        return None
    return "open the address with its token, as armplane play prints it"


@contextlib.contextmanager
def guarded(token):
    """viser has no door: while its server is made, websockets' `serve` gets one."""
    serve, used = websockets.asyncio.server.serve, []

    def with_door(handler, *args, process_request, **options):
        def check(connection, request):
            if why := refusal(request, token):
                plain = Headers({"Content-Type": "text/plain"})
                return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", plain, f"{why}\n".encode())
            answer = process_request(connection, request)
            if answer is not None and token is not None and "token=" in request.path:
                cookie = f"{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
                answer.headers["Set-Cookie"] = cookie
            return answer

        used.append(True)
        return serve(handler, *args, process_request=check, **options)

    websockets.asyncio.server.serve = with_door
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve
    if not used:
        sentence = "this version of viser serves pages without a door: pip install 'viser<2'"
        raise SystemExit(f"armplane play: {sentence}")
