"""Head and foot of a report: its subject, and the origin of its results."""

from __future__ import annotations

import math
import platform
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from dqcontrol.errors import Error
from dqcontrol.experiments.parameter_units import parameter_unit
from dqcontrol.experiments.prepared_experiment import sources
from dqcontrol.experiments.spec import read_spec
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.robots import Robot, SerialArm, WholeBody, describe
from dqcontrol.robots.files.urdf_xml import mesh_names, missing_meshes
from dqcontrol.tables.number_texts import length_text, number_text
from dqcontrol.tables.tables import Cell, Column, Table, VerdictCell

if TYPE_CHECKING:
    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.experiments.run import Run
    from dqcontrol.experiments.spec import Spec
    from dqcontrol.experiments.study import Study


RERUN_FOLDER = "again"  # folder that the commands write to
_LIBRARIES = ("numpy", "numba", "msgspec", "scipy", "mujoco", "matplotlib")


def command(name: str, *arguments: str, **options: Any) -> str:
    """Return a command line with its arguments quoted; options that are None or False are left out.

    Those with several values, in a tuple, are given several times.

    Examples
    --------
    >>> command("run", "spec.yaml", real_time=True, jobs=None, out="my results")
    "dqcontrol run spec.yaml --real-time --out 'my results'"
    """
    words = ["dqcontrol", name, *arguments]
    for key, given in options.items():
        for value in given if isinstance(given, tuple) else [given]:
            if value is not None and value is not False:
                words += [f"--{key.replace('_', '-')}", *([] if value is True else [str(value)])]
    return shlex.join(words)


def evaluation_command(evaluation: dict[str, Any]) -> str:
    """Return the command that measures a log again, from what ``spec.yaml`` says about it."""
    options = {key: value for key, value in evaluation.items() if key not in ("log", "robot")}
    robot = evaluation["robot"]
    ends = {key: robot.get(key) for key in ("base_link", "tip_link")}
    joints = options.pop("joints")
    options["start_time"] = options.pop("start", None)
    options["joints"] = ",".join(joints) if joints else None
    return command("evaluate", evaluation["log"], robot=robot["source"], **ends, **options, out=RERUN_FOLDER)


def origins(data: dict[str, Any]) -> Table:
    """Return versions and seeds of a spec's results, one a row.

    Parameters
    ----------
    data
        The spec's keys; empty for results without one.
    """
    rows = []
    if {"robot", "robots"} & data.keys():
        first, repeats = data.get("seed", 0), data.get("repeats", 1)
        if repeats == 1:
            rows.append(["seed", str(first)])
        else:
            rows.append(["seeds", f"{first} … {first + repeats - 1}, one a repeat"])
        if "sweep" in data:
            rows.append(["seed of the points", str(data["sweep"].get("seed", 0))])
    rows.append(["dqcontrol", f"{version('dqcontrol')}, sources {sources()}"])
    rows.append(["Python", platform.python_version()])
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            rows.append([name, version(name)])
    rows.append(["machine", f"{platform.system()} {platform.machine()}"])
    return Table([Column("what"), Column("value")], rows)


Fact = tuple[str, Cell]

_SEEN = 1e-3  # °; less than that is round-off, or of no interest
_SEVERAL = 8  # laws and others are listed up to so many
_ROUND = 1e4  # from there on four digits would be written as a power of ten
_LONG = 8  # numbers of a list that are all said; a pose has as many
_UNSAID = {"camera", "constraints", "gravity", "null_space"}  # said elsewhere, or rarely what a run is about


def about_run(run: Run, folder: Path) -> list[Fact]:
    """Return what a run is about, as names and texts; ``folder`` holds its recording."""
    facts: list[Fact] = [("Verdict", VerdictCell(run.verdict.words, not run.verdict.failure))]
    facts += [("Error", _error(run)), ("Robot", robot_words(run.robot))]
    data = parse_yaml("spec", run.spec)
    if "evaluation" in data:
        facts.append(("Log", Path(data["evaluation"]["log"]).name))
    else:
        facts += _of_spec(read_spec(data)[0])
    return [*facts, *_meshes([run.robot]), ("Date", _date(folder / "record.mcap"))]


