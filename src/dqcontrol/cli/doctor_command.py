"""Check the environment: what dqcontrol needs from the machine that it runs on, and what to do where it is missing."""

from __future__ import annotations

import importlib
import os
import socket
import sys
from collections.abc import Iterator
from importlib import metadata
from typing import Any, NamedTuple

from packaging.requirements import Requirement

from dqcontrol.cli.options import Switch
from dqcontrol.cli.screen import FAILED, print_table

_ARM: dict[str, Any] = {
    "name": "ahead",
    "robot": "iiwa7",
    "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
    "period": 0.01,
    "duration": 0.05,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 2.0},
    "law": {"kind": "proportional", "gain": 2.0},
    "plant": {"kind": "servo"},
}
_BASE = {
    "robot": "little-john",
    "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],
    "reference": {"kind": "set-point"},
    "plant": {"kind": "integrator"},
}
_WEIGHTS = {"error_weight": 100.0, "control_weight": 1.0}
_GAINS = {"orientation_gain": 2.0, "translation_gain": 2.0}
_LAWS: dict[str, dict[str, Any]] = {
    "proportional": {"gain": 2.0},
    "proportional-feedforward": {"gain": 2.0},
    "decoupled-proportional": {"gain": 2.0},
    "linear-quadratic-r8": _WEIGHTS,
    "linear-quadratic-dq": _WEIGHTS,
    "h-infinity": _GAINS,
    "h-infinity-tracking": _GAINS,
    "open-loop": {},
}
CASES: dict[str, dict[str, Any]] = {
    **{f"law {kind}": {"law": {"kind": kind, **keys}} for kind, keys in _LAWS.items()},
    "ideal joints": {"plant": {"kind": "integrator"}},
    "supervisor": {"supervisor": True},
    "constraints": {"constraints": {"self_collision": False, "zones": {}, "acceleration": 50.0}},
    "mobile base": {**_BASE, "law": {"kind": "feedback-linearization", "stiffness": 1.0, "damping": 2.0}},
}
"""What differs from a proportional law on the servos of an arm; kernels are the same for every arm."""


def case_spec(name: str) -> dict[str, Any]:
    """Return the spec of a case."""
    return {**_ARM, **CASES[name]}


