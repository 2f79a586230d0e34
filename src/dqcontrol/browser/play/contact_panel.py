"""Damping, stiffness and force of a contact while it presses, with what it bears."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from dqcontrol.browser.play.session import PlaySession
from dqcontrol.contact import Admittance, ContactLimits
from dqcontrol.errors import Error
from dqcontrol.experiments.contact_check import limits_of, stiffest_body

_FINE = 200  # steps of a slider
_BEYOND = 1.5  # times a limit, or what is there now, a slider reaches
_FIRM = 1e6  # N/m: nobody asks for more than steel


class _Slider(NamedTuple):
    node: Any
    most: float
    mark: float


class ContactPanel:
    """Sliders for what gives way along x, y and z, in a folder that is there where a spec has ``contact``."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        self._gui, self._session = gui, session
        self._lock = threading.RLock()
        self._folder = gui.add_folder("Contact")
        self._sliders: dict[str, _Slider] = {}
        self._shown: dict[str, float] = {}
        with self._folder:
            self._bears = gui.add_markdown("")
        self.refresh()

    @property
    def _contact(self) -> Admittance | None:
        contact = self._session.live.law.contact
        return None if contact is None or isinstance(contact.translation, str) else contact

    def refresh(self) -> None:
        """Show the present contact, and in a while what it bears."""
        self._folder.visible = self._contact is not None
        if self._contact is None:
            self._bears.content = ""
            return
        self._show(None)
        threading.Thread(target=self._advise, name="contact", daemon=True).start()

    def _advise(self) -> None:
        """Find what the loop bears, unless another one runs by then."""
        setting = self._session.setting
        (case,) = setting.cases
        if case.variant.law.contact is None:
            return
        try:
            limits = limits_of(setting.spec, case)
        except Error as error:
            self._bears.content = str(error)
            return
        if setting is self._session.setting:
            self._show(limits)

    def _show(self, limits: ContactLimits | None) -> None:
        contact = self._contact
        if contact is None:
            return
        rows, wanted = contact.axis_rows[3:], contact.force.components[3:]
        body = stiffest_body(self._session.setting.spec)
        with self._lock:
            least = limits.least_damping if limits else np.nan
            self._slide(
                "Damping [N·s/m]", float(rows[:, 1].max()), least, "least", partial(self._scale, "damping")
            )
            if rows[:, 2].any():
                self._slide(
                    "Stiffness [N/m]",
                    float(rows[:, 2].max()),
                    np.nan,
                    "",
                    partial(self._scale, "stiffness"),
                )
            for axis, force in zip("xyz", wanted, strict=True):
                if isinstance(force, float | int):
                    self._slide(
                        f"Force along {axis} [N]", float(force), np.nan, "", partial(self._press, axis)
                    )
            if body is not None:
                most = limits.stiffness if limits else np.nan
                self._slide(f"{body[0]} [N/m]", body[1], most, "limit", self._touch)
            if limits:
                self._bears.content = _words(limits, body)

    def _slide(
        self, label: str, value: float, mark: float, named: str, changed: Callable[[float], object]
    ) -> None:
        """Show a value, marked where a limit is; a slider is made anew only for another mark."""
        self._shown[label] = value
        known = self._sliders.get(label)
        before = known.mark if known and np.isnan(mark) else np.nan
        mark = float(f"{mark:.3g}") if 0 < mark < _FIRM else before
        is_marked = np.array_equal([mark], [known.mark], equal_nan=True) if known else False
        if known and is_marked and abs(value) <= known.most:
            known.node.value = value
            return
        order = known.node.order if known else None  # it stays in its place
        if known:
            known.node.remove()
        most = _BEYOND * max(abs(value), 1.0, mark if np.isfinite(mark) else 0.0)
        step = 10.0 ** np.floor(np.log10(most / _FINE))
        most = float(step * np.ceil(most / step))
        least = -most if label.startswith("Force") else float(step)
        marks = ((mark, f"{named} {mark:g}"),) if np.isfinite(mark) else None
        with self._folder:
            value = max(value, least)
            node = self._gui.add_slider(label, least, most, float(step), value, marks=marks, order=order)

        def moved(event: Any) -> None:
            if (asked := float(event.target.value)) != self._shown[label]:
                changed(asked)

        node.on_update(moved)
        self._sliders[label] = _Slider(node, most, mark)

    def _scale(self, name: str, value: float) -> None:
        """Make the largest of three axes a value, and the others larger or smaller by as much."""
        contact = self._contact
        if contact is None or isinstance(contact.translation, str):
            return
        known = contact.axis_rows[3:, ("damping", "stiffness").index(name) + 1]
        scaled = zip((known * value / known.max()).tolist(), contact.rigid[3:], strict=True)
        numbers = ["rigid" if is_rigid and name == "stiffness" else number for number, is_rigid in scaled]
        self._take(replace(contact, translation=replace(contact.translation, **{name: numbers})))

    def _press(self, axis: str, value: float) -> None:
        contact = self._contact
        if contact is not None:
            self._take(replace(contact, force=replace(contact.force, **{axis: value})))

    def _take(self, contact: Admittance) -> None:
        self._session.set_contact(contact)
        self.refresh()

    def _touch(self, value: float) -> None:
        """Make what is touched another one; the robot begins anew where it began, in the air."""
        session, body = self._session, stiffest_body(self._session.setting.spec)
        if body is None:
            return
        world = dict(session.spec["world"])
        world[body[0]] = {**world[body[0]], "stiffness": value}
        if not session.reset(world=world):
            self.refresh()


def _words(limits: ContactLimits, body: tuple[str, float] | None) -> str:
    unit = "N/m" if limits.axis in ("x", "y", "z") else "N·m/rad"
    most = "whatever stands still"
    if np.isfinite(limits.stiffness):
        most = f"up to {float(f'{limits.stiffness:.3g}'):g} {unit}"
    words = [f"Along {limits.axis} it bears {most}"]
    if body is not None and np.isfinite(limits.least_damping) and limits.least_damping > 0:
        words.append(f"{body[0]} needs {limits.least_damping:.3g} N·s/m")
    if limits.approach_speed is not None:
        words.append(f"approach at {1e3 * limits.approach_speed:.3g} mm/s at most")
    return "; ".join(words) + "."
