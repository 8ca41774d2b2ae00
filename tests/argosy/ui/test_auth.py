"""Who is let in by the server of `argosy ui`: a browser with this run's token, from its own page, by its own name."""

import asyncio
from pathlib import Path

import aiohttp
import pytest

from argosy.ui import server
from argosy.ui.auth import AuthGuard
from tests.argosy.ui.serving import entered, served

EVIL = "http://evil.example"


async def test_the_printed_address_lets_a_browser_in_and_shows_its_token_to_no_history() -> None:
    async with served() as browser:
        token = f"/?token={browser.auth.token}"
        status, _, headers = await browser.get(token)
        assert (status, headers["Location"]) == (303, "/")
        cookie = headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        status, page, _ = await browser.get("/")
        assert status == 200
        assert browser.auth.token not in page


@pytest.mark.parametrize("path", ["/", "/here", "/feed", "/static/app.js", "/?token=guessed", "/here?token=TOKEN"])
async def test_without_the_cookie_nothing_is_shown(path: str) -> None:
    async with served() as browser:
        status, text, _ = await browser.get(path.replace("TOKEN", browser.auth.token))
        assert status == 401
        assert "open the address that `argosy ui` printed" in text


async def test_the_cookie_of_an_earlier_run_at_the_same_port_opens_nothing() -> None:
    async with served() as browser:
        browser.session.cookie_jar.update_cookies({browser.auth.cookie: "of an earlier run"})
        assert (await browser.get("/"))[0] == 401


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "10.0.0.5:8080", ""])
async def test_a_name_that_somebody_has_pointed_here_gets_no_answer_though_it_has_the_cookie(host: str) -> None:
    async with entered() as browser:
        assert (await browser.get("/here"))[0] == 200
        assert (await browser.get("/here", Host=host))[0] in (400, 421)


@pytest.mark.parametrize(
    "origin", [EVIL, "null", "http://127.0.0.1:1", "https://127.0.0.1:PORT", "http://localhost:PORT"]
)
@pytest.mark.parametrize("path", ["/stop", "/control", "/why", "/fleet"])
async def test_what_another_page_posts_is_refused_though_it_has_the_cookie(path: str, origin: str) -> None:
    async with entered() as browser:
        status, text = await browser.post(path, {}, Origin=origin.replace("PORT", str(browser.auth.port)))
        assert status == 403, text
        assert not browser.following.requests.last


async def test_a_post_that_does_not_say_where_it_comes_from_is_refused() -> None:
    async with entered() as browser:
        async with browser.session.post(f"{browser.base}/stop", json={"order": "hold"}) as answer:
            assert answer.status == 403
        site = {"Sec-Fetch-Site": "same-site"}  # another port of this machine
        assert (await browser.post("/stop", {"order": "hold"}, **site))[0] == 403


async def test_a_websocket_of_another_page_is_not_opened() -> None:
    async with entered() as browser:
        for origin in (EVIL, None):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await browser.session.ws_connect(f"{browser.base}/feed", origin=origin)
            assert refused.value.status == 403
        async with browser.feed() as feed:
            assert "head" in (await feed.hear())["set"]


async def test_every_answer_forbids_what_is_not_ours() -> None:
    async with entered() as browser:
        for path in ("/", "/static/app.js", "/static/vendor/leaflet/leaflet.js", "/nothing", "/here"):
            _, _, headers = await browser.get(path)
            policy = headers["Content-Security-Policy"]
            assert policy.startswith("default-src 'self'; ")
            assert "unsafe" not in policy
            assert "require-trusted-types-for 'script'" in policy
            assert "frame-ancestors 'none'" in policy
            assert headers["X-Content-Type-Options"] == "nosniff"
            assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    ("wish", "status"),
    [
        (b"x" * 20_000, 413),
        (b"{", 400),
        (b'{"order":"hold","at":1,"robots":["\xff"]}', 400),
        ({"order": "explode"}, 400),
        ({"order": "hold", "and": "more"}, 400),
        ({"order": "hold", "robots": "uav1"}, 400),
        ([], 400),
    ],
)
async def test_a_wish_that_is_none_is_refused_in_words(wish: object, status: int) -> None:
    async with entered() as browser:
        answered, text = await browser.post("/stop", wish)
        assert answered == status
        assert text.strip()
        assert not browser.following.requests.last


async def test_only_json_is_read() -> None:
    async with entered() as browser:
        kind = {"Content-Type": "text/plain"}  # what a form of another page may send without asking
        assert (await browser.post("/stop", {"order": "hold"}, **kind))[0] == 415


