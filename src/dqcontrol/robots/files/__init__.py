"""Robot files: YAML, URDF, xacro and MJCF; and the robots that come with dqcontrol, whose names load nothing else."""

from pathlib import Path

MODELS = Path(__file__).parent.parent / "models"


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that come with dqcontrol."""
    return tuple(sorted(path.stem for path in MODELS.glob("*.yaml")))
