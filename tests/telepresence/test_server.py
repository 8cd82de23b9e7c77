"""The server over real sockets on loopback: who gets in, who does not, and with which status."""

from __future__ import annotations

import asyncio
import contextlib
import json
import ssl
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import aiohttp
import pytest

from ghal360_robot.telepresence import certificates
from ghal360_robot.telepresence.access import COOKIE, Role, Sessions
from ghal360_robot.telepresence.frames import HEADER, Frame
from ghal360_robot.telepresence.hub import Hub
from ghal360_robot.telepresence.server import HEADERS, NOT_BUILT, PageServer
from ghal360_robot.telepresence.settings import PageSettings
from ghal360_robot.telepresence.streams import Streams
from tests.telepresence.test_access import TOKENS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

SETTINGS = PageSettings(port=0, viewers=3, names=("robot.local",))


@dataclass
class Stand:
    """A server with nothing behind it, and a browser's way of asking."""

    server: PageServer
    http: aiohttp.ClientSession
    streams: Streams
    told: list[tuple[str, Any]] = field(default_factory=list)

    @property
    def asked_of_the_robot(self) -> list[str]:
        return [kind for kind, _ in self.told if kind in {"operator", "received", "stop"}]

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server.port}"

    async def status(self, path: str, *, method: str = "GET", **words: Any) -> int:
        async with self.http.request(method, self.url + path, **words) as answer:
            return answer.status

    @contextlib.asynccontextmanager
    async def socket(self, path: str = "/ctl", **headers: str) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
        asked = {"Origin": self.url, **headers}
        async with self.http.ws_connect(self.url + path, headers=asked) as ws:
            yield ws

    async def refusal(self, path: str = "/ctl", **headers: str) -> int:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            async with self.socket(path, **headers):
                pass
        return refused.value.status

    async def log_in(self, role: Role) -> str:
        async with self.http.post(
            f"{self.url}/login", json={"token": TOKENS[role]}, headers={"Origin": self.url}
        ) as answer:
            assert answer.status == 200
            assert (await answer.json())["role"] == role.value
            cookie = answer.headers["Set-Cookie"]
        assert all(word in cookie for word in ("HttpOnly", "SameSite=Strict", "Path=/"))
        return cookie.split(";")[0]


