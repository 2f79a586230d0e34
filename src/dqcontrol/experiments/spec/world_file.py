"""Worlds in files of their own."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.files.yaml_file import convert
from dqcontrol.world import World
from dqcontrol.world.world import Bodies, plain_world


def load_world(path: str | Path) -> World:
    r"""Return the world of a YAML file, as the ``world`` of a spec.

    Raises
    ------
    FileFormatError
        If the file cannot be read or says something else.

    Examples
    --------
    >>> import pathlib, tempfile, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "shelf.yaml"
    >>> _ = file.write_text("floor: true\nball: {sphere: 60 mm, position: [0.8, 0.1, 0.5]}")
    >>> list(dqc.load_world(file).bodies)
    ['floor', 'ball']
    """
    data = numbers_for_quantities(str(path), plain_world(str(path), Path()), list(kinds_of(Bodies)))
    return World(bodies=convert(path, data, Bodies))
