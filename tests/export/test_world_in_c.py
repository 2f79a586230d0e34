"""What a controller in C knows of the world: what stands, what moves as it says, meshes too."""

import numpy as np
import pytest
from exported import LibraryController, make, needs_c

import dqcontrol as dqc
from dqcontrol.experiments.spec import read_spec
from dqcontrol.export import export_controller

trimesh = pytest.importorskip("trimesh")

START = [0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.7]
MARGIN, T = 0.02, 0.01


def crowded(mesh):
    """Return a spec of a hand that stays, a ball that circles into it, a wall and a wedge."""
    x, y, z = dqc.algebra.translation(dqc.load_robot("panda").fkm(np.array(START)))
    circle = {"kind": "circle", "radius": 0.1, "plane": "xy", "duration": 4.0}
    return {
        "name": "crowded",
        "robot": "panda",
        "start": START,
        "period": T,
        "duration": 4,
        "reference": {"kind": "set-point"},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "integrator"},
        "world": {
            "wall": {"box": [0.02, 1, 1], "position": [x + 0.25, 0, 0.5]},
            "ball": {"sphere": 0.05, "position": [x, y + 0.3, z], "moves": {"reference": circle}},
            "wedge": {"mesh": mesh, "position": [x, y - 0.35, z]},
        },
        "constraints": {"clear_of": "all", "margin": MARGIN, "acceleration": 10},
    }


@pytest.mark.slow
@needs_c
def test_it_keeps_clear_of_what_stands_and_what_moves(tmp_path):
    trimesh.creation.icosphere(1, 0.08).export(tmp_path / "wedge.stl")
    spec = crowded(str(tmp_path / "wedge.stl"))
    folder = export_controller(spec, tmp_path / "c").folder
    assert "largest difference to Python 0 (bits compared)" in make(folder, "test")
    make(folder)
    arm, world = dqc.load_robot("panda"), read_spec(spec)[0].surroundings
    assert world is not None
    assert arm.shapes is not None
    ball, (around,) = world.bodies["ball"], world.bodies["ball"].shapes
    library, q, least = LibraryController(folder), np.array(START), []
    for k in range(400):
        shift = ball.moves.shifts(np.array([k * T]))[0]  # type: ignore[union-attr]
        there = around.moved(dqc.algebra.pose([1, 0, 0, 0], shift))
        least.append(
            min(dqc.geometry.distance(each, there).distance for each in arm.shapes.moved(arm, q)[2:])
        )
        q = q + T * library.step(q, k * T)
        assert library.status == 0
    stays = [
        min(
            dqc.geometry.distance(each, around.moved(dqc.algebra.pose([1, 0, 0, 0], shift))).distance
            for each in arm.shapes.moved(arm, np.array(START))[2:]
        )
        for shift in ball.moves.shifts(np.arange(400) * T)  # type: ignore[union-attr]
    ]
    assert min(stays) < MARGIN - 5e-3  # an arm that stays would be hit, or nearly
    assert MARGIN - 1e-3 < min(least) < MARGIN + 6e-3  # what is allowed for the way between samples on top
