"""The tabs of the dock: target, law, robot, world, recording, and the last ten seconds as charts."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.drawn import shape_mesh
from dqcontrol.browser.play.board import LEVEL, UPRIGHT, Board
from dqcontrol.browser.play.contact_panel import ContactPanel
from dqcontrol.browser.play.learnt import learn_in
from dqcontrol.browser.play.scenes import SCENES
from dqcontrol.browser.play.session import SHOWN, ChartPoint, PlaySession, law_from
from dqcontrol.browser.replay import replay_page
from dqcontrol.browser.run_view_model import Track
from dqcontrol.errors import Error, writing
from dqcontrol.experiments.gain_advice import law_parameters
from dqcontrol.experiments.result_pages import clip
from dqcontrol.figures.style import COLOURS
from dqcontrol.geometry import Plane
from dqcontrol.loop.record import Record
from dqcontrol.robots import describe
from dqcontrol.tables.number_texts import number_text


def called(does: Callable[[], object]) -> Callable[[Any], None]:
    """Return it as what viser calls."""

    def call(_: Any) -> None:
        does()

    return call


class _Quiet:
    """Changes what is shown without taking that for a wish."""

    def __init__(self) -> None:
        self._lock, self._busy = threading.RLock(), False

    @contextmanager
    def _quietly(self) -> Iterator[None]:
        with self._lock:
            self._busy = True
            try:
                yield
            finally:
                self._busy = False

    def _heard(self, does: Callable[[], object]) -> Callable[[Any], None]:
        """Return it as what viser calls, for wishes alone."""
        return called(lambda: None if self._busy else does())


_OWN = "Free"
_OFF = "off"
_DRAWINGS = (".txt", ".svg")


class TargetTab:
    """A scene to choose, and buttons.

    Attributes
    ----------
    board
        To draw on.
    """

    board: Board

    def __init__(self, server: Any, session: PlaySession, folder: Path) -> None:
        self._session, self._folder, self._own = session, folder, dict(session.spec)
        self.board = Board(server, session)
        gui = server.gui
        gui.add_markdown("Drag the arrows and rings in the scene.")
        titles = (_OWN, *(f"{i}. {scene.title}" for i, scene in enumerate(SCENES, 1)))
        self._scene = gui.add_dropdown("Scene", titles)
        self._look_for = gui.add_markdown("")
        self._scene.on_update(lambda _: self._chosen())
        for label, does in (
            ("Hold here", session.hold),
            ("Circle", lambda: self._shape("circle")),
            ("Square", lambda: self._shape("square")),
            ("Reset (R)", session.reset),
        ):
            gui.add_button(label).on_click(called(does))
        self._plane = gui.add_dropdown("Draw with the mouse", (_OFF, UPRIGHT, LEVEL))
        self._plane.on_update(lambda _: self.board.show(self._plane.value))
        file = gui.add_upload_button("Follow a drawing file (.svg, .txt)", mime_type=",".join(_DRAWINGS))
        file.on_upload(lambda _: self._follow(file.value.name, file.value.content))

    def choose(self, number: int) -> None:
        """Choose a scene, from 1; 0: what the page was opened for."""
        self._scene.value = self._scene.options[number]

    def refresh(self) -> None:
        """Put the sheet where another robot can reach it."""
        self._plane.value = _OFF
        self.board.show(_OFF)

    def _chosen(self) -> None:
        at = self._scene.options.index(self._scene.value)
        scene = SCENES[at - 1] if at else None
        self._look_for.content = scene.look_for if scene else ""
        if scene is None:
            self._session.play(self._own)
        else:
            self._session.play(dict(scene.spec), scene.ghost)
            if scene.learns:
                learn_in(self._session, scene.learns)

    def _shape(self, kind: str) -> None:
        reach = float(describe(self._session.robot).reach)
        size = round(0.1 * reach, 3) if np.isfinite(reach) else 0.1
        shapes: dict[str, dict[str, Any]] = {
            "circle": {"radius": size, "duration": 60.0, "turns": 12.0, "plane": "yz"},
            "square": {"side": size, "duration": 12.0, "plane": "yz"},
        }
        self._session.follow({"kind": kind, **shapes[kind]})

    def _follow(self, name: str, content: bytes) -> None:
        """Keep a drawing file beside the recordings, which name it, and follow it."""
        path, session = self._folder / Path(name).name, self._session
        with session.trying():
            if path.suffix.lower() not in _DRAWINGS:
                raise Error(f"{path.name}: expected a drawing, {' or '.join(_DRAWINGS)}")
            count = 1
            while path.exists() and path.read_bytes() != content:
                count += 1
                path = self._folder / f"{Path(name).stem}-{count}{path.suffix}"
            with writing(path):
                path.write_bytes(content)
            session.follow({"kind": "drawing", "file": str(path.resolve())})


_NONE = "none"
_STEP, _LEAST = 0.1, 0.1  # 1/s
_INVERSES = {
    "filtered": {"kind": "filtered"},
    "damped": {"kind": "damped", "damping": 0.05},
    "manipulability": {"kind": "manipulability"},
}


class LawTab(_Quiet):
    """Kind, gain, inverse, and the law of a second robot."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        super().__init__()
        self._gui, self._session = gui, session
        kinds = tuple(law_parameters(1.0, 1.0))
        present = str(session.spec["law"].get("kind"))
        self._kind = gui.add_dropdown("Law", tuple(dict.fromkeys((*kinds, present))), initial_value=present)
        self._box: Any = gui.add_folder("Gain")
        self._marked: object = None
        self._gain: Any = None
        self._mark(5.0, 10.0, 100.0)
        self._expected = gui.add_markdown("")
        self._inverse = gui.add_dropdown("Inverse", tuple(_INVERSES))
        self._ghost = gui.add_dropdown("Second robot", (_NONE, *kinds), initial_value=_NONE)
        self._kind.on_update(self._heard(self._changed))
        self._inverse.on_update(called(self._inverse_changed))
        self._ghost.on_update(called(self._ghost_changed))

    def refresh(self) -> None:
        """Show the law that runs, and the gains that are good and that are the limit for the present robot."""
        with self._quietly():
            kind = str(self._session.spec["law"].get("kind"))
            if kind not in self._kind.options:
                self._kind.options = (*self._kind.options, kind)
            self._kind.value = kind
        threading.Thread(target=self._advise, name="check", daemon=True).start()

    def _advise(self) -> None:
        """Say what `check` expects, unless another robot or law runs by then."""
        session = self._session
        setting = session.setting
        row = session.check()
        with self._quietly():
            if setting is not session.setting:
                return
            words = ""
            if row.loops:
                limits, period = row.worst.limits, setting.spec.period
                good, limit = limits.recommended / period, limits.stable / period
                self._mark(self._present_gain(), good, limit)
                ends = f"; stable up to {number_text(limit)}" if math.isfinite(limit) else ""
                words = f"Good up to {number_text(good)} 1/s{ends}. "
            self._expected.content = f"{words}This one: {row.verdict}. {row.remark}".strip()

    def _mark(self, gain: float, good: float, limit: float) -> None:
        """Let the slider reach beyond the limit, as far as that is near; mark both."""
        most = max(1.3 * limit if limit < 8 * good else 4 * good, 1.2 * gain, 1.0)
        most = _STEP * math.ceil(most / _STEP)
        marks = [(round(good, 1), f"good {number_text(good)}")] if _LEAST < good < most else []
        if limit < most:
            marks.append((round(limit, 1), f"limit {number_text(limit)}"))
        value = min(max(round(gain, 1), _LEAST), most)
        if self._marked == (most, marks):
            self._gain.value = value
            return
        self._marked = most, marks
        if self._gain is not None:
            self._gain.remove()  # marks cannot be changed
        with self._box:
            self._gain = self._gui.add_slider("k [1/s]", _LEAST, most, _STEP, value, marks=tuple(marks))
        self._gain.on_update(self._heard(self._changed))

    def _changed(self) -> None:
        session, kind, k = self._session, self._kind.value, float(self._gain.value)
        present = session.spec["law"]
        with session.trying():
            if kind == present.get("kind"):
                law, gain = law_from(present), self._present_gain()
                law = law.scaled(k / gain) if gain else law
            else:
                law = law_from({"kind": kind, **law_parameters(k, k / 2)[kind]})
            session.set_law(law)

    def _inverse_changed(self) -> None:
        session = self._session
        with session.trying():
            session.set_law(law_from({**session.spec["law"], "inverse": _INVERSES[self._inverse.value]}))

    def _ghost_changed(self) -> None:
        kind = self._ghost.value
        k = float(self._gain.value)
        data = None if kind == _NONE else {"kind": kind, **law_parameters(k, k / 2)[kind]}
        self._session.set_ghost(data)

    def _present_gain(self) -> float:
        """Return the largest of the gains of position and orientation, 1/s; 0 of a law without."""
        live = self._session.live
        rates = live.law.loop_rates(live.law.rows(live.robot, None, live.period))
        if rates is None:
            return 0.0
        return max(
            float(np.abs(np.asarray(each, np.complex128)).max())
            for each in (rates.position, rates.orientation)
            if each is not None
        )