def compile_ahead() -> int:
    """Run each case once, saying which on the error output, and return how many kernels are new in the cache."""
    import warnings

    from dqcontrol.compiled import kernel_cache
    from dqcontrol.experiments import run
    from dqcontrol.experiments.contact_kernels import pair_distances

    before = kernel_cache.state()[2]
    for number, name in enumerate(CASES, start=1):
        print(f"dqcontrol: compiling {number} of {len(CASES)}: {name} …", file=sys.stderr, flush=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of runs that nobody looks at
            run(case_spec(name))
    _ = pair_distances.compiled  # which short runs do without
    return kernel_cache.state()[2] - before


OK, MISSING, PROBLEM = "ok", "missing", "problem"
OLDEST_PYTHON = (3, 11)
_NAMED = 3  # packages of an extra


class Finding(NamedTuple):
    """One thing that was looked at.

    Attributes
    ----------
    what
        Its name.
    found
        Version, folder or reason.
    verdict
        ``"ok"``, ``"missing"`` (optional, and not here) or ``"problem"`` (dqcontrol suffers from it).
    cure
        What to do; empty if nothing.
    """

    what: str
    found: str
    verdict: str = OK
    cure: str = ""


def examine() -> list[Finding]:
    """Look at everything once, in the order of a report; it takes about a second."""
    return [_python(), *_packages(), _cache(), _opengl(), _ros2(), _loopback()]


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info < OLDEST_PYTHON:
        return Finding("Python", version, PROBLEM, "install Python 3.11 or newer")
    return Finding("Python", version)


def _packages() -> Iterator[Finding]:
    """Look at the required packages one by one, at the optional ones extra by extra."""
    requirements = [Requirement(text) for text in metadata.requires("dqcontrol") or ()]
    for one in requirements:
        if one.marker is None or one.marker.evaluate({"extra": ""}):
            found, fits = _installed(one)
            cure = "" if fits else f"pip install '{one.name}{one.specifier}'"
            yield Finding(one.name, found, OK if fits else PROBLEM, cure)
    for extra in metadata.metadata("dqcontrol").get_all("Provides-Extra") or ():
        looked = {one.name: _installed(one) for one in requirements if _only_for(extra, one)}
        fits = all(fit for _, fit in looked.values())
        chosen = {name: one for name, one in looked.items() if fits or not one[1]}
        texts = [f"{name} {found}" for name, (found, _) in chosen.items()]
        text = ", ".join(texts[:_NAMED]) + f" and {len(texts) - _NAMED} more" * (len(texts) > _NAMED)
        cure = "" if fits else f"pip install 'dqcontrol[{extra}]'"
        yield Finding(f"extra [{extra}]", text, OK if fits else MISSING, cure)


def _only_for(extra: str, requirement: Requirement) -> bool:
    marker = requirement.marker
    return marker is not None and marker.evaluate({"extra": extra}) and not marker.evaluate({"extra": ""})


def _installed(requirement: Requirement) -> tuple[str, bool]:
    """Return the version found, and whether it will do."""
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        return "not installed", False
    if requirement.specifier.contains(version, prereleases=True):
        return version, True
    return f"{version}, not {requirement.specifier}", False


def _cache() -> Finding:
    from dqcontrol.compiled import kernel_cache

    folder, writable, kernels = kernel_cache.state()
    if not writable:
        cure = "set DQCONTROL_CACHE to a writable folder; until then each process compiles anew"
        return Finding("compiled kernels", f"{folder}: cannot be written", PROBLEM, cure)
    held = f"{kernels} kernels" if kernels else "empty; the first runs compile, once"
    return Finding("compiled kernels", f"{folder}: {held}")


def _opengl() -> Finding:
    from dqcontrol.errors import Error
    from dqcontrol.films.drawn_scene import offscreen

    try:
        with offscreen(16, 16) as backend:
            return Finding("OpenGL for pictures of physics", backend)
    except Error as error:
        reason, _, cure = str(error).partition("; on ")
        return Finding("OpenGL for pictures of physics", reason, MISSING, f"on {cure}" if cure else reason)


def _ros2() -> Finding:
    try:
        importlib.import_module("rclpy")
    except ImportError as error:
        cure = "source a ROS 2 installation, or pip install 'dqcontrol[ros2]'"
        return Finding("ROS 2", f"rclpy cannot be imported ({error})", MISSING, cure)
    known = metadata.packages_distributions().get("rclpy", ())
    version = metadata.version(known[0]) if known else "of unknown version"
    return Finding("ROS 2", f"rclpy {version} {os.environ.get('ROS_DISTRO', '')}".strip())


def _loopback() -> Finding:
    """Try whether a server for this machine alone could start, as the browser view does."""
    try:
        with socket.create_server(("127.0.0.1", 0)):
            return Finding("ports of this machine", "127.0.0.1 takes servers")
    except OSError as error:
        return Finding("ports of this machine", f"127.0.0.1: {error}", PROBLEM, "allow servers on 127.0.0.1")


def doctor(
    *,
    all: Switch = False,
    compile: Switch = False,
) -> None:
    """Check versions, extras, the compiler's cache, OpenGL, ROS 2 and ports, and say what to do about problems.

    Ends with 1 if there is a problem; something optional that is missing is none.

    Parameters
    ----------
    all
        Also what is well and what is missing but optional.
    compile
        Compile the kernels of usual runs first, so that later ones begin at once; it takes minutes, once.
    """
    if compile:
        new = compile_ahead()
        print(f"compiled kernels: {new} new, of {len(CASES)} usual cases")
    import dqcontrol
    from dqcontrol.tables.tables import Column, Table

    findings = examine()
    problems = [one for one in findings if one.verdict == PROBLEM]
    shown = findings if all else problems
    columns = [Column(each) for each in ("what", "found", "verdict", "what to do")]
    title = f"dqcontrol {dqcontrol.__version__}"
    if shown:
        print_table(Table(columns, [[*one[:3], one.cure or None] for one in shown], title))
    else:
        print(title)
    optional = sum(one.verdict not in (OK, PROBLEM) for one in findings)
    said = f"{len(problems) or 'no'} problem{'s' * (len(problems) != 1)}"
    said += (
        "" if all else f"; {len(findings)} things looked at, {optional} of them optional and missing: --all"
    )
    print(said)
    if problems:
        sys.exit(FAILED)
