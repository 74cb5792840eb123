"""A sweep on rendered drives gives what single runs give, without computing flow again."""

import shutil
from pathlib import Path

import cv2
import pytest

from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.execution import ProcessExecutor
from bench.flow import FarnebackFlow
from bench.harness import RunRequest, run_benchmark
from bench.harness.cache import CacheFolder
from bench.harness.sweep import Setup, plan_sweep, read_sweep, run_sweep
from bench.methods import build_method
from bench.recordings import InputErrors, load_card

PROTOCOL = load_protocol("paper-v1")
PAIRS = 12  # three drives of five images


@pytest.fixture
def flow_calls(monkeypatch) -> list[int]:
    """One entry per call of the flow itself."""
    calls: list[int] = []
    compute = FarnebackFlow.__call__

    def counted(self, start, end):
        calls.append(1)
        return compute(self, start, end)

    monkeypatch.setattr(FarnebackFlow, "__call__", counted)
    return calls


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> CacheFolder:
    """Shared by the tests that do not count flow calls."""
    return CacheFolder(folder=tmp_path_factory.mktemp("cache"))


def sweep(card: Path, what, out: Path, *, values=(), cache=None, method="spherical", protocol=PROTOCOL, **options):
    base = Setup(method=build_method(method), protocol=protocol)
    plan = plan_sweep(what, base=base, values=values)
    return run_sweep(
        load_card(str(card)), plan=plan, out=out, cache=cache or CacheFolder(folder=out / "cache"), **options
    )


def figures(row) -> tuple:
    return row.categories, row.all_moving, row.false_positives


def by_value(result) -> dict:
    return {row.value: row for row in result.rows}


@pytest.mark.parametrize(
    ("what", "value", "settings"),
    [
        ("threshold", "0.002", {"threshold": 0.002}),
        ("ablation", "without epipolar", {"weights": {"epipolar": 0.0}}),
        ("cell_size_px", "8", {"cell_size_px": 8}),
    ],
)
def test_each_value_is_what_a_run_with_it_gives(tiny_card, tmp_path, cache, what, value, settings):
    found = sweep(tiny_card, what, tmp_path / "sweep", values=[value], cache=cache)
    run = run_benchmark(
        RunRequest(
            card=load_card(str(tiny_card)),
            method=build_method("spherical", settings),
            protocol=PROTOCOL,
            out=tmp_path / "run",
        )
    )
    row = next(row for row in found.rows if not row.operating)
    assert row.model_dump_json(include={"categories", "all_moving", "false_positives"}) == run.model_dump_json(
        include={"categories", "all_moving", "false_positives"}
    )
    assert read_sweep(tmp_path / "sweep").model_dump_json() == found.model_dump_json()


def test_a_sweep_over_the_reference_is_what_runs_by_those_rules_give(tiny_card, tmp_path, cache):
    found = by_value(sweep(tiny_card, "min_points", tmp_path / "sweep", values=["1000"], cache=cache))
    assert found[1000].protocol_digest != found[PROTOCOL.reference.min_points].protocol_digest
    assert found[1000].all_moving.object_frames < found[PROTOCOL.reference.min_points].all_moving.object_frames
    content = PROTOCOL.model_dump(exclude_unset=True)
    content["reference"]["min_points"] = 1000
    rules = type(PROTOCOL).model_validate(content)
    run = run_benchmark(
        RunRequest(
            card=load_card(str(tiny_card)), method=build_method("spherical"), protocol=rules, out=tmp_path / "run"
        )
    )
    assert found[1000].all_moving.model_dump_json() == run.all_moving.model_dump_json()


def test_flow_is_computed_once_for_all_values_and_sweeps(tiny_card, tmp_path, flow_calls):
    kept = tmp_path / "cache"
    first = sweep(tiny_card, "threshold", tmp_path / "a", cache=CacheFolder(folder=kept))
    assert (len(first.rows), len(flow_calls)) == (10, PAIRS)
    assert (first.flow.computed, first.flow.read) == (PAIRS, 0)
    later = {
        "weights.positive_depth": "0",
        "ablation": "only epipolar",
        "error.yaw_rate": "1",
        "error.principal_point_u": "2",
        "min_points": "5",
    }
    for what, value in later.items():
        again = sweep(tiny_card, what, tmp_path / what, values=[value], cache=CacheFolder(folder=kept))
        assert again.flow.computed == 0
        assert again.flow.read == (0 if what == "min_points" else PAIRS), "a likelihood that is found needs no flow"
    assert len(flow_calls) == PAIRS
    base = [next(row for row in one.rows if row.operating) for one in (first, again)]
    assert base[0].all_moving.model_dump_json() == base[1].all_moving.model_dump_json()


