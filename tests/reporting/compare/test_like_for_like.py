"""Runs of methods that need other histories, made and compared for real."""

import csv
import shutil

import pyarrow as pa
import pytest

from bench.errors import UsageError
from bench.evaluation import load_protocol, summarise
from bench.harness import read_run, read_tables
from bench.methods import Method, Segmentation
from bench.recordings import load_card
from bench.reporting.compare import compare_runs, read_comparable, write_comparison
from bench.reporting.leaderboard import read_leaderboard
from tests.support.counts import change_table
from tests.support.runs import run_one
from tests.support.stored_files import change_manifest

PROTOCOL = load_protocol("paper-v1")
SCORED = {"one": 12, "two": 9}  # of three drives of five images


class Brighter(Method):
    """Marks what became brighter since the image `history` images ago."""

    def __init__(self, name, history):
        self.name, self.history = name, history

    def settings(self):
        return {"history": self.history}

    def segment(self, frame):
        now, before = (frame.images[place].astype(int) for place in (-1, -1 - self.history))
        return Segmentation(cell_size_px=1, mask=now > before + 8)


def run(card, method, out):
    run_one(card=load_card(str(card)), method=method, protocol=PROTOCOL, out=out)
    return out


@pytest.fixture(scope="module")
def runs(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return {name: run(tiny_card, Brighter(name, n), folder / name) for n, name in enumerate(SCORED, start=1)}


def rows_on_both(runs, name, table):
    """The rows of a run on the images that both scored, found in the plainest way."""
    frames = [read_tables(one)[1].to_pylist() for one in runs.values()]
    images = [{_image(row) for row in rows if row["status"] == "evaluated"} for rows in frames]
    common = images[0] & images[1]
    assert len(common) == 9 < len(images[0])
    rows = dict(zip(("objects", "frames"), read_tables(runs[name]), strict=True))[table]
    return rows.filter(pa.array([_image(row) in common for row in rows.to_pylist()]))


def _image(row):
    return row["recording"], row["camera"], row["timestamp_ns"]


@pytest.mark.parametrize("order", [("one", "two"), ("two", "one")])
def test_figures_are_those_of_the_images_that_both_scored(runs, order):
    assert len({read_run(folder).manifest.reference for folder in runs.values()}) == 2
    (found,) = compare_runs(read_comparable([runs[name] for name in order]))
    assert found.images == (SCORED[order[0]], SCORED[order[1]], 9)
    expected = [summarise(*(rows_on_both(runs, n, t) for t in ("objects", "frames")), protocol=PROTOCOL) for n in order]
    changes = found.changes.droplevel("breakdown")
    for name in changes.index.unique("slice"):
        if name == "frames":
            figures = [of.false_positives.coverage for of in expected]
            change = changes.loc[(name, "false_positive_coverage")]
            assert change.frames_before == 9
        else:
            of_row = [e.all_moving if name == "all_moving" else e.categories[name] for e in expected]
            change = changes.loc[(name, "tpr_all")]
            assert change.frames_before == of_row[0].object_frames == of_row[1].object_frames
            figures = [of.tpr_all for of in of_row]
        assert (change.before, change.after) == pytest.approx([f.value for f in figures], rel=1e-12, nan_ok=True)
    whole = read_run(runs["one"]).summary.all_moving
    assert found.detections.loc["all_moving"].object_frames < whole.object_frames, "the first images are left out"
    assert (found.frames["timestamp_ns"] > 100_000_000).all()


def test_every_form_says_how_many_images_each_run_had(runs, tmp_path):
    line = "Compared on the 9 images that both scored: one scored 12, two 9."
    write_comparison(list(runs.values()), tmp_path, pictures=False)
    assert line in (tmp_path / "compare.md").read_text()
    with (tmp_path / "compare.csv").open() as stream:
        counts = {(r["images_before"], r["images_after"], r["images_compared"]) for r in csv.DictReader(stream)}
    assert counts == {("12", "9", "9")}


@pytest.mark.slow
def test_the_leaderboard_ranks_both_on_their_common_images(runs, tiny_card, tmp_path):
    for name, folder in runs.items():
        shutil.copytree(folder, tmp_path / name)
    run(tiny_card, Brighter("again", 1), tmp_path / "again")
    (group,) = read_leaderboard(tmp_path).groups
    assert {entry.run: entry.images for entry in group.entries} == SCORED | {"again": 12}
    assert group.images == 9
    values = {entry.run: entry.metrics["tpr_all"].value for entry in group.entries}
    for name in SCORED:
        rows = [rows_on_both(runs, name, t) for t in ("objects", "frames")]
        expected = summarise(*rows, protocol=PROTOCOL)
        assert values[name] == pytest.approx(expected.all_moving.tpr_all.value)
        assert group.cases["all_moving"][0] == expected.all_moving.object_frames
    assert values["again"] == values["one"]


def test_a_run_of_few_images_has_a_table_of_its_own(runs, tiny_card, tmp_path):
    shutil.copytree(runs["one"], tmp_path / "one")
    run(tiny_card, Brighter("long", 4), tmp_path / "long")  # one image of each drive
    found = [sorted(entry.run for entry in group.entries) for group in read_leaderboard(tmp_path).groups]
    assert sorted(found) == [["long"], ["one"]]
    (compared,) = compare_runs(read_comparable([tmp_path / "one", tmp_path / "long"]))
    assert compared.images == (12, 3, 3)


def test_another_annotation_is_refused_with_what_differs(runs, tiny_card, tmp_path):
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    file = next(folder.glob("data/tiny/crossing/annotations*"))
    text = file.read_text()
    assert '"walker"' in text
    file.write_text(text.replace('"walker"', '"stranger"'))
    other = run(folder / tiny_card.name, Brighter("two", 2), tmp_path / "other")
    with pytest.raises(UsageError) as refused:
        compare_runs(read_comparable([runs["one"], other]))
    told = str(refused.value)
    places = f"{runs['one']}/paper-v1 and {other}/paper-v1"
    assert told.startswith(f"{places} do not compare: their references differ on the 9 images")
    assert "\n" not in told
    groups = read_leaderboard(tmp_path).groups
    assert [[entry.run for entry in group.entries] for group in groups] == [["other"]]


def test_no_common_image_is_said(runs, tiny_card, tmp_path):
    standing = tmp_path / "standing"
    run_one(card=load_card(str(tiny_card)), method=Brighter("one", 1), protocol=PROTOCOL, out=standing)

    def moved(frames: pa.Table) -> pa.Table:
        times_ns = pa.array((frames["timestamp_ns"].to_numpy() + 1).tolist(), pa.int64())
        return frames.set_column(frames.schema.get_field_index("timestamp_ns"), "timestamp_ns", times_ns)

    change_table(standing / "paper-v1", "frames", moved)
    change_manifest(standing, lambda content: content.update(reference="x"))
    with pytest.raises(UsageError, match="no image was scored by both; the first has 12, the second 12"):
        compare_runs(read_comparable([runs["one"], standing]))