_PLANTS = {"ideal": "integrator", "servo": "servo", "physics": "mujoco"}
_NAMES = {kind: name for name, kind in _PLANTS.items()}
_OTHER = "as the spec says"
# what sliders show of a unit of SI
_SERVO = {"time_constant": 1e3, "delay": 1e3, "sag": 1e2, "encoder_noise": 1e3}
# An admittance that a hand feels at once and that comes back: 10 N take it 5 cm away, within half a second
_GIVES_WAY = {"axes": "base", "translation": {"damping": 100.0, "stiffness": 200.0}}
_WRIST = {"filter": 0.01}  # s: its force sensor


class RobotTab(_Quiet):
    """Period, plant, lag, delay, sag and noise of encoders; contact."""

    def __init__(self, gui: Any, session: PlaySession) -> None:
        super().__init__()
        self._session = session
        self._contact = ContactPanel(gui, session)
        self._plant = gui.add_dropdown("Joints", (*_PLANTS, _OTHER))
        self._period = gui.add_slider("Period [ms]", 1.0, 50.0, 1.0, 10.0)
        self._servo = (
            gui.add_slider("Lag [ms]", 0.0, 300.0, 5.0, 50.0),
            gui.add_slider("Delay [ms]", 0.0, 200.0, 5.0, 0.0),
            gui.add_slider("Sag under gravity [%]", 0.0, 200.0, 5.0, 0.0),
            gui.add_slider("Encoder noise [mrad]", 0.0, 2.0, 0.05, 0.0),
        )
        self._gives_way = gui.add_checkbox("Give way (force at the wrist)", False)
        for each in (self._plant, self._period, *self._servo, self._gives_way):
            each.on_update(self._heard(self._changed))
        self.refresh()

    def refresh(self) -> None:
        """Show what the present robot has."""
        session = self._session
        self._contact.refresh()
        plant, (case,) = session.spec["plant"], session.setting.cases
        with self._quietly():
            self._plant.value = _NAMES.get(str(plant.get("kind")), _OTHER)
            self._period.value = min(max(round(1e3 * session.live.period), 1.0), 50.0)
            is_servo = self._plant.value == "servo"
            self._gives_way.visible = self._plant.value == "physics" and len(session.robot.ends) == 1
            self._gives_way.value = session.spec.get("contact") is not None
            for slider, (key, scale) in zip(self._servo, _SERVO.items(), strict=True):
                value: Any = getattr(case.plant, key, 0.0)
                slider.visible = is_servo and isinstance(value, float | int)
                if isinstance(value, float | int) and is_servo:
                    slider.value = min(max(scale * float(value), slider.min), slider.max)

    def _changed(self) -> None:
        session, present = self._session, self._session.spec["plant"]
        plant = dict(present)
        if self._plant.value != _OTHER:
            kind = _PLANTS[self._plant.value]
            plant = plant if kind == present.get("kind") else {"kind": kind}
        if plant.get("kind") == "servo" == present.get("kind"):
            plant |= {
                key: slider.value / scale
                for slider, (key, scale) in zip(self._servo, _SERVO.items(), strict=True)
            }
        contact = session.spec.get("contact")
        if self._gives_way.visible and self._gives_way.value != (contact is not None):
            contact = _GIVES_WAY if self._gives_way.value else None
            plant.pop("wrist", None)
            plant |= {"wrist": _WRIST} if contact else {}
        elif plant["kind"] != present.get("kind") and contact == _GIVES_WAY:
            contact = None  # other joints feel nothing
        done = session.change(
            plant=plant,
            contact=contact,
            period=1e-3 * self._period.value,
            reference=session.spec["reference"],
        )
        if not done:
            self.refresh()