def test_the_cache_of_a_sweep_is_one_that_runs_take(tiny_card, tmp_path):
    kept = CacheFolder(folder=tmp_path / "cache", limit_bytes=0)
    sweep(tiny_card, "threshold", tmp_path / "a", values=["0.002"], cache=kept)
    kept.prepare()
    assert kept.use().files == 0, "its limit holds at the end"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(DataError, match="expected an empty folder or a cache"):
        sweep(tiny_card, "threshold", tmp_path / "b", values=["0.002"], cache=CacheFolder(folder=tmp_path / "other"))


def test_noise_and_flow_settings_need_their_own_flow(tiny_card, tmp_path, flow_calls):
    found = sweep(tiny_card, "error.image_noise", tmp_path / "a", values=["0", "16"], split="moving")
    assert found.flow.computed == len(flow_calls) == 2 * 8
    clean, noisy = found.rows
    assert noisy.injected == {"image_noise_grey": 16.0}
    assert noisy.all_moving.model_dump_json() != clean.all_moving.model_dump_json()
    found = sweep(tiny_card, "flow.levels", tmp_path / "b", values=["1"], split="moving")
    assert found.flow.computed == 2 * 8


def test_changed_images_and_damaged_files_are_not_taken_from_the_cache(tiny_card, tmp_path, flow_calls):
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    card, kept = folder / tiny_card.name, tmp_path / "cache"
    sweep(card, "threshold", tmp_path / "a", values=["1e-3"], cache=CacheFolder(folder=kept))
    damaged, *others = sorted(kept.glob("flow/*/*.npz"))
    assert len(others) == PAIRS - 1
    damaged.write_bytes(damaged.read_bytes()[:1000])
    again = sweep(card, "weights.epipolar", tmp_path / "b", values=["0.5"], cache=CacheFolder(folder=kept))
    assert again.flow.computed == 1
    image = sorted((folder / "data" / "tiny" / "crossing" / "images" / "front").glob("*.png"))[2]
    pixels = cv2.imread(str(image))
    cv2.imwrite(str(image), 255 - pixels)
    again = sweep(card, "threshold", tmp_path / "c", values=["1e-3"], cache=CacheFolder(folder=kept))
    assert again.flow.computed == 2, "the pairs that the image is part of"


def test_an_interrupted_sweep_goes_on_where_it_stopped(tiny_card, tmp_path, flow_calls):
    """Of four values with a flow of their own two are there, and two of three units of the third."""
    values = ["1", "2", "4"]
    whole = sweep(tiny_card, "flow.levels", tmp_path / "whole", values=values)
    assert len(flow_calls) == 4 * PAIRS
    shutil.copytree(tmp_path / "whole", tmp_path / "part")
    for value in ("3", "4"):
        for file in (tmp_path / "part" / value).glob("*.*"):
            file.unlink()
    shutil.rmtree(tmp_path / "part" / "4")
    unit, *_ = sorted((tmp_path / "part" / "3" / "units").glob("*.unit"))
    unit.unlink()
    (tmp_path / "part" / "sweep.json").unlink()
    flow_calls.clear()
    again = sweep(
        tiny_card, "flow.levels", tmp_path / "part", values=values, cache=CacheFolder(folder=tmp_path / "new")
    )
    assert len(flow_calls) == 4 + PAIRS
    assert again.provenance.work.units_reused == 3 + 3 + 2
    for row, same in zip(whole.rows, again.rows, strict=True):
        assert row.model_dump_json() == same.model_dump_json()
    flow_calls.clear()
    sweep(tiny_card, "flow.levels", tmp_path / "part", values=values, cache=CacheFolder(folder=tmp_path / "new"))
    assert not flow_calls


