"""`bench.open_dataset`, `run` and `load_run`: what the commands do, from Python."""

from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import bench
from bench.commands.options import as_executor
from bench.errors import UnknownNameError, UsageError
from bench.methods import Method, Segmentation, build_method


@pytest.fixture(scope="module")
def run(tiny_card, tmp_path_factory):
    both, out = "paper-v1,surface-v1", tmp_path_factory.mktemp("api") / "run"
    return bench.run(tiny_card, "frame-difference", protocol=both, pictures=False, out=out)


def test_a_run_is_stored_and_read_back_as_tables(run):
    again = bench.load_run(run.folder)
    assert again.summary == run.summary
    assert again.metrics.loc["crossing", "object_frames"] == 4
    assert again.metrics.loc["all_moving", "iou"] == run.summary.all_moving.iou.value
    assert np.isnan(again.metrics.loc["preceding", "iou"])
    assert len(again.objects) == 16
    assert again.frames["fp_px"].sum() > 0
    assert again.false_positives == run.summary.false_positives.coverage.value
    assert (run.folder / "table.md") in run.files
    assert again.manifest.method.settings["threshold_grey"] == 4 * 15**0.5
    flat = again.metrics.stack().dropna()
    assert flat["all_moving", "iou"] == again.metrics.loc["all_moving", "iou"], "as docs/results.md shows"
    (other,) = run.others
    assert bench.load_run(run.folder.parent).folder == other.folder, "a run's folder stands for surface-v1"
    assert (run.manifest.protocol.name, other.manifest.protocol.name) == ("paper-v1", "surface-v1")
    assert other.summary.all_moving.iou.value != run.summary.all_moving.iou.value


def test_scores_of_single_frames_add_up_to_the_run(run, tiny_card):
    method = build_method("frame-difference")
    frames = bench.open_dataset(tiny_card).frames(protocol="paper-v1", history=method.history)
    scores = [bench.score(frame.reference, method.segment(frame.input).mask) for frame in frames]
    total = bench.Score.of(scores)
    assert len(total.images) == 12
    for name in ("detection_rate", "detection_rate_10", "tpr", "tpr_all", "iou", "iou_detected"):
        assert total.metrics[name] == pytest.approx(run.metrics.loc["all_moving", name], rel=1e-12)
    assert total.false_positives == pytest.approx(run.false_positives, rel=1e-12)
    assert total.metrics["recall"] == run.summary.segmentation.recall.value
    assert sorted(total.objects["iou"]) == sorted(
        (rows := run.objects.query("status == 'evaluated'"))["tp"] / (rows["tp"] + rows["fp"] + rows["fn"])
    )


class Bright(Method):
    """A method that no module's name leads to."""

    name = "bright"

    def segment(self, frame):
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > 200)


def test_an_object_is_a_method_too(tiny_card, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = bench.run(tiny_card, Bright(), split="moving", protocol="extended-v1", pictures=False)
    assert found.folder == Path("reports/runs/tiny-bright-moving/extended-v1")
    assert found.summary.images.evaluated == 8
    with pytest.raises(UsageError, match="settings: expected none"):
        bench.run(tiny_card, Bright(), settings={"threshold": 1})


class Engine(Executor):
    """An executor of another engine: it computes where it is, and loses the task that it is told to lose."""

    def __init__(self, losing=None):
        self.submitted, self.losing = 0, losing

    def submit(self, function, /, *arguments, **named):
        future, self.submitted = Future(), self.submitted + 1
        if self.submitted == self.losing:
            future.set_exception(BrokenExecutor("the machine is gone"))
        else:
            future.set_result(function(*arguments, **named))
        return future


def test_the_executor_of_another_engine_gives_the_same(run, tiny_card, tmp_path):
    engine = Engine()
    chosen = {"method": "frame-difference", "pictures": False, "protocol": "paper-v1"}
    other = bench.run(tiny_card, **chosen, out=tmp_path / "run", workers=engine)
    assert engine.submitted == 3 + 3 + 1, "recordings, tasks, and one image again"
    assert (other.folder / "sums.csv").read_bytes() == (run.folder / "sums.csv").read_bytes()
    with ThreadPoolExecutor(2) as pool:
        assert (other.summary.provenance.workers, as_executor(pool).workers) == (0, 2), "where the executor tells"
    (failure,) = bench.run(tiny_card, **chosen, out=tmp_path / "lost", workers=Engine(losing=5)).summary.failures
    assert failure.endswith("the machine is gone")


def test_a_data_set_gives_recordings_and_frames(tiny_card, monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_DATASETS", str(tiny_card.parent))
    monkeypatch.chdir(tiny_card.parent.parent)
    data = bench.open_dataset("tiny", "moving")
    assert data.names == ("crossing", "overtaking")
    assert [recording.name for recording in data] == list(data.names)
    assert data["crossing"].images["front"]
    frames = list(data.frames(recordings=["crossing"], camera="front", history=2, colour=True))
    assert len(frames) == len(data["crossing"].images["front"]) - 2
    assert frames[0].image.shape == (240, 320, 3)
    assert len(frames[0].input.images) == 3
    assert (frames[0].reference.labels > 0).any()
    with pytest.raises(UnknownNameError, match="unknown recording 'crosing'"):
        _ = data["crosing"]
    with pytest.raises(UnknownNameError, match="unknown camera 'rear'"):
        next(data.frames(camera="rear"))
