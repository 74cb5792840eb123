"""Where the panels of a figure stand: a grid of equal images with row labels and colour bars."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from bench.reporting.canvas import new_figure

_GAP_IN = 0.06
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.26, 0.62, 0.22, 0.05


class PanelGrid:
    """Places of equal size, with room for row labels on the left and colour bars on the right."""

    def __init__(self, *, columns: int, rows: int, width_in: float, height_in: float) -> None:
        self._gap_in, self._width_in, self._height_in = _GAP_IN, width_in, height_in
        self._columns = columns
        self._full_in = (
            _LEFT_IN + columns * width_in + (columns - 1) * self._gap_in + _RIGHT_IN,
            _TOP_IN + rows * height_in + (rows - 1) * self._gap_in + _BOTTOM_IN,
        )
        self.figure = new_figure(*self._full_in)

    def axes(self, row: int, column: int) -> Axes:
        """A new panel."""
        left = _LEFT_IN + column * (self._width_in + self._gap_in)
        return self.figure.add_axes(self._box(left, row, self._width_in, self._height_in))

    def label(self, row: int, text: str) -> None:
        """Write the name of a row on its left."""
        left, bottom, _, height = self._box(_LEFT_IN - 0.13, row, 0.0, self._height_in)
        self.figure.text(left, bottom + height / 2, text, rotation=90, ha="center", va="center", fontsize=7)

    def colour_bar(self, row: int, *, saturation: float, colour_map: str, unit: str) -> None:
        """Draw the scale of a row, 0 to `saturation`, on its right."""
        scale = ScalarMappable(norm=Normalize(vmin=0.0, vmax=saturation), cmap=colour_map)
        left = _LEFT_IN + self._columns * (self._width_in + self._gap_in)
        axes = self.figure.add_axes(self._box(left, row, 0.09, self._height_in * 0.9))
        bar = self.figure.colorbar(scale, cax=axes, extend="max", ticks=[0.0, saturation / 2, saturation])
        bar.ax.tick_params(labelsize=6, length=2, pad=1.5)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.set_label(unit, fontsize=6)
        bar.ax.yaxis.set_label_coords(4.6, 0.5)  # one line for all bars, whatever their numbers' width

    def _box(self, left_in: float, row: int, width_in: float, height_in: float) -> tuple[float, float, float, float]:
        full_width, full_height = self._full_in
        top_in = _TOP_IN + row * (self._height_in + self._gap_in) + (self._height_in - height_in) / 2
        return (
            left_in / full_width,
            1.0 - (top_in + height_in) / full_height,
            width_in / full_width,
            height_in / full_height,
        )
