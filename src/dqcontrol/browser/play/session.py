"""A live robot in a thread, its ghost, what they did, and how that becomes a run again. Nothing here draws."""

from __future__ import annotations

import copy
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import msgspec
import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.browser.play.end_effectors import LAW, EndEffectors
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.constraint_view import ConstraintView, NearestPair
from dqcontrol.errors import Error, ExistsError, NoteWarning, StabilityWarning, writing
from dqcontrol.experiments.contact_check import check_contact
from dqcontrol.experiments.driven import live_of
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, prepare_spec
from dqcontrol.experiments.run import run
from dqcontrol.experiments.spec import read_spec
from dqcontrol.experiments.spec.spec import part_of_spec, readable_again
from dqcontrol.experiments.spec.spec_files import locate_files
from dqcontrol.files.output_file import yaml_text
from dqcontrol.laws import Law
from dqcontrol.loop.live import Live, Pace
from dqcontrol.loop.record import Record
from dqcontrol.loop.targets import Speeds
from dqcontrol.references.points import DUAL_QUATERNION
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TIME
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.contact import Admittance
    from dqcontrol.experiments.check import LoopCheck

SPEEDS = Speeds(linear=0.5, angular=2.0, acceleration=3.0)  # brisk for a hand that drags, m/s, rad/s, m/s²
STIFFNESS = 200.0  # N/m of a spring between a link and the mouse
_MOST_FORCE = 60.0  # N: half of what ISO/TS 15066 lets a robot press on a chest
SHOWN = 10.0  # s of charts
_CHARTED = 0.05  # s between points of charts
_MOST_ROWS = 60_000  # of a recording: ten minutes at 100 Hz, 20 MB
_BESIDE = ("constraints", "null_space", "contact")  # what a spec may say beside a law, for all of them
_REST = {"kind": "set-point", "duration": 1.0}
_SLOW, _RESTS = 1e-4, 0.3  # rad/s or m/s, and s for which nothing is faster: the robot rests


class ChartPoint(NamedTuple):
    """A point of the charts.

    Attributes
    ----------
    time
        Since the session began, s.
    error, share, clearance
        Of the hand to its target, m; largest speed of a joint as a share of its limit; least distance beyond what is
        asked, m, NaN without anything around.
    further_error
        Of the further task that is farthest off, as the second of two arms, m; NaN without one.
    ghost_error
        Of the second robot, m; NaN without one.
    force
        That the hand feels, or that somebody pulls with, N; NaN where there is no physics.
    missed
        Periods that passed without a step since the moment before.
    """

    time: float
    error: float
    share: float
    clearance: float
    further_error: float
    ghost_error: float
    force: float
    missed: int


class Pull(NamedTuple):
    """What a spring does to a link.

    Attributes
    ----------
    point, force
        Where it holds the link, m, and how it draws, N, shape (3,), inertial frame.
    gave_way
        How far that point is from where the link was taken, m.
    """

    point: Array
    force: Array
    gave_way: float


class Spring:
    """Holds a point of a link, and goes along with it.

    Parameters
    ----------
    robot, q
        Whose link, and where the robot is, shape (n,), rad or m.
    row
        Of `Robot.frames`: what the link moves with.
    taken
        Where it is taken, shape (3,), m, inertial frame.

    Attributes
    ----------
    towards
        Where it leads, shape (3,), m, inertial frame.
    """

    row: int
    towards: Array

    def __init__(self, robot: Robot, q: Array, row: int, taken: Array) -> None:
        self.row, self.towards = row, taken
        self._robot, self._taken = robot, taken
        frame = algebra.conjugate(robot.frames(q)[row])
        self._on_link = algebra.multiply(frame, algebra.pose([1, 0, 0, 0], taken))

    def pull(self, q: Array) -> Pull:
        """Return what it does to the robot at q, shape (n,)."""
        point = algebra.translation(algebra.multiply(self._robot.frames(q)[self.row], self._on_link))
        force = STIFFNESS * (self.towards - point)
        force *= min(1.0, _MOST_FORCE / max(float(np.linalg.norm(force)), 1e-9))
        return Pull(point, force, float(np.linalg.norm(point - self._taken)))