def about_study(study: Study, verdict: VerdictCell) -> list[Fact]:
    """Return what a study is about, as names and texts."""
    facts: list[Fact] = [("Verdict", verdict)]
    spec, _ = read_spec(parse_yaml("spec", study.spec))
    robots = {run.robot.name: run.robot for run in study.runs.values()}
    facts += [("Robot", robot_words(robot)) for robot in robots.values()]
    return [*facts, *_of_spec(spec), *_meshes(robots.values()), ("Date", _date(Path()))]


def robot_words(robot: Robot) -> str:
    """Return a robot in a line, as ``iiwa7: 7 joints, reach 0.926 m``."""
    about = describe(robot)
    count = len(about.joints)
    words = [f"{count} {'coordinates' if about.bases else 'joints' if count > 1 else 'joint'}"]
    words += [about.ends] if about.ends else []
    words += [f"{about.bases} base"] if about.bases else []
    return f"{about.name}: {', '.join([*words, f'reach {about.reach:.3g} m'])}"


def described(part: msgspec.Struct, where: str = "") -> str:
    """Return a law, plant or motion in a line: its kind, and those parameters that are not the default.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> described(dqc.laws.Proportional(gain=8), "law")
    'proportional: gain 8 1/s'
    """
    words = []
    for each in msgspec.structs.fields(part):
        value = getattr(part, each.name)
        default = each.default if each.default_factory is msgspec.NODEFAULT else each.default_factory()
        if (each.required or value != default) and (name := each.encode_name) not in _UNSAID:
            words.append(f"{name.replace('_', ' ')} {_value(value, f'{where}.{name}')}")
    kind = str(type(part).__struct_config__.tag)
    return f"{kind}: {', '.join(words)}" if words else kind


def _of_spec(spec: Spec) -> Iterator[Fact]:
    laws = {variant.label: variant.law for variant in spec.variants}
    yield from _listed("Law", {label: described(law, "law") for label, law in laws.items()})
    kept = {label: law.constraints for label, law in laws.items() if law.constraints is not None}
    alike = len(kept) == len(laws) and all(each == next(iter(kept.values())) for each in kept.values())
    for label, constraints in list(kept.items())[: 1 if alike else _SEVERAL]:
        yield "Constraints", _constraints(constraints) if alike else f"{label}: {_constraints(constraints)}"
    yield "Motion", described(spec.reference, "reference")
    yield from _listed("Plant", {k: described(plant, "plant") for k, plant in spec.plant_by_label.items()})
    yield "Control period", f"{1e3 * spec.period:g} ms"
    if spec.repeats > 1:
        yield "Repeats", str(spec.repeats)


def _error(run: Run) -> str:
    position, orientation = run.metrics.position, run.metrics.orientation
    rms, most = (length_text(1e-3 * error) for error in (position.settled_rms, position.settled_peak))
    words = f"position {rms} RMS, {most} at most"
    if orientation.settled_peak >= _SEEN:
        rms, most = (number_text(error, 2) for error in (orientation.settled_rms, orientation.settled_peak))
        words += f"; orientation {rms}° RMS, {most}° at most"
    return words


def _listed(name: str, texts: Mapping[str, str]) -> Iterator[Fact]:
    for label, text in list(texts.items())[:_SEVERAL]:
        yield name, text if text.partition(":")[0] == label else f"{label}: {text}"
    if len(texts) > _SEVERAL:
        yield name, f"… and {len(texts) - _SEVERAL} more"