_BODY_SIZE = 0.12  # m
_FIRST = (0.15, 0.15, 0.0)  # m, from the hand: new bodies are there
_COLOUR = (140, 90, 165)


class WorldTab(_Quiet):
    """Bodies with gizmos of their own; constraints on and off, and the margin that they keep."""

    def __init__(self, server: Any, session: PlaySession) -> None:
        super().__init__()
        self._server, self._session = server, session
        self._drawn: Any = None
        self._count = 0
        self._shown: object = None
        gui = server.gui
        for label, shape in (
            ("Add a box", {"box": [_BODY_SIZE] * 3}),
            ("Add a ball", {"sphere": _BODY_SIZE / 2}),
        ):
            gui.add_button(label).on_click(lambda _, shape=shape: self._add(shape))
        gui.add_button("Take the last one away").on_click(lambda _: self._remove())
        self._kept = gui.add_checkbox("The law keeps clear of them", False)
        self._margin = gui.add_slider("Margin [mm]", 0.0, 100.0, 5.0, 10.0)
        self._kept.on_update(self._heard(self._changed))
        self._margin.on_update(self._heard(self._changed))
        self.refresh()

    def refresh(self) -> None:
        """Draw the bodies of the present world."""
        spec = self._session.spec
        with self._quietly():
            self._kept.value = spec.get("constraints") is not None
            margin = (spec.get("constraints") or {}).get("margin", 0.01)
            self._margin.value = min(max(1e3 * float(margin), 0.0), 100.0)
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
        if not self._use(dict(self._session.spec.get("world") or {})):
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


