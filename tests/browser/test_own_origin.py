"""A page of another site asks the server of this machine: it gets nothing."""

import socket

import pytest

import dqcontrol as dqc
from dqcontrol.browser import RobotPage

pytest.importorskip("viser", reason="the browser view needs viser: pip install 'dqcontrol[view]'")
client = pytest.importorskip("websockets.sync.client")
InvalidStatus = pytest.importorskip("websockets.exceptions").InvalidStatus


@pytest.fixture(scope="module")
def page():
    page = RobotPage(dqc.load_robot("iiwa7"), 18390)
    yield page
    page.server.stop()


def ask(page, origin, host=None):
    """Open a socket as the browser does for a page of this origin, and return the first that it says."""
    port = page.server.get_port()
    address = f"ws://{host or '127.0.0.1'}:{port}"
    options = {"origin": origin.format(port=port) if origin else None, "subprotocols": ["viser-v1.1.1"]}
    with client.connect(address, sock=connected(port), **options) as asked:
        return asked.recv(timeout=30)


def connected(port):
    return socket.create_connection(("127.0.0.1", port))


@pytest.mark.parametrize("origin", [None, "http://127.0.0.1:{port}"])
def test_its_own_page_and_programs_are_answered(page, origin):
    assert ask(page, origin)


@pytest.mark.parametrize("host", [None, "localhost", "elsewhere.org"])
@pytest.mark.parametrize(
    "origin",
    [
        "http://elsewhere.org",
        "http://elsewhere.org:{port}",
        "http://127.0.0.1:1",
        "https://127.0.0.1:{port}",
        "null",
    ],
)
def test_pages_of_others_are_refused(page, origin, host):
    """Also under a name of theirs that they let mean this machine."""
    with pytest.raises(InvalidStatus, match="403"):
        ask(page, origin, host)