def test_a_sweep_in_processes_gives_the_same(tiny_card, tmp_path):
    one = sweep(tiny_card, "error.image_noise", tmp_path / "one", values=["8"])
    two = sweep(tiny_card, "error.image_noise", tmp_path / "two", values=["8"], executor=ProcessExecutor(workers=2))
    assert two.rows == one.rows
    assert (two.flow, two.provenance.work.workers) == (one.flow, 2)


def test_without_a_cache_values_share_one_that_does_not_stay(tiny_card, tmp_path, flow_calls):
    plan = plan_sweep("threshold", base=Setup(method=build_method("spherical"), protocol=PROTOCOL), values=["1e-3"])
    run_sweep(load_card(str(tiny_card)), plan=plan, out=tmp_path, cache=None)
    assert len(flow_calls) == PAIRS
    names = {"0.0006", "0.001", "sweep.json", "fisheye-bench.sweep"}
    assert {entry.name for entry in tmp_path.iterdir()} == names


def test_a_run_with_errors_is_none_without(tiny_card, tmp_path):
    """Units, cached steps and data are told apart, and a reader is told of the errors."""
    card, kept = load_card(str(tiny_card)), CacheFolder(folder=tmp_path / "cache")

    def score(out, **errors):
        return run_benchmark(
            RunRequest(
                card=card,
                method=build_method("spherical"),
                protocol=PROTOCOL,
                out=tmp_path / out,
                cache=kept,
                input_errors=InputErrors(**errors),
            )
        )

    plain = score("run")
    wrong = [score("run", yaw_rate_bias_degps=3.0), score("run", yaw_rate_bias_degps=2.0)]
    assert [run.provenance.work.units_reused for run in wrong] == [0, 0]
    assert [run.provenance.work.steps_found for run in wrong] == [{"flow": PAIRS, "reference": PAIRS}] * 2
    assert len({run.manifest.dataset.data for run in (plain, *wrong)}) == 3
    assert len({run.all_moving.model_dump_json() for run in (plain, *wrong)}) == 3
    assert wrong[1].caveats.endswith("The method was told errors of its input: yaw_rate_bias_degps 2.")
    assert plain.caveats == card.content.caveats
    assert score("noise", image_noise_grey=1.0).provenance.work.steps_found == {"reference": PAIRS}
    assert score("run").model_dump_json(exclude={"provenance"}) == plain.model_dump_json(exclude={"provenance"})


def test_errors_reach_the_method_and_not_the_reference(tiny_card, tmp_path, cache):
    found = by_value(sweep(tiny_card, "error.pitch_rate", tmp_path / "sweep", values=["4"], cache=cache))
    true, wrong = found[0.0], found[4.0]
    assert wrong.false_positives.coverage.value > true.false_positives.coverage.value + 0.1
    assert {name: row.object_frames for name, row in true.categories.items()} == {
        name: row.object_frames for name, row in wrong.categories.items()
    }
    assert wrong.protocol_digest == true.protocol_digest
    assert wrong.settings == true.settings


def test_another_method_can_be_told_errors(tiny_card, tmp_path):
    found = sweep(tiny_card, "error.speed", tmp_path / "sweep", values=["10"], method="everything", split="moving")
    assert [row.all_moving.tpr_all.value for row in found.rows] == [1.0, 1.0]
    assert (found.flow.computed, found.flow.read) == (0, 0)


def test_an_image_that_one_value_cannot_use_is_left_out_for_all(tiny_card, tmp_path, cache):
    values = ["0", "550"]  # beyond the end of the ego-motion for some images
    found = sweep(tiny_card, "error.time", tmp_path / "sweep", values=values, cache=cache)
    frames = {row.false_positives.frames for row in found.rows}
    assert len(frames) == 1
    assert 0 < frames.pop() < PAIRS
    assert any("ego-motion at" in failure for failure in found.failures)


def test_nothing_that_can_be_used_is_an_error(tiny_card, tmp_path):
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    (folder / tiny_card.name).write_text((folder / tiny_card.name).read_text().replace("scenario:", "source:"))
    for file in (folder / "data" / "tiny").glob("*/egomotion.csv"):
        file.unlink()
    with pytest.raises(DataError, match="a recording that can be used"):
        sweep(folder / tiny_card.name, "threshold", tmp_path / "sweep")
    with pytest.raises(DataError, match="the result of a sweep"):
        read_sweep(tmp_path / "sweep")
