"""The tab of the world: bodies to add and to drag, and whether the law keeps clear of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.browser.drawn_things import shape_mesh
from dqcontrol.browser.play.session import PlaySession
from dqcontrol.geometry import Plane

_SIZE = 0.12  # m
_FIRST = (0.15, 0.15, 0.0)  # m, from the hand: new bodies are there
_COLOUR = (140, 90, 165)


class WorldTab:
    """Bodies with gizmos of their own; constraints on and off, and the margin that they keep."""

    def __init__(self, server: Any, session: PlaySession) -> None:
        self._server, self._session, self._busy = server, session, False
        self._drawn: Any = None
        self._count = 0
        self._shown: object = None
        gui = server.gui
        for label, shape in (("Add a box", {"box": [_SIZE] * 3}), ("Add a ball", {"sphere": _SIZE / 2})):
            gui.add_button(label).on_click(lambda _, shape=shape: self._add(shape))
        gui.add_button("Take the last one away").on_click(lambda _: self._remove())
        self._kept = gui.add_checkbox("The law keeps clear of them", False)
        self._margin = gui.add_slider("Margin [mm]", 0.0, 100.0, 5.0, 10.0)
        self._kept.on_update(lambda _: self._changed())
        self._margin.on_update(lambda _: self._changed())
        self.refresh()

    def refresh(self) -> None:
        """Draw the bodies of the present world."""
        spec = self._session.spec
        self._busy = True
        try:
            self._kept.value = spec.get("constraints") is not None
            margin = (spec.get("constraints") or {}).get("margin", 0.01)
            self._margin.value = min(max(1e3 * float(margin), 0.0), 100.0)
        finally:
            self._busy = False
        if spec.get("world") == self._shown:
            return
        self._shown = spec.get("world")
        scene = self._server.scene
        if self._drawn is not None:
            self._drawn.remove()
        self._count += 1
        self._drawn = scene.add_frame(f"/world{self._count}", show_axes=False)
        world = self._session.setting.spec.surroundings
        for name, body in world.bodies.items() if world else ():
            is_plane = body.kind == "plane"
            if is_plane and all(isinstance(each, Plane) and each.normal[2] == 1.0 for each in body.shapes):
                continue  # the grid shows it
            node, at = f"{self._drawn.name}/{name}", np.zeros(3)
            if not is_plane and body.moves is None:
                at = np.asarray(body.position)
                gizmo = scene.add_transform_controls(
                    node, scale=0.15, disable_rotations=True, position=body.position, depth_test=False
                )
                gizmo.on_update(lambda event, name=name: self._moved(name, event))
            for i, shape in enumerate(body.shapes):
                if (mesh := shape_mesh(shape, 1.0)) is not None:
                    scene.add_mesh_simple(
                        f"{node}/shape{i}",
                        mesh.vertices - at,
                        mesh.faces,
                        color=_COLOUR,
                        opacity=0.15 if is_plane else 0.7,
                    )

    def _add(self, shape: dict[str, Any]) -> None:
        world = dict(self._session.spec.get("world") or {})
        hand = algebra.translation(self._session.live.state.pose)
        kind = "ball" if "sphere" in shape else "box"
        name = next(f"{kind}{i}" for i in range(1, 1000) if f"{kind}{i}" not in world)
        position = [round(float(x), 3) for x in hand + np.array(_FIRST)]
        self._use({**world, name: {**shape, "position": position}})

    def _remove(self) -> None:
        world = dict(self._session.spec.get("world") or {})
        if world:
            world.popitem()
            self._use(world)

    def _moved(self, name: str, event: Any) -> None:
        if event.phase != "end":
            return
        world = dict(self._session.spec.get("world") or {})
        if name in world:
            position = [round(float(x), 4) for x in event.target.position]
            if not self._use({**world, name: {**world[name], "position": position}}):
                event.target.position = world[name]["position"]

    def _changed(self) -> None:
        if not self._busy and not self._use(dict(self._session.spec.get("world") or {})):
            self.refresh()

    def _use(self, world: dict[str, Any]) -> bool:
        """Begin anew in a world, at the same task."""
        session = self._session
        kept = {"clear_of": "all", "margin": 1e-3 * self._margin.value, "acceleration": 10.0} if world else {}
        constraints = {**(session.spec.get("constraints") or {}), **kept} if self._kept.value else None
        if constraints is not None and not world:
            constraints.pop("clear_of", None)
        return session.change(
            world=world or None, constraints=constraints, reference=session.spec["reference"]
        )