class RecordTab:
    """Buttons, and the names of files."""

    def __init__(self, server: Any, session: PlaySession, folder: Path) -> None:
        self._session, self._folder = session, folder
        gui = server.gui
        gui.add_markdown("What happened since the robot last began at rest.")
        self._name = gui.add_text("Name", "played")
        self._replay: Record | None = None
        self._was_paused, self._seen = False, 0.0
        self._button = gui.add_button("Replay")
        self._button.on_click(lambda _: self._end_replay() if self._replay else self._begin_replay())
        self._time = gui.add_slider("Time [s]", 0.0, 1.0, 0.01, 0.0, visible=False)
        for label, does in (
            ("Save as YAML", self._save),
            ("Save as a page (HTML)", self._save_page),
            ("Save as a clip (WebP)", self._save_clip),
            ("Show as Python", self._show_python),
        ):
            gui.add_button(label).on_click(lambda _, does=does: self._tried(does))
        self._said = gui.add_markdown("")

    def replayed(self, now: float) -> tuple[Array, Array] | None:
        """Return configuration and desired pose of the replay at a time, s, of any clock; None if there is none."""
        record, passed, self._seen = self._replay, now - self._seen, now
        if record is None:
            return None
        at = float(self._time.value) + min(passed, 0.1)
        self._time.value = min(at, self._time.max)
        k = int(np.abs(record.time - self._time.value).argmin())
        return record.q[k], record.desired_pose[k]

    def _begin_replay(self) -> None:
        """Let the robot stand still, and show what it did."""
        session = self._session
        record = session.record()
        if len(record) < 2:
            self._said.content = "Nothing has happened yet."
            return
        self._was_paused, session.is_paused = session.is_paused, True
        self._time.max, self._time.value = float(record.time[-1]), 0.0
        self._time.visible, self._button.label = True, "End of the replay"
        self._replay = record

    def _end_replay(self) -> None:
        self._replay = None
        self._session.is_paused = self._was_paused
        self._time.visible, self._button.label = False, "Replay"

    def _tried(self, does: Any) -> None:
        try:
            self._said.content = does()
        except Error as error:
            self._said.content = f"**Not done:** {error}"

    def _path(self, ending: str) -> Path:
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in self._name.value)[:60] or "played"
        count, path = 1, self._folder / f"{name}{ending}"
        while path.exists() or path.with_suffix(".csv").exists():
            count += 1
            path = self._folder / f"{name}-{count}{ending}"
        return path

    def _save(self) -> str:
        return self._session.save(self._path(".yaml"))

    def _save_page(self) -> str:
        path = self._path(".html")
        session = self._session
        kept = session.live.law.constraints
        page = replay_page([Track(path.stem, session.robot, session.record(), constraints=kept)], path.stem)
        with writing(path):
            path.write_text(page, encoding="utf-8")
        return f"{path}: {len(page) / 1e6:.1f} MB, opens in any browser"

    def _save_clip(self) -> str:
        path, session = self._path(".webp"), self._session
        self._said.content = "The clip is being drawn …"
        (case,) = session.setting.cases
        kept = session.live.law.constraints
        clip(session.robot, case.plant, session.record(), path, kept)
        return f"{path}: {path.stat().st_size / 1e6:.1f} MB"

    def _show_python(self) -> str:
        return f"```python\n{self._session.python()}\n```"


