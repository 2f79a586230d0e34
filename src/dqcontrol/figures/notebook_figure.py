"""Figures that notebooks show by themselves, whether or not pyplot is in use."""

from __future__ import annotations

from matplotlib.figure import Figure

from dqcontrol.figures.figure_files import encoded


class NotebookFigure(Figure):
    """A figure that a notebook shows when a cell ends with it: sharp, and as wide as on paper."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        width, height = (round(96 * inches) for inches in self.get_size_inches())
        return encoded(self, "png"), {"width": width, "height": height}