def _constraints(given: Constraints) -> str:
    """Return what is kept, as ``clear of table (plane) and ball (moving sphere) by 10 mm; upright at most 35°``."""
    words = [f"clear of {_bodies(given)}"] if given.obstacles else []
    if given.zones:
        words.append(f"inside {_listing([f'{name} ({each.kind})' for name, each in given.zones.items()])}")
    for name, angle in given.angles.items():
        bounds = (("at least", angle.at_least), ("at most", angle.at_most), ("not parallel by", angle.apart))
        said = [f"{which} {math.degrees(value):.3g}°" for which, value in bounds if value is not None]
        words.append(f"{name} {' and '.join(said)}")
    words += [f"{name} in sight" for name in given.sights]
    return "; ".join([*words, *(["joint limits"] if given.joint_limits else [])])


def _bodies(given: Constraints) -> str:
    """Return the bodies that are kept clear of, each with its kind, and by how much."""
    bodies = given.world.bodies if given.world is not None else {}
    said, margins = [], []
    for name, each in given.obstacles.items():
        moves = each.moves.velocity is not None or each.moves.path is not None
        said.append(f"{name} ({'moving ' if moves else ''}{bodies[name].kind})")
        margin = given.margin if each.clear.margin is None else each.clear.margin
        margins.append(f"by {1e3 * margin:g} mm")
    if len(set(margins)) == 1:
        return f"{_listing(said)} {margins[0]}"
    return _listing([f"{one} {margin}" for one, margin in zip(said, margins, strict=True)])


def _listing(names: Sequence[str]) -> str:
    few = [*names[:_SEVERAL], *([f"{len(names) - _SEVERAL} more"] if len(names) > _SEVERAL else [])]
    return " and ".join([", ".join(few[:-1]), few[-1]]) if len(few) > 1 else few[0]


def _value(value: Any, key: str) -> str:
    """Return a value with its unit, or a structure in words and numbers."""
    plain = msgspec.to_builtins(value, enc_hook=str)
    if isinstance(value, msgspec.Struct) and type(value).__struct_config__.tag:
        return f"({described(value, key)})"
    unit = parameter_unit(key) if isinstance(plain, int | float) and not isinstance(plain, bool) else ""
    return f"{_words(plain)} {unit}".strip()


def _words(plain: Any) -> str:
    """Return plain data as a person writes it, without what says nothing; of long lists how long they are."""
    if isinstance(plain, bool):
        return "yes" if plain else "no"
    if isinstance(plain, int | float):
        return f"{plain:{'.4g' if abs(plain) < _ROUND else '.6g'}}".replace("-", "−")
    if isinstance(plain, dict):
        said = [f"{key.replace('_', ' ')} {_words(value)}" for key, value in plain.items() if _says(value)]
        return f"({'; '.join(said)})" if said else "as by default"
    if isinstance(plain, list | tuple):
        nested = any(isinstance(each, list | tuple | dict) for each in plain)
        return f"of {len(plain)}" if len(plain) > (1 if nested else _LONG) else ", ".join(map(_words, plain))
    return Path(plain).name if Path(str(plain)).is_absolute() else str(plain)


def _says(plain: Any) -> bool:
    """Tell whether plain data says anything: neither nothing nor only zeros."""
    if isinstance(plain, dict):
        return any(map(_says, plain.values()))
    if isinstance(plain, list | tuple):
        return any(map(_says, plain))
    return (plain is not None and plain != 0) or isinstance(plain, bool)


def _meshes(robots: Any) -> Iterator[Fact]:
    """Say which meshes the copied file of a robot needs elsewhere, and which are not even found here."""
    for robot in robots:
        for arm in robot.parts if isinstance(robot, WholeBody) else [robot]:
            if not isinstance(arm, SerialArm) or arm.urdf is None:
                continue
            path = arm.urdf[0]
            try:
                names, missing = mesh_names(path), missing_meshes(path)
            except Error:  # a file that is gone
                continue
            if names:
                words = f"{len(names)} named by {path.name}, as {names[0]}, are not copied with it"
                yield "Meshes", words + f"; {len(missing)} are not found here" * bool(missing)


def _date(file: Path) -> str:
    """Return when a file was written, or now."""
    when = datetime.fromtimestamp(file.stat().st_mtime) if file.is_file() else datetime.now()
    return when.strftime("%Y-%m-%d %H:%M")