_HEIGHT = 112  # px: one is seen whole in a window of 720
_LINE_WIDTH = 1.5  # px
_LEAST_ERROR, _LEAST_FORCE = 1.0, 10.0  # mm, N: less fills no chart
_STROKES = {"robot": COLOURS[0], "ghost": COLOURS[1], "further": COLOURS[2]}
_ERROR = "Error [mm]"


class Charts:
    """Error, share of the limits, clearance and force over time."""

    def __init__(self, gui: Any) -> None:
        self._error = self._chart(gui, _ERROR, ("ghost", "further", "robot"))
        self._share = self._chart(gui, "Speed, share of the limit [%]", ("robot",), 100.0)
        self._clearance = self._chart(gui, "Clearance beyond what is asked [mm]", ("robot",))
        self._force = self._chart(gui, "Force [N]", ("robot",))

    def show(self, history: Sequence[ChartPoint], labels: tuple[str, str] = ("", "")) -> None:
        """Show what happened; ``labels`` name what the law drives, and what further tasks do, where there are any."""
        title = f"{_ERROR}: {labels[0]} (blue), {labels[1]} (green)" if labels[1] else _ERROR
        if self._error.title != title:
            self._error.title = title
        rows = np.array([[*moment] for moment in history] or [[0.0] * len(ChartPoint._fields)])
        time = rows[:, 0] - rows[-1, 0]
        scales = np.array([[1e3], [100], [1e3], [1e3], [1e3], [1]])
        error, share, clearance, further, ghost, force = rows[:, 1:7].T * scales
        # What there is not lies beneath the robot's own: NaN would leave no scale.
        others = [np.where(np.isnan(other), error, other) for other in (ghost, further)]
        self._error.data, self._share.data = (time, *others, error), (time, share)
        _reach_up_to(self._error, max(float(np.nanmax([error, *others])), _LEAST_ERROR))
        for chart, values in ((self._clearance, clearance), (self._force, force)):
            chart.visible = bool(np.isfinite(values).any())
            if chart.visible:
                chart.data = (time, values)
        if self._force.visible:
            _reach_up_to(self._force, max(float(np.nanmax(force)), _LEAST_FORCE))

    def _chart(self, gui: Any, title: str, names: tuple[str, ...], top: float | None = None) -> Any:
        nothing = np.array([-SHOWN, 0.0])
        return gui.add_uplot(
            data=(nothing, *(np.full(2, np.nan) for _ in names)),
            series=(
                {"label": "t"},
                *({"label": name, "stroke": _STROKES[name], "width": _LINE_WIDTH} for name in names),
            ),
            title=title,
            scales=_scales(top),
            axes=({"size": 30}, {"size": 44}),
            padding=(8, 16, 0, 0),
            legend={"show": False},
            height=_HEIGHT,
        )


def _scales(top: float | None) -> dict[str, Any]:
    """Return those of a chart from 0 up to something, or as its values ask for."""
    x = {"time": False}  # else seconds are shown as dates
    return {"x": x, "y": {} if top is None else {"range": (0.0, top)}}


def _reach_up_to(chart: Any, value: float) -> None:
    """Let a chart reach up to the next of 1, 2, 5, 10, …: nothing jumps, and noise does not fill it."""
    decade = 10.0 ** np.floor(np.log10(value))
    top = float(decade * next(step for step in (1, 2, 5, 10) if step * decade >= value * (1 - 1e-9)))
    if chart.scales["y"].get("range") != (0.0, top):
        chart.scales = _scales(top)
