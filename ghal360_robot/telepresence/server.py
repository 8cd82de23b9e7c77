"""The page's web server: its files, the login, one small socket for control and one for pictures per page.

Whoever is no page of this robot is refused before anything else happens: another name for its address (421), another
site's script or none at all (403), no login (401), too many (429, 503).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import mimetypes
import socket
import ssl
import time
from typing import TYPE_CHECKING

from aiohttp import WSCloseCode, WSMsgType, web

from ghal360_robot.telepresence.access import (
    COOKIE,
    SESSION_NS,
    Role,
    Sessions,
    allowed_hosts,
    host_allowed,
    origin_allowed,
)
from ghal360_robot.telepresence.allowance import Allowance
from ghal360_robot.telepresence.hub import BEAT_S, FloodError, Hub
from ghal360_robot.telepresence.protocol import MAX_TEXT_BYTES
from ghal360_robot.telepresence.viewer import Viewer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

    from ghal360_robot.telepresence.settings import PageSettings
    from ghal360_robot.telepresence.streams import Streams

    Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

LOGIN_BYTES = 512
LOGIN_HZ, LOGIN_BURST = 0.5, 10.0
"""Guessing 24 random bytes takes for ever anyway; this keeps the log readable."""

HEARTBEAT_S = 5.0
"""A vanished page's socket is closed after this and a half; the dead man has acted long before."""

UNSENT_BYTES = 64 << 10
"""What the kernel may hold of a connection beyond what is on its way: a 2K picture's worth, not a second's."""

SEND_BYTES = 256 << 10

CLOSE_S = 0.5
GOODBYE_S = 0.5
"""A page that does not answer a closing handshake is left."""

