"""Draw the arms of docs/i-have.md: `python tools/update_arms.py`. Robots of other packages have to be installed."""

from pathlib import Path

import numpy as np

import dqcontrol as dqc

PICTURES = Path(__file__).parents[1] / "docs/pictures/arms"
# Robot, and a start from which the hand can go round a circle.
ARMS = {
    "franka": ("panda", [0, -0.785, 0, -2.356, 0, 1.571, 0.785]),
    "ur": ("ur5", [0, -1.2, 1.4, -1.7, -1.5, 0]),
    "xarm": ("example-robot-data:xarm_description/urdf/xarm7.urdf", None),
    "kinova": (
        {
            "source": "example-robot-data:kinova_description/robots/kinova.urdf",
            "tip_link": "j2s6s200_end_effector",
        },
        None,
    ),
    "so101": ("example-robot-data:so_arm_description/urdf/so101.urdf", [0, -0.5, 0.8, 0.4, 0]),
    "aloha": (
        {
            "source": "gym-aloha:bimanual_viperx_transfer_cube.xml",  # pip install --no-deps gym-aloha
            "tip_link": "vx300s_left/gripper_link",
        },
        None,
    ),
    "iiwa": ("iiwa7", [0, 0.6, 0, 1.6, 0, 0.6, 0]),
    "any": (str(Path(__file__).parents[1] / "examples/robots/six-axis.urdf"), None),
}


def main() -> None:
    """Draw them all."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name, (robot, start) in ARMS.items():
        loaded = dqc.load_robot(**robot) if isinstance(robot, dict) else dqc.load_robot(robot)
        reach = dqc.robots.describe(loaded).reach or 1.0
        if start is None:
            start = dqc.robots.most_dexterous(loaded, 0.3 * reach).tolist()
        spec = {
            "name": name, "robot": robot, "start": start, "period": 0.01,
            "reference": {"kind": "circle", "radius": float(np.round(0.08 * reach, 3)), "duration": 4.0, "plane": "xz"},
            "law": {"kind": "proportional-feedforward", "gain": 5}, "plant": {"kind": "integrator"},
        }  # fmt: skip
        done = dqc.run(spec)
        dqc.figures.robot_picture(done.robot, done.record).savefig(PICTURES / f"{name}.png", dpi=100)
        print(name, f"{1e3 * done.record.position_error.max():.2f} mm")


if __name__ == "__main__":
    main()
