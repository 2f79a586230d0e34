"""A mobile manipulator drives to a goal two metres away: a plan that it can follow, base and hand from above."""

import dqcontrol as dqc
from dqcontrol.figures.robots import base_path

run = dqc.run(
    {
        "name": "mobile-base",
        "robot": "little-john",  # an iRobot Create with an arm of five joints
        "start": [0, 0, 0, 0, -0.9, 0.9, 0.9, 0],  # x, y in m, φ and joints in rad
        "period": 0.05,  # s
        "reference": {
            "kind": "drive-to",
            "offset": {
                "translation": [-1.6, 1.2, 0],
                "rotation": [0, 0, 2.0],
            },  # m, rad: from the hand to its goal
            "speed_fraction": 0.8,  # of the velocity limits
        },
        "law": {"kind": "guided-proportional", "gain": 1},
        "plant": {"kind": "integrator"},
    }
)
print(f"{run.time[-1]:.1f} s, {run.metrics.position.final:.3f} mm from the goal")
base_path(run.robot, {"little-john": run.record}).savefig("06_mobile_base.png", dpi=150)
