"""The robots that come with dqcontrol: what asks for their names alone loads nothing else."""

from pathlib import Path

MODELS = Path(__file__).parent.parent / "models"


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots that come with dqcontrol."""
    return tuple(sorted(path.stem for path in MODELS.glob("*.yaml")))