async def hello(ws: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
    return await heard(ws, "hello")


async def heard(ws: aiohttp.ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    async with asyncio.timeout(5):
        while True:
            message: dict[str, Any] = await ws.receive_json()
            if message["kind"] == kind:
                return message


async def has_the_controls(ws: aiohttp.ClientWebSocketResponse) -> None:
    while not (await heard(ws, "right"))["yours"]:
        pass


async def closed(ws: aiohttp.ClientWebSocketResponse) -> int | None:
    async with asyncio.timeout(5):
        async for _ in ws:
            pass
    return ws.close_code


@contextlib.asynccontextmanager
async def serving(root: Path, settings: PageSettings = SETTINGS, *, tokens: bool = False) -> AsyncIterator[Stand]:
    told: list[tuple[str, Any]] = []
    clock = asyncio.get_running_loop().time

    def now_ns() -> int:
        return round(clock() * 1e9)

    hub = Hub(settings, lambda kind, value: told.append((kind, value)), now_ns)
    streams = Streams(settings)
    server = PageServer(settings, hub, streams, Sessions(TOKENS) if tokens else None, root, now_ns)
    jar = aiohttp.DummyCookieJar()
    async with aiohttp.ClientSession(cookie_jar=jar) as http:
        await server.start()
        beating = asyncio.create_task(server.beat())
        try:
            with streams:
                yield Stand(server, http, streams, told)
        finally:
            beating.cancel()
            await server.close()


@pytest.fixture
async def stand(tmp_path: Path) -> AsyncIterator[Stand]:
    (tmp_path / "index.html").write_text("<h1>the page</h1>")
    async with serving(tmp_path) as running:
        yield running


@pytest.fixture
async def guarded(tmp_path: Path) -> AsyncIterator[Stand]:
    (tmp_path / "index.html").write_text("<h1>the page</h1>")
    async with serving(tmp_path, tokens=True) as running:
        yield running


async def test_the_page_comes_with_strict_headers(stand: Stand) -> None:
    async with stand.http.get(stand.url) as answer:
        assert answer.status == 200
        assert await answer.text() == "<h1>the page</h1>"
        assert all(answer.headers[name] == value for name, value in HEADERS.items())
    policy = HEADERS["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy
    assert "script-src" not in policy


async def test_a_page_that_was_not_built_says_what_to_do(tmp_path: Path) -> None:
    async with serving(tmp_path) as stand, stand.http.get(stand.url) as answer:
        assert answer.status == 503
        assert await answer.text() == NOT_BUILT


@pytest.mark.parametrize("path", ["/../secret", "/%2e%2e/secret", "/..%2fsecret", "//etc/passwd", "/x\0", "/link", "/"])
async def test_nothing_outside_the_page_is_served(tmp_path: Path, path: str) -> None:
    (tmp_path / "secret").write_text("secret")
    root = tmp_path / "root"
    root.mkdir()
    (root / "link").symlink_to(tmp_path / "secret")
    async with serving(root) as stand:
        reader, writer = await asyncio.open_connection("127.0.0.1", stand.server.port)
        writer.write(
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{stand.server.port}\r\nConnection: close\r\n\r\n".encode()
        )
        answer = await asyncio.wait_for(reader.read(), 5)
        writer.close()
    assert answer.split()[1] in {b"400", b"404", b"503"}
    assert b"secret" not in answer.split(b"\r\n\r\n", 1)[1]


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8360", "127.0.0.1:1", ""])
@pytest.mark.parametrize("path", ["/", "/ctl", "/video", "/whoami"])
async def test_another_name_for_this_address_is_misdirected(stand: Stand, path: str, host: str) -> None:
    assert await stand.status(path, headers={"Host": host}) == 421


async def test_the_robots_own_name_is_answered_to(stand: Stand) -> None:
    assert await stand.status("/", headers={"Host": f"robot.local:{stand.server.port}"}) == 200


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "", "http://127.0.0.1:1", "http://localhost.evil"])
@pytest.mark.parametrize("path", ["/ctl", "/video?conn=x"])
async def test_another_sites_script_is_forbidden(stand: Stand, path: str, origin: str) -> None:
    assert await stand.refusal(path, Origin=origin) == 403
    assert stand.asked_of_the_robot == []


async def test_a_socket_without_origin_is_forbidden(stand: Stand) -> None:
    upgrade = {
        "Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }  # fmt: skip
    assert await stand.status("/ctl", headers=upgrade) == 403
    assert await stand.status("/login", method="POST", json={"token": "x"}) == 403


async def test_without_a_login_there_is_no_socket(guarded: Stand) -> None:
    for cookie in ("", f"{COOKIE}=guess", f"{COOKIE}={TOKENS[Role.DRIVER]}"):
        assert await guarded.refusal(Cookie=cookie) == 401
        assert await guarded.refusal("/video?conn=x", Cookie=cookie) == 401
        assert await guarded.status("/whoami", headers={"Cookie": cookie}) == 401
    assert guarded.server.hub.connections == {}


@pytest.mark.parametrize("role", list(Role))
async def test_a_token_becomes_a_strict_cookie_of_its_role(guarded: Stand, role: Role) -> None:
    cookie = await guarded.log_in(role)
    async with guarded.socket(Cookie=cookie) as ws:
        assert (await hello(ws))["role"] == role.value
        await ws.send_json({"kind": "lease", "wish": "ask"})
        if role is Role.DRIVER:
            await has_the_controls(ws)
        else:
            assert "not drive" in (await heard(ws, "refused"))["why"]
    origin = {"Origin": guarded.url, "Cookie": cookie}
    assert await guarded.status("/logout", method="POST", headers=origin) == 200
    assert await guarded.refusal(Cookie=cookie) == 401


@pytest.mark.parametrize(
    ("body", "kind", "status"),
    [
        ('{"token": "wrong"}', "application/json", 401), ('{"token": 7}', "application/json", 400),
        ("[]", "application/json", 400), ("{", "application/json", 400), ("[" * 400, "application/json", 400),
        ('{"token": "x"}', "text/plain", 415), ('{"token": "' + "x" * 600 + '"}', "application/json", 413),
    ],
)  # fmt: skip
async def test_a_login_that_is_none(guarded: Stand, body: str, kind: str, status: int) -> None:
    headers = {"Origin": guarded.url, "Content-Type": kind}
    assert await guarded.status("/login", method="POST", data=body, headers=headers) == status


async def test_guessing_tokens_is_slowed_down(guarded: Stand) -> None:
    headers = {"Origin": guarded.url}
    statuses = [
        await guarded.status("/login", method="POST", json={"token": str(n)}, headers=headers) for n in range(20)
    ]
    assert statuses.count(429) >= 8


async def test_too_many_pages_are_refused(stand: Stand) -> None:
    async with stand.socket(), stand.socket(), stand.socket():
        assert await stand.refusal() == 503


async def test_an_oversized_message_closes_with_1009(stand: Stand) -> None:
    async with stand.socket() as ws:
        await hello(ws)
        await ws.send_str('"' + "x" * 5000 + '"')
        assert await closed(ws) == 1009


async def test_binary_on_the_control_socket_closes_with_1003(stand: Stand) -> None:
    async with stand.socket() as ws:
        await ws.send_bytes(b"\0")
        assert await closed(ws) == 1003


async def test_malformed_messages_are_told_and_then_closed_with_1008(stand: Stand) -> None:
    async with stand.socket() as ws:
        await ws.send_str("{")
        assert "malformed" in (await heard(ws, "refused"))["why"]
        for _ in range(5):
            await ws.send_str('{"kind": "operate"}')
        assert await closed(ws) == 1008
    assert stand.asked_of_the_robot == []


async def test_a_flood_closes_with_1008_and_frees_the_controls(stand: Stand) -> None:
    async with stand.socket() as ws:
        await ws.send_json({"kind": "lease", "wish": "ask"})
        await has_the_controls(ws)
        for _ in range(400):
            await ws.send_str('{"kind":"ping","t0":0}')
        assert await closed(ws) == 1008
    assert stand.server.hub.driver is None


async def test_a_vanished_driver_frees_the_controls(stand: Stand) -> None:
    async with stand.socket() as ws:
        await ws.send_json({"kind": "lease", "wish": "ask"})
        await has_the_controls(ws)
        transport = ws._response.connection.transport  # type: ignore[union-attr]
        assert transport is not None
        transport.abort()
        async with asyncio.timeout(5):
            while stand.server.hub.driver is not None:
                await asyncio.sleep(0.01)


async def test_pictures_go_to_open_pages_only(stand: Stand) -> None:
    assert await stand.refusal("/video?conn=guess") == 401
    async with stand.socket() as ws:
        conn = (await hello(ws))["conn"]
        assert await stand.refusal(f"/video?conn={conn}&stream=none") == 404


async def test_a_page_gets_every_picture_from_the_first_key_picture_on(stand: Stand) -> None:
    async with stand.socket() as ws:
        conn = (await hello(ws))["conn"]
        async with stand.socket(f"/video?conn={conn}") as video:
            camera = stand.streams.get("camera")
            assert camera is not None
            async with asyncio.timeout(5):
                while not camera.watched:
                    await asyncio.sleep(0.01)
            now_ns = stand.server._clock()
            for sequence in range(5):
                camera.give(Frame(b"\0\0\1\x09" * 9, now_ns, sequence, 64, 32, sequence == 1))
            async with asyncio.timeout(5):
                got = [HEADER.unpack((await video.receive_bytes())[:24])[3] for _ in range(4)]
        assert got == [1, 2, 3, 4]


async def test_what_a_page_says_on_the_picture_socket_closes_it(stand: Stand) -> None:
    async with stand.socket() as ws:
        conn = (await hello(ws))["conn"]
        async with stand.socket(f"/video?conn={conn}") as video:
            await video.send_str("hello")
            assert await closed(video) == 1008


async def test_a_page_that_fetches_nothing_holds_nobody_up(stand: Stand) -> None:
    """Its own pictures are dropped, memory stays bounded, the other page gets all of them."""
    async with stand.socket() as one, stand.socket() as two:
        stuck, live = [(await hello(ws))["conn"] for ws in (one, two)]
        async with stand.socket(f"/video?conn={stuck}"), stand.socket(f"/video?conn={live}") as video:
            camera = stand.streams.get("camera")
            assert camera is not None
            async with asyncio.timeout(5):
                while len(camera._watchers) < 2:
                    await asyncio.sleep(0.01)
            for sequence in range(200):
                frame = Frame(b"\1" * 200_000, stand.server._clock(), sequence, 64, 32, sequence % 10 == 0)
                camera.give(frame)
                async with asyncio.timeout(5):
                    message = await video.receive_bytes()
                assert HEADER.unpack(message[:24])[3] == sequence
                await two.send_json({"kind": "shown", "seq": sequence, "dropped": 0})
                await asyncio.sleep(0.005)
            viewer = stand.server.hub.connections[stuck].video
            assert viewer is not None
            assert viewer.dropped > 50


async def test_over_tls_the_cookie_is_secure_and_http_gets_nothing(tmp_path: Path) -> None:
    made = certificates.make(tmp_path, ("localhost",))
    settings = replace(SETTINGS, certificate=str(made.certificate), key=str(made.key))
    (tmp_path / "index.html").write_text("x")
    async with serving(tmp_path, settings, tokens=True) as stand:
        url = f"https://localhost:{stand.server.port}"
        trust = ssl.create_default_context(cafile=made.authority)
        async with stand.http.post(
            f"{url}/login", json={"token": TOKENS[Role.DRIVER]}, headers={"Origin": url}, ssl=trust
        ) as answer:
            assert answer.status == 200
            assert "Secure" in answer.headers["Set-Cookie"]
            assert "Strict-Transport-Security" in answer.headers
        with pytest.raises(aiohttp.ClientError):
            await stand.status("/")
        with pytest.raises(aiohttp.ClientConnectorCertificateError):
            await stand.http.get(url)


def test_settings_survive_the_way_to_the_process() -> None:
    settings = replace(SETTINGS, names=("a", "b"), blind=(1.0, 2.0))
    assert PageSettings.from_json(settings.to_json()) == settings
    assert json.loads(settings.to_json())["robot"] == "ghal360"
