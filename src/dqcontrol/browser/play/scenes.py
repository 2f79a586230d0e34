"""Scenes to choose from: a robot, a task and what to look for, a minute each."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

_REST = {"kind": "set-point", "duration": 1.0}
_IIWA = {"robot": "iiwa7", "start": [0, 0.6, 0, -1.6, 0, 0.9, 0], "period": 0.01, "reference": _REST}
_PANDA = {"robot": "panda", "start": [0, -0.3, 0, -2.0, 0, 1.8, 0.7], "period": 0.01, "reference": _REST}
_FEEDFORWARD = {"kind": "proportional-feedforward", "gain": 5.0}
_CIRCLE = {"kind": "circle", "radius": 0.1, "duration": 60.0, "turns": 12, "plane": "yz"}


class Scene(NamedTuple):
    """Something to try.

    Attributes
    ----------
    title
        In a few words.
    look_for
        Three sentences.
    spec
        Plain data of a spec of one run.
    ghost
        Law of a second robot under the same target, as a spec says it; None without one.
    learns
        How many repeats are learnt from; 0: none.
    """

    title: str
    look_for: str
    spec: dict[str, Any]
    ghost: dict[str, Any] | None = None
    learns: int = 0


def _spec(base: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return {"name": "play", "law": _FEEDFORWARD, "plant": {"kind": "servo"}, **base, **keys}


SCENES = (
    Scene(
        "Six laws, one arm",
        "The Meka arm of [P16] follows a circle; the ghost has no feed-forward and stays behind by the speed over the "
        "gain. Choose another law in the tab Law and watch the chart of the error. Which laws leave nothing behind, "
        "and what does that cost in speed of joints?",
        _spec(
            {"robot": "meka-a2", "start": [0.2, 0.1, 0.1, 1.2, 0.1, 0.2, 0.1], "period": 0.01},
            reference=_CIRCLE | {"radius": 0.05},
        ),
        {"kind": "proportional", "gain": 5.0},
    ),
    Scene(
        "A goal for a mobile manipulator",
        "little-john, the robot of [S17], has a differential drive: it cannot move sideways. Drag the target two "
        "metres to its side and watch how base and arm share the way. The hand goes straight; the base curves.",
        _spec(
            {"robot": "little-john", "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0], "period": 0.02},
            reference=_REST,
            law={"kind": "feedback-linearization", "stiffness": 4.0, "damping": 4.0},
            limits={"velocity": True, "position": {"kind": "modified-clamping"}},
        ),
    ),
    Scene(
        "Through a singularity",
        "The wrist of the UR5 is nearly straight: in one direction of turning it cannot move. Drag the target sideways "
        "through it with the filtered inverse, then choose another inverse in the tab Law. One is calm and leaves an "
        "error for a moment, the other is exact and fast where it should not be.",
        _spec(
            {"robot": "ur5", "start": [0.0, -1.2, 1.6, -0.4, 0.02, 0.0], "period": 0.01},
            reference=_REST,
            supervisor={"slow_below": 0.0, "hold_below": 0.0},
        ),
    ),
    Scene(
        "Half a turn",
        "The target is turned by nearly half a turn, and there are two ways round. Turn it a little further by the "
        "rings: the hand changes its mind only after half a turn in all, and does not tremble between. A pose and its "
        "negative are one place, so the shorter way is taken.",
        _spec(
            _IIWA,
            reference={"kind": "set-point", "duration": 20.0, "offset": {"rotation": [0, 0, 3.0]}},
        ),
    ),
    Scene(
        "Turn the gain until it shakes",
        "These joints hear commands 30 ms late and follow with a lag of 50 ms. Take the slider in the tab Law past the "
        "mark 'good', then past 'limit': errors ring first, then grow until limits hold them. Take it back; if the "
        "supervisor has stopped the robot, R brings it back.",
        _spec(
            _IIWA,
            law={"kind": "proportional", "gain": 4.0},
            plant={"kind": "servo", "delay": 0.03, "time_constant": 0.05},
        ),
    ),
    Scene(
        "Lag and delay",
        "The law knows how late the joints are and leads by that; the ghost does not. Change lag and delay in the tab "
        "Robot and watch both errors. The delay costs more than the lag of the same length: gains have to fall.",
        _spec(
            _IIWA,
            reference=_CIRCLE,
            plant={"kind": "servo", "delay": 0.02, "time_constant": 0.05},
        ),
        {"kind": "proportional-feedforward", "gain": 5.0, "feedforward": "printed"},
    ),
    Scene(
        "A ball on the path",
        "The hand follows a circle, and a ball stands on it. The arm keeps 10 mm away and comes back behind it; drag "
        "the ball in the tab World. The chart of clearance never falls below zero.",
        _spec(
            _PANDA,
            reference=_CIRCLE | {"radius": 0.12},
            law=_FEEDFORWARD | {"gain": 8.0},
            plant={"kind": "integrator"},
            world={"floor": True, "ball": {"sphere": 0.06, "position": [0.53, 0.12, 0.42]}},
            constraints={"clear_of": "all", "margin": 0.01, "acceleration": 10.0},
        ),
    ),
    Scene(
        "Two arms and a tray",
        "Two Pandas hold a tray: what lies between both hands is the target, and how they hold it comes first. Drag "
        "and tilt it by the large arrows: out of one arm's reach both stop, and the tray is not torn. The small arrows "
        "move one hand, and so what both hold.",
        _spec(
            {
                "robot": {"source": "two-pandas", "task": "absolute"},
                "start": [-0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7],
                "period": 0.01,
            },
            reference=_REST,
            tasks=[{"task": "relative", "gain": 10.0, "level": 0}],
        ),
    ),
    Scene(
        "Writing on a board",
        "A pen writes letters on a board that is 3° off, and presses with 2 N whatever the plan says. The chart of the "
        "force shows how well it keeps that; pull the target into the board, and the force stays. The hand gives way "
        "along z alone: across, it follows the letters.",
        _spec(
            {"robot": "iiwa7", "start": [0, 0.6, 0, -1.6, 0, 0.9, 0], "period": 0.004},
            reference={"kind": "drawing", "file": str(Path(__file__).with_name("board.txt"))},
            law={"kind": "proportional-feedforward", "gain": 1.0},
            contact={
                "axes": "base",
                "translation": {"damping": 100.0, "stiffness": ["rigid", "rigid", 0.0]},
                "force": {"z": 2.0},
                "limits": {"speed": 0.05, "depth": 0.02},
            },
            world={
                "board": {
                    "box": [0.4, 0.4, 0.04],
                    "position": [0.55, 0.0, 0.284],
                    "rpy": [0.0524, 0.0, 0.0],
                    "stiffness": 2000.0,
                    "friction": 0.2,
                }
            },
            plant={
                "kind": "servo",
                "time_constant": 0.04,
                "delay": 0.012,
                "wrist": {"filter": 0.005, "force_noise": 0.1},
            },
        ),
    ),
    Scene(
        "Learning, repeat by repeat",
        "The joints are late and sag, so the circle comes out wrong. After each repeat the reference is shifted by "
        "what was missing, as `dqcontrol learn` does, and the line above says by how much the hand missed the circle. "
        "What is left after four repeats, and why is it not zero?",
        _spec(
            {"robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01},
            reference={"kind": "circle", "radius": 0.06, "duration": 4.0, "ramp": 0.5},
            plant={"kind": "servo", "time_constant": 0.05, "delay": 0.02, "sag": 1.0, "encoder_noise": 5e-4},
        ),
        learns=4,
    ),
)