@pytest.mark.parametrize(
    "path", ["/static/../doors.py", "/static/%2e%2e/doors.py", "/static/..%2fdoors.py", "/tiles/../x"]
)
async def test_no_path_leads_out_of_the_static_folder(path: str, tmp_path: Path) -> None:
    (tmp_path / "tiles").mkdir()
    (tmp_path / "x").write_text("secret")
    async with entered(tiles=tmp_path / "tiles") as browser:
        reader, writer = await asyncio.open_connection("127.0.0.1", browser.auth.port)
        cookie = f"{browser.auth.cookie}={browser.auth.token}"
        request = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: {cookie}\r\nConnection: close\r\n\r\n"
        writer.write(request.encode())
        answer = await asyncio.wait_for(reader.read(), 120)
        writer.close()
        assert b" 404 " in answer.split(b"\r\n")[0] or b" 403 " in answer.split(b"\r\n")[0]
        assert b"secret" not in answer


async def test_own_tiles_are_served(tmp_path: Path) -> None:
    (tmp_path / "3" / "2").mkdir(parents=True)
    (tmp_path / "3" / "2" / "1.png").write_bytes(b"\x89PNG")
    async with entered(tiles=tmp_path) as browser:
        async with browser.session.get(f"{browser.base}/tiles/3/2/1.png") as answer:
            assert (answer.status, answer.content_type) == (200, "image/png")
        assert (await browser.get("/tiles/3/2/2.png"))[0] == 404


@pytest.mark.parametrize(
    ("listen", "host", "named"),
    [
        ("127.0.0.1", "127.0.0.1:8080", True),
        ("127.0.0.1", "localhost:9000", True),  # through an ssh tunnel
        ("127.0.0.1", "[::1]:8080", True),
        ("127.0.0.1", "[::1]", True),
        ("127.0.0.1", "10.0.0.5:8080", False),
        ("0.0.0.0", "10.0.0.5:8080", True),
        ("0.0.0.0", "evil.example:8080", False),
        ("ground.example", "ground.example:8080", True),
        ("ground.example", "GROUND.example", True),
        ("127.0.0.1", "localhost:80; script-src *", False),
        ("127.0.0.1", "localhost:", False),
        ("127.0.0.1", "127.0.0.1:80 x", False),
        ("127.0.0.1", "[::1]:80;", False),
    ],
)
def test_a_server_answers_to_addresses_and_to_its_own_names(listen: str, host: str, named: bool) -> None:
    assert AuthGuard(listen, 8080).names(host) is named


def test_each_run_has_another_token_and_does_not_show_it_in_errors() -> None:
    one, other = AuthGuard("127.0.0.1", 8080), AuthGuard("127.0.0.1", 8080)
    assert one.token != other.token
    assert len(one.token) >= 32
    assert one.token not in repr(one)


async def test_an_address_of_a_command_line_opens_once() -> None:
    async with served() as browser:
        once = browser.auth.once()
        assert browser.auth.token not in once
        path = once.partition(f":{browser.auth.port}")[2]
        assert (await browser.get("/?token=guessed"))[0] == 401
        assert (await browser.get(path))[0] == 303
        browser.session.cookie_jar.clear()
        assert (await browser.get(path))[0] == 401, "somebody else has read it"
        await browser.enter()


async def test_a_request_without_a_host_is_refused_without_a_name_look_up(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr("socket.getfqdn", lambda name="": asked.append(name) or "here")
    async with served() as browser:
        reader, writer = await asyncio.open_connection("127.0.0.1", browser.auth.port)
        writer.write(b"GET / HTTP/1.0\r\n\r\n")
        answer = await asyncio.wait_for(reader.read(), 120)
        writer.close()
    assert b" 421 " in answer.split(b"\r\n")[0]
    assert not asked


async def test_bytes_that_are_no_text_are_refused_and_are_no_defect(caplog: pytest.LogCaptureFixture) -> None:
    async with served() as browser:
        port, name = browser.auth.port, browser.auth.cookie.encode()
        for line, cookie in ((b"GET / ", b"\xff\xfe"), (b"GET /?token=%ff%fe ", b"x")):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            head = b"HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: " + name + b"=" + cookie
            writer.write(line + head + b"\r\nConnection: close\r\n\r\n")
            answer = await asyncio.wait_for(reader.read(), 120)
            writer.close()
            assert b" 401 " in answer.split(b"\r\n")[0]
    assert caplog.text == ""


async def test_silent_connections_are_closed_for_new_ones_and_pages_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "STRANGERS", 8)
    async with entered() as browser, browser.feed() as feed:
        silent = [await asyncio.open_connection("127.0.0.1", browser.auth.port) for _ in range(20)]
        async with asyncio.timeout(60):
            assert await silent[0][0].read() == b"", "the oldest was closed"
        assert not silent[-1][0].at_eof()
        assert (await browser.get("/here"))[0] == 200
        await feed.hear()
        for _, writer in silent:
            writer.close()
