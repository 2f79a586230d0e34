"""Frames written as a clip: GIF, WebP or MP4."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import MissingExtraError

CLIPS = (".gif", ".mp4", ".webp")
Pixels = NDArray[np.uint8]


def write_clip(frames: Iterable[Pixels], path: Path, rate: float) -> None:
    """Write frames, shapes (height, width, 3), as the file's ending says; .gif and .webp play for ever.

    Parameters
    ----------
    frames
        Of one size, for .mp4 even.
    path
        Ends in one of `CLIPS`.
    rate
        Frames a second.

    Raises
    ------
    MissingExtraError
        If it ends in .mp4 and PyAV is not installed.
    """
    if path.suffix.lower() == ".mp4":
        _write_mp4(frames, path, rate)
        return
    image = importlib.import_module("PIL.Image")
    pictures = [image.fromarray(frame) for frame in frames]
    more: dict[str, Any] = (
        {"quality": 75, "method": 4} if path.suffix.lower() == ".webp" else {"optimize": True}
    )
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=round(1000 / rate), loop=0, **more
    )


def import_av() -> Any:
    """Return PyAV.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        return importlib.import_module("av")
    except ImportError:
        raise MissingExtraError(
            "clip: .mp4 needs PyAV; pip install 'dqcontrol[video]', or choose .webp or .gif"
        ) from None


def _write_mp4(frames: Iterable[Pixels], path: Path, rate: float) -> None:
    """Write frames as H.264, which browsers and presentations play."""
    av = import_av()
    with av.open(str(path), "w") as file:
        stream = file.add_stream(
            "libx264", rate=Fraction(rate).limit_denominator(1000), options={"crf": "20"}
        )
        every = iter(frames)
        first = next(every)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"

        def add(pixels: Pixels) -> None:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")))

        with ThreadPoolExecutor(1) as beside:  # a frame is encoded while the next one is drawn
            last = beside.submit(add, first)
            for pixels in every:
                last.result()
                last = beside.submit(add, pixels)
            last.result()
        file.mux(stream.encode())