class RecordedRows:
    """A `SampleSink` in memory that stops taking rows when it is full.

    Parameters
    ----------
    robot
        Whose rows they are.
    most
        Rows at most; memory is taken as they come.
    """

    failure: str = ""

    def __init__(self, robot: Robot, most: int) -> None:
        self._robot, self._most = robot, most
        self._rows: list[Array] = []

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def is_full(self) -> bool:
        """Whether it takes no more."""
        return len(self._rows) >= self._most

    def take(
        self, sample: Array, q: Array, measured: Array, command: Array, interventions: float = 0.0
    ) -> None:
        """Keep a row; see `SampleSink`."""
        if not self.is_full:
            self._rows.append(np.concatenate([sample, q, measured, command]))

    def record(self) -> Record:
        """Return what was kept."""
        robot, n = self._robot, self._robot.configuration_size
        ends = np.cumsum([SAMPLE_SIZE, n, n, robot.input_size])
        rows = np.array(self._rows).reshape(-1, ends[-1])
        desired, q, measured, command = (
            np.ascontiguousarray(part) for part in np.split(rows, ends[:-1], axis=1)
        )
        names = robot.joint_names, robot.input_names
        return Record(desired[:, TIME].copy(), q, measured, command, robot.fkm(q), desired, *names)


class PlaySession:
    """A robot that is driven, in a thread of its own at its own period; ``with`` starts and ends it.

    Parameters
    ----------
    spec
        Plain data of a spec of one run, as ``experiments.driven.spec_of_robot`` gives it.
    folder
        That its file names start from.

    Attributes
    ----------
    spec
        What the present robot was made from; its ``start`` is where the recording begins.
    live, ghost
        The robot, and a second one with another law, if there is one.
    ends
        What the robot is dragged by.
    told
        What happened, in words, the last last.
    missed
        How many periods passed without a step, as the machine was busy.
    is_paused
        Whether time stands still.
    pulled
        What a spring does to it; None without one.
    driver
        Called before each step with the robot: what a device tells it.

    Raises
    ------
    Error
        If the spec is wrong.
    """

    spec: dict[str, Any]
    live: Live
    ghost: Live | None
    ends: EndEffectors
    pulled: Pull | None
    driver: Callable[[Live], None] | None = None

    def __init__(self, spec: dict[str, Any], folder: Path | None = None) -> None:
        self._folder, self._known = folder or Path.cwd(), dict[bytes, Any]()
        self.lock = threading.RLock()
        self.told: deque[str] = deque(maxlen=50)
        self.history: deque[ChartPoint] = deque(maxlen=round(SHOWN / _CHARTED))
        self.missed, self.is_paused = 0, False
        self._noted = 0
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._work, name="play", daemon=True)
        self._ghost_law: Law | None = None
        self._home: list[float] = []
        self._take(spec)
        self._home = list(self.spec["start"])

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closed.set()
        self._thread.join()
        self.live.brake()

    @property
    def is_closed(self) -> bool:
        """Whether it has ended."""
        return self._closed.is_set()

    # What it is made from

    def _take(self, spec: dict[str, Any]) -> None:
        """Begin anew, at rest, from a spec; raise an error and go on as before if it is wrong."""
        setting = self._prepared(spec)
        live = live_of(setting, SPEEDS)
        ghost = self._made_ghost(setting, self._ghost_law) if self._ghost_law else None
        (case,) = setting.cases
        world, kept = setting.spec.surroundings, case.variant.law.constraints
        around = kept or (Constraints(world=world, self_collision=False) if world else None)
        scene = ConstraintView(around, live.robot, live.period) if around else None
        spec = spec | {"start": case.scene.start.tolist()}
        with self.lock:
            self.spec, self.setting, self.live, self.ghost = spec, setting, live, ghost
            self.ends, self._ghost_ends = EndEffectors(live), EndEffectors(ghost) if ghost else None
            self.around: ConstraintView | None = scene
            self._record(exact=True)
            self._spring: Spring | None = None
            self.pulled = None
            for each in (live, ghost) if ghost else (live,):
                if self._follows:
                    each.follow(case.scene.reference)
                else:
                    each.target = case.scene.samples[0, POSE]

    def _prepared(self, spec: dict[str, Any]) -> PreparedExperiment:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("ignore")
            for kind in (NoteWarning, StabilityWarning):
                warnings.simplefilter("always", kind)
            read, _ = read_spec(copy.deepcopy(spec))
            setting = prepare_spec(read, self._folder, self._known)
        for warning in said:
            self.tell(str(warning.message))
        return setting

    def _made_ghost(self, setting: PreparedExperiment, law: Law) -> Live:
        ghost = live_of(setting, SPEEDS)
        ghost.set_law(law)
        return ghost

    def _record(self, *, exact: bool) -> None:
        """Begin the recording anew."""
        self.rows = self.live.recording = RecordedRows(self.live.robot, _MOST_ROWS)
        self._aimed: dict[int, list[Array]] = {}  # where further tasks were to be, row by row
        self._exact, self._still = exact, 0.0

    def change(self, **keys: Any) -> bool:
        """Begin anew where the robot is now, at rest, with other keys of the spec; say why not if that cannot be."""
        with self.lock:
            here = self._here()
        return self.begin({**self.spec, "start": here, "reference": _REST, **keys})

    def follow(self, reference: dict[str, Any]) -> bool:
        """Follow a reference, as a spec says it, from where the hand is now."""
        return self.change(reference=reference)

    def reset(self, **keys: Any) -> bool:
        """Put the robot back to where it began, at rest, with other keys of the spec; say why not if that cannot be."""
        return self.begin({**self.spec, "start": self._home, **keys})

    def play(self, spec: dict[str, Any], ghost: dict[str, Any] | None = None) -> bool:
        """Begin with another spec altogether, and a second robot's law, as a spec says it."""
        self._ghost_law = law_from(ghost) if ghost else None
        if done := self.begin(spec):
            self._home = list(self.spec["start"])
            self.history.clear()
        return done

    def begin(self, spec: dict[str, Any]) -> bool:
        """Begin anew, at rest, from a spec; say why not if that cannot be."""
        with self.trying():
            self._take(spec)
            return True
        return False

    @contextmanager
    def trying(self) -> Iterator[None]:
        """Say why it cannot be done, if so."""
        try:
            yield
        except Error as error:
            self.tell(f"not done: {error}")

    def _here(self) -> list[float]:
        """Return where the robot is, within its limits."""
        limits = self.live.robot.limits
        return np.clip(self.live.plant.q, limits.lower, limits.upper).tolist()

    @property
    def _follows(self) -> bool:
        """Whether the spec's reference moves."""
        return self.spec["reference"].get("kind") != "set-point"

    @property
    def _tasks(self) -> list[dict[str, Any]]:
        """What the spec says of further tasks."""
        return self.spec.get("tasks") or []

    # What is done to it

    def drag(self, pose: Array, name: str = LAW) -> None:
        """Take the end effector, or one with a name, to a pose, shape (8,), inertial frame; NaN: it stays."""
        with self.lock:
            self.ends.drag(name, pose)
            if self._ghost_ends:
                self._ghost_ends.drag(name, pose)
            if self._follows or (self.ends.frames and any("reference" in task for task in self._tasks)):
                rest = [{key: task[key] for key in task if key != "reference"} for task in self._tasks]
                self.spec = {**self.spec, "reference": _REST, "tasks": rest or None}
                self._disturbed()

    def hold(self) -> None:
        """Let the hand stay where it is: also what happens when nobody looks any more."""
        self.drag(np.full(8, np.nan))

    def pull(self, row: int, point: Array, towards: Array) -> None:
        """Pull a link by a spring; it is recorded, but what is recorded is no longer all that moves the robot.

        Parameters
        ----------
        row
            Of `Robot.frames`: what the link moves with.
        point
            Where it is taken, shape (3,), m, inertial frame; while it is held, the spring stays where it was.
        towards
            Where the spring leads, shape (3,), m, inertial frame; not finite: it is let go.
        """
        with self.lock:
            if not self.live.plant.can_be_pushed:
                self.tell("pulling needs physics: choose it in the tab Robot")
            elif not np.isfinite(towards).all():
                self._spring = self.pulled = None
                self.live.plant.push(row, np.zeros(3), np.zeros(3))
            else:
                if self._spring is None or self._spring.row != row:
                    self._spring = Spring(self.robot, self.live.plant.q, row, point)
                self._spring.towards = towards
                self._exact = False
                self._draw_spring()

    def _draw_spring(self) -> None:
        """Let the spring draw at its link where that is now."""
        if self._spring is not None:
            self.pulled = pulled = self._spring.pull(self.live.plant.q)
            self.live.plant.push(self._spring.row, pulled.point, pulled.force)

    def set_law(self, law: Law) -> bool:
        """Go on with another law, without a stop; it keeps what the present one keeps, unless it says so itself."""
        present = self.live.law
        kept = {key: getattr(law, key) or getattr(present, key) for key in _BESIDE}
        with self.lock, self.trying():
            self.live.set_law(msgspec.structs.replace(law, **kept))
            # beside the law: not in it, too
            said = {key for key in _BESIDE if self.spec.get(key) is not None}
            data = {key: value for key, value in law_data(law).items() if key not in said}
            self.spec = {**self.spec, "law": data}
            self._disturbed()
            return True
        return False

    def set_contact(self, contact: Admittance) -> bool:
        """Go on with other numbers of the contact, its compliant frame where it is; not if that were unstable."""
        (case,) = self.setting.cases
        variant = replace(case.variant, law=msgspec.structs.replace(case.variant.law, contact=contact))
        setting = replace(self.setting, cases=(replace(case, variant=variant, prepared=None),))
        law = {key: value for key, value in self.spec["law"].items() if key != "contact"}
        with self.trying():
            check_contact(setting.spec, setting.cases[0])
            with self.lock:
                self.live.set_law(msgspec.structs.replace(self.live.law, contact=contact))
                self.spec = {**self.spec, "law": law, "contact": msgspec.to_builtins(contact)}
                self.setting = setting
                self._disturbed()
            return True
        return False

    def set_ghost(self, data: dict[str, Any] | None) -> bool:
        """Let a second robot run another law, as a spec says it, under the same target; None: no second one."""
        with self.trying():
            law = law_from(data) if data else None
            if law:  # or say why not, before anything changes
                self._made_ghost(self._prepared({**self.spec, "start": self._here()}), law)
            self._ghost_law = law
            return self.change(reference=self.spec["reference"])
        return False

    def tell(self, words: str) -> None:
        """Note what happened."""
        if not self.told or self.told[-1] != words:
            self.told.append(words)

    def _disturbed(self) -> None:
        """Note that the recording is no longer all that made the robot be where it is; it begins anew."""
        self.spec = {**self.spec, "start": self._here()}
        self._record(exact=False)

    # What is known of it

    @property
    def robot(self) -> Robot:
        """Which is driven."""
        return self.live.robot

    def check(self) -> LoopCheck:
        """Return what is to be expected of its loops; see `experiments.check`. It may take a second."""
        from dqcontrol.experiments.check import loop_checks  # a robot moves without

        (row,) = loop_checks(self.setting)
        return row

    def nearest(self) -> NearestPair | None:
        """Return the pair of shapes with least room; None if nothing is around."""
        return self.around.nearest(self.live.plant.q, self.live.state.time) if self.around else None

    @property
    def words(self) -> str:
        """What the robot does, what limits it, and what is missing, in words."""
        state, words = self.live.state, []
        if self.is_paused:
            words.append("paused (space goes on)")
        if self.live.is_stopped:
            words.append(f"{state.condition}; reset (R) brings it back")
        elif self.live.reason:
            words.append(self.live.reason)
        if (pulled := self.pulled) is not None:
            force = np.linalg.norm(pulled.force)
            words.append(f"pulled with {force:.0f} N, gives way by {1e3 * pulled.gave_way:.1f} mm")
            if self.live.law.contact is None:
                advice = "'Give way' in the tab Robot lets the end effector go along"
                words.append(f"servos and law hold against it; {advice}")
        elif contact := self.live.law.contact:
            words.append(_force_text(contact, self.live.control.contact_wrench))
        elif np.isfinite(state.missing) and state.missing > 5e-3:
            at_rest = np.abs(state.command).max(initial=0.0) < 0.02
            words.append(f"{1e3 * state.missing:.0f} mm {'out of reach' if at_rest else 'to go'}")
        if late := sum(moment.missed for moment in tuple(self.history)):  # the thread adds to it
            words.append(f"{late} periods late in the last 10 s: this machine is busy")
        return "; ".join(words) or "at its target"

    # The thread

    def _work(self) -> None:
        pace = Pace(self.live.period)
        while not self._closed.is_set():
            with self.lock:
                if pace.period != self.live.period:
                    pace = Pace(self.live.period)
                if not self.is_paused:
                    self.step()
                self.missed += pace.missed
                pace.missed = 0
            if (wait := pace.done()) > 0:
                time.sleep(wait)

    def step(self) -> None:
        """Move for one period."""
        live = self.live
        try:
            if self.driver is not None:
                self.driver(live)
            self._draw_spring()
            live.step()
            if not self.rows.is_full:
                for i in self.ends.aimed:
                    self._aimed.setdefault(i, []).append(live.aimed(i))
            if self.ghost:
                self.ghost.step()
        except Error as error:  # a plant that has no state any more
            self.tell(str(error))
            self.reset()
            return
        if live.is_stopped:
            self.tell(live.condition)
        every = max(round(_CHARTED / live.period), 1)
        if len(self.rows) % every == 0 or self.rows.is_full:
            self._note()
        fastest = float(np.abs(live.control.command).max(initial=0.0))
        self._still = self._still + live.period if fastest < _SLOW else 0.0
        if self._still >= _RESTS and (not self._exact or self.rows.is_full) and self.ghost is None:
            self._settle()

    def _note(self) -> None:
        state, nearest = self.live.state, self.nearest()
        clearance = nearest.room if nearest is not None else np.nan
        ghost = self.ghost.state.position_error if self.ghost else np.nan
        now = self.history[-1].time + _CHARTED if self.history else 0.0
        missed, self._noted = self.missed - self._noted, self.missed
        error, further = state.position_error, self.ends.further_error
        point = ChartPoint(now, error, state.share, clearance, further, ghost, self._force(), missed)
        self.history.append(point)

    def _force(self) -> float:
        """Return how hard the hand, or what it meets, is pressed, N; NaN if nothing says so."""
        plant = self.live.plant
        pulled = float(np.linalg.norm(self.pulled.force)) if self.pulled else 0.0
        if len(plant.wrench):
            return max(pulled, float(np.linalg.norm(plant.wrench[:3])))
        return pulled if plant.can_be_pushed else np.nan

    def _settle(self) -> None:
        """Begin a recording at rest from which everything follows, once the robot rests after another law began."""
        if self.live.plant.compiled() is None or self.live.law.contact:  # physics takes long to begin, and a
            return  # compliant frame would begin where it rests in the air
        before = self.ends
        with suppress(Error):
            self._take({**self.spec, "start": self._here(), "reference": _REST})
            self.ends.go_on_from(before)

    # What comes of it

    def record(self) -> Record:
        """Return what happened since the recording began."""
        with self.lock:
            return self.rows.record()

    def run_spec(self, points: str) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return the spec that gives the recording again, and the poses (N, 8) of the points files that it names.

        Parameters
        ----------
        points
            Name of the file for what the law drives; the others' begin with its stem.
        """
        with self.lock:
            spec, record, files = copy.deepcopy(self.spec), self.rows.record(), dict[str, Array]()
            aimed = {i: np.array(poses[: len(record)]) for i, poses in self._aimed.items()}
        locate_files(spec, self._folder)
        spec["duration"] = (len(record) - 1) * self.live.period
        spec["supervisor"] = spec.get("supervisor") or True
        if spec["reference"].get("kind") == "set-point":
            spec["reference"] = _streamed(points)
            files[points] = record.desired[:, POSE]
        for i, poses in aimed.items():
            if "reference" not in spec["tasks"][i]:
                name = f"{Path(points).stem}-task-{i + 1}.csv"
                spec["tasks"][i]["reference"] = _streamed(name)
                files[name] = poses
        return spec, files

    def save(self, path: Path) -> str:
        """Write a spec that gives the recording again, and targets as points files beside it; say how exactly.

        Raises
        ------
        Error
            If there is nothing to save, a file exists, or cannot be written.
        """
        with self.lock:
            if len(self.rows) < 2:
                raise Error("record: nothing has happened yet; move the target first")
            record, exact = self.record(), self._exact
            spec, files = self.run_spec(path.with_suffix(".csv").name)
        for file in (path, *(path.with_name(name) for name in files)):
            if file.exists():
                raise ExistsError(f"{file}: exists already; choose another name")
        spec = {key: readable_again(key, each) for key, each in spec.items()} | {"name": path.stem}
        with writing(path):
            path.write_text(yaml_text(spec), encoding="utf-8")
            for name, poses in files.items():
                path.with_name(name).write_text(_points(record.time, poses), encoding="utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            again = run(path).record
        count = min(len(again), len(record))
        apart = float(np.abs(again.q[:count] - record.q[:count]).max())
        changed = "; its law was changed in motion, or it was pushed: let the robot rest for an exact one"
        since = "" if exact else changed
        return f"{path}: {record.time[-1]:.1f} s; run again, joints differ by at most {apart:.2g} rad or m{since}"

    def python(self) -> str:
        """Return a Python program that drives the same robot with the same law to the present target."""
        spec, target = self.spec, self.live.target
        pose = _program_pose(self.live.state.desired if target is None else target)
        aims = "".join(f"live.aim({i}, {_program_pose(self.live.aimed(i))})\n" for i in self.ends.aimed)
        return (
            "import dqcontrol as dqc\n"
            "from dqcontrol.experiments.driven import live_of, prepare_driven\n\n"
            f"spec = {_plain(spec)!r}\n"
            "live = live_of(prepare_driven(spec))\n"
            f"live.target = {pose}\n"
            f"{aims}"
            "for _ in range(500):\n"
            "    live.step()\n"
            "print(live.state.missing)\n"
        )


def _force_text(contact: Admittance, wrench: Array) -> str:
    """Say what is pressed along the axes of a contact with a wanted force, or what the end effector feels, N."""
    wanted = zip("xyz", wrench[3:], contact.force.components[3:], strict=True)
    pressed = [
        f"presses {force:.2f} N along {axis}"
        + (f", {asked:.2f} asked" if isinstance(asked, float | int) else "")
        for axis, force, asked in wanted
        if asked is not None
    ]
    return "; ".join(pressed) or f"feels {np.linalg.norm(wrench[3:]):.1f} N"


def law_from(data: dict[str, Any]) -> Law:
    """Return a law from what a spec says of it."""
    return part_of_spec("law", yaml_text(data), "law")


def law_data(law: Law) -> dict[str, Any]:
    """Return what a spec says of a law, without what says nothing."""
    config = type(law).__struct_config__
    said = {
        each.encode_name: value
        for each in msgspec.structs.fields(law)
        if (value := getattr(law, each.name)) != each.default
        and not (each.default_factory is not msgspec.NODEFAULT and value == each.default_factory())
    }
    return {"kind": config.tag, **msgspec.to_builtins(said)}


def _program_pose(pose: Array) -> str:
    position = [round(float(x), 4) for x in algebra.translation(pose)]
    rotation = [round(float(x), 6) for x in algebra.rotation(pose)]
    return f"dqc.algebra.pose({rotation}, {position})"


def _plain(spec: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in spec.items() if value is not None}


def _streamed(name: str) -> dict[str, Any]:
    return {"kind": "points", "file": name, "streamed": True}


def _points(time: Array, poses: Array) -> str:
    """Return poses (N, 8) as a points file, to the last bit."""
    heading = ", ".join(("time", *DUAL_QUATERNION))
    rows = np.column_stack([time, poses])
    return heading + "\n" + "".join(", ".join(map(repr, row)) + "\n" for row in rows.tolist())