CSP = (
    "default-src 'self'; img-src 'self' data: blob:; worker-src 'self' blob:; "
    "style-src 'self' 'unsafe-inline'; "  # A-Frame brings its styles as elements of its own
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": CSP,
    "Permissions-Policy": "xr-spatial-tracking=(self), gyroscope=(self), accelerometer=(self), gamepad=(self), "
    "camera=(), microphone=(), geolocation=()",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
NOT_BUILT = (
    "The telepresence page is not built: install Node 20 or newer and run `make page` in ghal360-robot's folder, "
    "then load this again."
)

logger = logging.getLogger(__name__)
mimetypes.add_type("text/javascript", ".js")


class PageServer:
    """`await start()`, run `beat()`; `port` says where it listens; `await close()`. `root` holds the built page."""

    def __init__(
        self,
        settings: PageSettings,
        hub: Hub,
        streams: Streams,
        sessions: Sessions | None,
        root: Path,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.settings = settings
        self.hub = hub
        self.port = settings.port
        self._streams = streams
        self._sessions = sessions
        """None where everybody who reaches the server may drive: on loopback."""
        self._root = root
        self._clock = clock
        self._hosts: frozenset[str] = frozenset()
        self._logins = Allowance(LOGIN_HZ, LOGIN_BURST)
        self._complaints = Allowance(1.0, 10.0)
        self._videos = 0
        self._sockets: set[web.WebSocketResponse] = set()
        self._runner: web.AppRunner

    async def start(self) -> None:
        """Listen. Raises OSError where the address is taken, ssl.SSLError for a certificate that is none."""
        s = self.settings
        context = None
        if s.tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            context.load_cert_chain(s.certificate, s.key)
        app = web.Application(middlewares=[self._guard], client_max_size=LOGIN_BYTES)
        app.router.add_post("/login", self._log_in)
        app.router.add_post("/logout", self._log_out)
        app.router.add_get("/whoami", self._who)
        app.router.add_get("/ctl", self._control)
        app.router.add_get("/video", self._video)
        app.router.add_get("/{path:.*}", self._file)
        self._runner = web.AppRunner(app, access_log=None, shutdown_timeout=CLOSE_S)
        await self._runner.setup()
        site = web.TCPSite(self._runner, s.listen, s.port, ssl_context=context)
        await site.start()
        self.port = self._runner.addresses[0][1]
        self._hosts = allowed_hosts(s.listen, self.port, s.names)

    async def close(self) -> None:
        """Close every page, then the server."""
        goodbyes = [ws.close(code=WSCloseCode.GOING_AWAY, message=b"the robot ends") for ws in self._sockets]
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                await asyncio.gather(*goodbyes, return_exceptions=True)
        await self._runner.cleanup()

    async def beat(self) -> None:
        """Keep lease, lock and delays going, until cancelled."""
        while True:
            self.hub.beat()
            await asyncio.sleep(BEAT_S)

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse who is not meant; the same headers on every answer."""
        tls = self.settings.tls
        host = request.headers.get("Host")
        try:
            if not host_allowed(host, self._hosts, tls=tls):
                raise self._refused(request, web.HTTPMisdirectedRequest, f"this robot is not called {host!r:.80}")
            sensitive = request.method != "GET" or request.path in {"/ctl", "/video"}
            origin = request.headers.get("Origin")
            if sensitive and not origin_allowed(origin, host, tls=tls):
                raise self._refused(request, web.HTTPForbidden, f"a page of {origin!r:.80} asks, not this robot's")
            response = await handler(request)
        except web.HTTPException as refusal:
            refusal.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
            if tls:
                response.headers["Strict-Transport-Security"] = "max-age=31536000"
        return response

    def _refused(
        self, request: web.Request, kind: type[web.HTTPClientError | web.HTTPServerError], why: str
    ) -> web.HTTPException:
        if self._complaints.spend(self._clock()):
            logger.warning("refused %s %s of %s: %s", request.method, request.path[:80], request.remote, why)
        return kind(text=why)

    def _role(self, request: web.Request) -> Role:
        if self._sessions is None:
            return Role.DRIVER
        role = self._sessions.role(request.cookies.get(COOKIE), self._clock())
        if role is None:
            raise self._refused(request, web.HTTPUnauthorized, "no login: open the address with its token again")
        return role

    async def _log_in(self, request: web.Request) -> web.StreamResponse:
        if request.content_type != "application/json":
            raise self._refused(request, web.HTTPUnsupportedMediaType, "a login is JSON")
        try:
            data = json.loads(await request.text())
        except (ValueError, RecursionError):
            raise self._refused(request, web.HTTPBadRequest, "a login is JSON") from None
        token = data.get("token") if isinstance(data, dict) else None
        if not isinstance(token, str):
            raise self._refused(request, web.HTTPBadRequest, "a login names its token")
        if self._sessions is None:
            return web.json_response({"role": Role.DRIVER.value})
        if not self._logins.spend(self._clock()):
            raise self._refused(request, web.HTTPTooManyRequests, "too many logins; wait a minute")
        session = self._sessions.log_in(token, self._clock())
        if session is None:
            raise self._refused(request, web.HTTPUnauthorized, "wrong token")
        response = web.json_response({"role": session[1].value})
        response.set_cookie(
            COOKIE,
            session[0],
            httponly=True,
            secure=self.settings.tls,
            samesite="Strict",
            path="/",
            max_age=SESSION_NS // 1_000_000_000,
        )
        return response

    async def _who(self, request: web.Request) -> web.StreamResponse:
        """What the bearer of this cookie may do: a browser does not say why a socket was refused."""
        return web.json_response({"role": self._role(request).value})

    async def _log_out(self, request: web.Request) -> web.StreamResponse:
        if self._sessions is not None:
            self._sessions.log_out(request.cookies.get(COOKIE))
        response = web.json_response({})
        response.del_cookie(COOKIE, path="/")
        return response

    async def _file(self, request: web.Request) -> web.StreamResponse:
        """A file of the built page; nobody needs to be known for that."""
        name = request.match_info["path"] or "index.html"
        path = (self._root / name).resolve()
        if name == "index.html" and not path.is_file():
            raise web.HTTPServiceUnavailable(text=NOT_BUILT)
        if not path.is_relative_to(self._root.resolve()) or not path.is_file():
            raise web.HTTPNotFound(text="there is no such file")
        return web.FileResponse(path)

    async def _control(self, request: web.Request) -> web.StreamResponse:
        role = self._role(request)
        if len(self.hub.connections) >= self.settings.viewers:
            raise self._refused(request, web.HTTPServiceUnavailable, "too many pages are open")
        ws = web.WebSocketResponse(max_msg_size=MAX_TEXT_BYTES, heartbeat=HEARTBEAT_S, compress=False)
        await ws.prepare(request)
        _no_delay(request)
        connection = self.hub.join(role, request.remote or "?")
        self._sockets.add(ws)

        async def send() -> None:
            while True:
                for text in await connection.outbox.take():
                    await ws.send_str(text)

        sending = asyncio.create_task(_quietly(send()), name="page control")
        try:
            async for message in ws:
                if message.type is not WSMsgType.TEXT:
                    await ws.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b"text only")
                    break
                self.hub.take(connection, message.data)
            if ws.close_code not in {None, WSCloseCode.OK, WSCloseCode.GOING_AWAY, WSCloseCode.ABNORMAL_CLOSURE}:
                logger.warning("%s was closed with status %s", connection.name, ws.close_code)
        except FloodError as error:
            self.hub.leave(connection)
            logger.warning("closed: %s", error)
            await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=str(error).encode()[:120])
        finally:
            self.hub.leave(connection)
            self._sockets.discard(ws)
            sending.cancel()
        return ws

    async def _video(self, request: web.Request) -> web.StreamResponse:
        self._role(request)
        connection = self.hub.connections.get(request.query.get("conn", ""))
        if connection is None:
            raise self._refused(request, web.HTTPUnauthorized, "pictures go to open pages only")
        stream = self._streams.get(request.query.get("stream", "camera"))
        if stream is None:
            raise self._refused(request, web.HTTPNotFound, "there is no such stream")
        if self._videos >= self.settings.viewers:
            raise self._refused(request, web.HTTPServiceUnavailable, "too many pages are open")
        ws = web.WebSocketResponse(max_msg_size=16, heartbeat=HEARTBEAT_S, compress=False)
        viewer = Viewer(connection.delays, self._clock)
        self._videos += 1
        try:
            await ws.prepare(request)
            _no_delay(request)
            connection.video = viewer
            self._sockets.add(ws)

            async def send() -> None:
                viewer.begin(stream.group(self._clock()))
                with stream.watched_by(viewer.offer):
                    while True:
                        await ws.send_bytes(await viewer.take())

            sending = asyncio.create_task(_quietly(send()), name="page pictures")
            try:
                async for _ in ws:
                    await ws.close(code=WSCloseCode.POLICY_VIOLATION, message=b"nothing is expected here")
            finally:
                sending.cancel()
        finally:
            self._videos -= 1
            self._sockets.discard(ws)
            if connection.video is viewer:
                connection.video = None
        return ws


async def _quietly(sending: Awaitable[None]) -> None:
    """A page that closes in the middle of a message is no event."""
    with contextlib.suppress(ConnectionError):
        await sending


def _no_delay(request: web.Request) -> None:
    """Small messages at once, and no second of video in the kernel's buffers."""
    transport = request.transport
    sock = None if transport is None else transport.get_extra_info("socket")
    if sock is None:
        return
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BYTES)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
