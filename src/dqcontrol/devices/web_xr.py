"""A phone or a headset, by a page of WebXR that we serve: it is moved itself, and tells its pose."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol import algebra
from dqcontrol.browser.served_page import is_own_page
from dqcontrol.devices.teleoperation import Told
from dqcontrol.errors import Error, from_extra

HOST = "127.0.0.1"  # browsers give poses to pages of localhost, or with a certificate
_PAGE = Path(__file__).with_name("web_xr.html")
_MOST_BYTES = 1000  # of a message
# WebXR: x right, y up, z back. Ours: x ahead, y left, z up (REP 103).
_AXES = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])

_Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
_Four = Annotated[list[float], Meta(min_length=4, max_length=4)]


class _Message(msgspec.Struct):
    """What the page tells; position in m, quaternion scalar first, both in the axes of WebXR."""

    position: _Three
    quaternion: _Four
    clutch: bool
    gripper: float | None = None


class WebXr:
    """An `Input`: the page's last pose. A finger on a phone's screen or a controller's squeeze button is the clutch.

    The page is for this computer, as nobody else may drive the robot. A phone or headset on a cable sees it as its own
    localhost after ``adb reverse tcp:PORT tcp:PORT``.

    Parameters
    ----------
    port
        Of this machine; any free one if 0.

    Attributes
    ----------
    url, port
        Of the page.

    Raises
    ------
    MissingExtraError
        If websockets is not installed.
    Error
        If the port is taken.
    """

    url: str
    port: int

    def __init__(self, port: int = 8090) -> None:
        serving, self._errors = (
            from_extra(f"websockets.{part}", "view", "headsets") for part in ("sync.server", "exceptions")
        )
        self._told: Told | None = None
        try:
            self._server: Any = serving.serve(
                self._hear, HOST, port, process_request=_answer, max_size=_MOST_BYTES, compression=None
            )
        except OSError as error:
            raise Error(f"web-xr: port {port} of this machine cannot be had: {error}") from None
        self.port = self._server.socket.getsockname()[1]
        self.url = f"http://localhost:{self.port}"
        threading.Thread(target=self._server.serve_forever, name="web-xr", daemon=True).start()

    def read(self) -> Told | None:
        """Return the newest that the page told; see `Input`."""
        return self._told

    def close(self) -> None:
        """Serve no longer."""
        self._server.shutdown()

    def _hear(self, connection: Any) -> None:
        try:
            for message in connection:
                self._told = told_by(message, time.monotonic())
        except self._errors.ConnectionClosed:
            pass
        finally:
            self._told = None


def told_by(message: str | bytes, stamp: float) -> Told | None:
    """Return what a message of the page says, at a time, s; None if it says no pose.

    Examples
    --------
    >>> told = told_by('{"position": [0, 0, -1], "quaternion": [1, 0, 0, 0], "clutch": true}', 0.0)
    >>> algebra.translation(told.pose).tolist()  # a metre ahead
    [1.0, 0.0, 0.0]
    """
    try:
        said = msgspec.json.decode(message, type=_Message)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None
    quaternion, position = np.array(said.quaternion), np.array(said.position)
    norm = float(np.linalg.norm(quaternion))
    if not (0.9 < norm < 1.1 and np.isfinite(position).all()):  # of unit quaternions in single precision
        return None
    turn = np.array([quaternion[0], *(_AXES @ quaternion[1:])]) / norm
    gripper = math.nan if said.gripper is None else min(max(said.gripper, 0.0), 1.0)
    return Told(stamp, said.clutch, pose=algebra.pose(turn, _AXES @ position), gripper=gripper)


def _answer(connection: Any, request: Any) -> Any:
    """Give the page to who asks for it, and let none but it tell poses."""
    host, origin = request.headers.get("Host"), request.headers.get("Origin")
    if not is_own_page(host, origin):
        return connection.respond(403, "only pages of this server may ask it\n")
    if request.path == "/told":
        return None  # the WebSocket
    if request.path != "/":
        return connection.respond(404, "there is nothing\n")
    response = connection.respond(200, _PAGE.read_text(encoding="utf-8"))
    del response.headers["Content-Type"]
    response.headers["Content-Type"] = "text/html; charset=utf-8"
    return response
