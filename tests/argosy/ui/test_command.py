"""`argosy ui` as a command: what it prints, what it refuses, and that it ends when it is told to."""

import json
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from argparse import Namespace
from collections.abc import Callable
from http.client import HTTPResponse
from http.cookiejar import CookieJar
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.ui import command
from argosy.ui.auth import AuthGuard
from tests.support.processes import Daemon, running


def address(daemon: Daemon) -> str:
    daemon.says("open http://")
    found = re.search(r"^open (http://127\.0\.0\.1:\d+/\?token=\S{32})$", daemon.text, re.M)
    assert found, daemon.text
    return found[1]


def opened(url: str) -> HTTPResponse:
    """Open it as a browser does."""
    browser = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
    answer: HTTPResponse = browser.open(url, timeout=90)
    return answer


def test_it_prints_an_address_serves_without_router_ends_by_signal(endpoint: str, free_port: Callable[[], int]) -> None:
    port = free_port()
    with running("argosy", "ui", "--fleet", "sar", "--router", endpoint, "--port", str(port)) as ui:
        url = address(ui)
        assert f":{port}/" in url
        page = opened(url)
        assert page.status == 200
        assert b"<title>Argosy</title>" in page.read()
        ui.says(f"argosy ui: no router at {endpoint}: ")
        ui.says("trying again")
        ui.signal(signal.SIGTERM)
        assert ui.ends() == 0
        assert "Traceback" not in ui.text
        assert ui.text.count("no router at") == 1, "once, however often it is tried"


def test_it_ends_well_while_a_session_is_being_opened() -> None:
    with socket.socket() as mute:  # takes the connection and says nothing
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        router = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        with running("argosy", "ui", "--router", router, "--port", "0") as ui:
            address(ui)
            mute.settimeout(90)
            mute.accept()[0].close()
            ui.signal(signal.SIGTERM)
            assert ui.ends() == 0, ui.text
            assert "FATAL" not in ui.text


def test_a_port_that_is_taken_is_one_line(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert main(["ui", "--router", endpoint, "--port", str(port)]) == 1
    line = f"error: cannot listen at 127.0.0.1 port {port}: Address already in use; --port 0 takes any that is free\n"
    assert capsys.readouterr() == ("", line)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--tiles", "nowhere"], 2, "error: --tiles: nowhere is not a folder"),
        (["--listen", "203.0.113.7", "--port", "0"], 1, "cannot listen at 203.0.113.7 port 0"),
        (["--listen", "no.such.host.invalid", "--port", "0"], 1, "cannot listen at no.such.host.invalid"),
        (["--keys", "nowhere", "--router", "tls/127.0.0.1:1"], 2, "nowhere"),
    ],
)
def test_what_cannot_be_is_said_and_nothing_is_served(
    arguments: list[str], code: int, words: str, endpoint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["ui", "--router", endpoint, *arguments]) == code
    out, err = capsys.readouterr()
    assert words in err
    assert out == ""


@pytest.mark.parametrize("port", ["x", "-1", "65536", ""])
def test_a_port_that_is_none_is_refused(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["ui", f"--port={port}"])
    assert ended.value.code == 2
    assert f"expected a port from 0 to 65535, got `{port}`" in capsys.readouterr().err


def test_the_browser_gets_an_address_that_opens_once_and_not_the_token(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    opened_: list[str] = []
    monkeypatch.setattr(command.webbrowser, "open", opened_.append)
    auth = AuthGuard("127.0.0.1", 8080)
    command._print_address(Namespace(listen="127.0.0.1", browser=True), auth)
    assert auth.token in capsys.readouterr().out
    assert [one.startswith("http://127.0.0.1:8080/?token=") for one in opened_] == [True]
    assert auth.token not in opened_[0]


def test_a_page_that_other_machines_reach_is_warned_of(endpoint: str) -> None:
    with running("argosy", "ui", "--router", endpoint, "--port", "0", "--listen", "0.0.0.0") as ui:
        ui.says("warning: other machines can reach this page without TLS")
        ui.says("open http://")


def test_all_that_the_page_loads_is_in_the_package(tmp_path: Path) -> None:
    """A wheel holds what stands beside the modules; the page names nothing else."""
    static = Path(__file__).parents[3] / "argosy" / "ui" / "static"
    page = (static / "index.html").read_text()
    named = re.findall(r'(?:href|src)="([^"]+)"', page)
    assert named
    for name in named:
        assert name.startswith("/static/"), f"{name} is from elsewhere"
        assert (static / name.removeprefix("/static/")).is_file()
    for module in static.glob("*.js"):
        text = module.read_text()
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text), (
            module
        )
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text), module
        for imported in re.findall(r'from "\./([^"]+)"', text):
            assert (static / imported).is_file()
    assert (static / "vendor" / "leaflet" / "LICENSE").is_file()


def test_nothing_of_the_web_server_is_imported_by_other_commands() -> None:
    code = (
        "import sys, json, argosy.__main__, argosy.stop.command, argosy.fleet_model; "
        "print(json.dumps('aiohttp' in sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert json.loads(told.stdout) is False
