from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from bench.evaluation.definitions import HALF
from bench.evaluation.maps import RangeMap, RangeMaps, range_maps
from bench.evaluation.protocol import load_protocol
from bench.records.reference import Direction
from bench.reporting.figures import (
    HALF_TITLE,
    HATCH,
    draw_cells,
    draw_range_maps,
    draw_run_maps,
    draw_threshold_sweep,
    new_figure,
)
from tests.support.result_rows import evaluated, object_row, objects_table
from tests.support.tiny import OUTLINE_M

EDGES_M = np.arange(-8.0, 9.0)


def range_map(cells, *, object_class="vehicle", direction=Direction.LATERAL, least=5):
    """Cells as {(x, y): (object-frames, detected)}, by their lower corner."""
    frames, detected = (np.zeros((16, 16), dtype=np.int64) for _ in range(2))
    for (x, y), (total, found) in cells.items():
        frames[x + 8, y + 8], detected[x + 8, y + 8] = total, found
    return RangeMap(
        object_class=object_class, direction=direction, edges_m=EDGES_M, object_frames=frames, detected=detected,
        min_object_frames=least,
    )  # fmt: skip


def corners(collection):
    """(left, bottom) of each drawn cell, in data coordinates (y, x)."""
    return {tuple(path.vertices.min(axis=0)) for path in collection.get_paths()}


def test_cells_under_the_least_number_are_hatched_and_the_others_coloured():
    axes = new_figure(2, 2).add_axes((0, 0, 1, 1))
    coloured, hatched = draw_cells(axes, range_map({(3, 2): (5, 4), (6, -2): (4, 4)}))
    assert corners(coloured) == {(2.0, 3.0)}
    assert corners(hatched) == {(-2.0, 6.0)}
    assert hatched.get_hatch() == HATCH
    assert hatched.get_facecolor().size == 0 or hatched.get_facecolor()[0, 3] == 0
    assert coloured.get_array().compressed().tolist() == [0.8]
    assert (coloured.norm.vmin, coloured.norm.vmax) == (0.0, 1.0)


def test_ahead_is_up_and_left_is_left():
    """A cell ahead on the left is drawn in the upper left quarter of its panel."""
    maps = RangeMaps(maps=(range_map({(6, 6): (9, 9)}, object_class="pedestrian"),), unplaced=0)
    figure = draw_range_maps(maps, vehicle_outline_m=OUTLINE_M)
    panel = figure.axes[0]
    assert panel.get_title() == "pedestrian, lateral\n9 object-frames"
    across, up = panel.transAxes.inverted().transform(panel.transData.transform((6.5, 6.5)))  # data are (y, x)
    assert across < 0.5 < up
    figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba())
    u, v = panel.transData.transform((6.5, 6.5)).astype(int)
    assert np.allclose(
        image[image.shape[0] - v, u, :3], 255 * np.array(to_rgba("#fde725")[:3]), atol=1
    )  # top of viridis


def test_three_classes_by_two_directions_and_others_once_they_are_seen():
    figure = draw_range_maps(RangeMaps(maps=(), unplaced=3), vehicle_outline_m=OUTLINE_M)
    kinds = [f"{name}, {way}" for way in ("lateral", "longitudinal") for name in ("pedestrian", "cyclist", "vehicle")]
    assert [axes.get_title() for axes in figure.axes if axes.get_title()] == [f"{k}\n0 object-frames" for k in kinds]
    assert "3 object-frames of unknown direction left out" in [text.get_text() for text in figure.texts]
    seen, unseen = range_map({(3, 2): (5, 4)}, object_class="animal"), range_map({}, object_class="train")
    figure = draw_range_maps(RangeMaps(maps=(seen, unseen), unplaced=0), vehicle_outline_m=OUTLINE_M)
    titles = [axes.get_title().split("\n")[0] for axes in figure.axes]
    assert "animal, lateral" in titles
    assert "train, lateral" not in titles


def test_the_curve_of_thresholds_has_coverage_across_and_recall_up():
    figure = draw_threshold_sweep(np.array([0.2, 0.9]), np.array([0.0, 0.3]), of_run=(0.1, 0.5))
    curve, dot = figure.axes[0].lines
    assert (curve.get_xdata().tolist(), curve.get_ydata().tolist()) == ([0, 30], [20, 90])
    assert (dot.get_xdata().tolist(), dot.get_ydata().tolist()) == ([10], [50])


OBJECTS = [object_row(n) | {"tp": tp, "fn": 20 - tp} for n, tp in enumerate((0, 9, 10, 20))]
ROWS = evaluated(objects_table(OBJECTS))


def test_half_of_the_core_is_half_or_more():
    for level, detected in ((0.0, 3), (HALF, 2)):
        maps = range_maps([ROWS], protocol=load_protocol("surface-v1"), level=level).maps
        (found,) = [m for m in maps if m.object_frames.any()]
        assert (found.object_frames.sum(), found.detected.sum()) == (4, detected)


@pytest.mark.parametrize(("protocol", "title"), [("surface-v1", [HALF_TITLE]), ("paper-v1", [])])
def test_the_map_of_a_protocol_with_unknown_bands_says_that_half_is_due(protocol, title):
    summary = SimpleNamespace(vehicle_outline_m=OUTLINE_M.tolist())
    run = SimpleNamespace(
        evaluated=lambda _, columns: [ROWS[columns]], protocol=load_protocol(protocol), summary=summary
    )
    texts = [text.get_text() for text in draw_run_maps(run).texts]
    assert [text for text in texts if "Detected" in text] == title
