"""Answers, references and counts are files: what is there of the same run is not computed again."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from remembering import Remembering

from bench.atomic import is_temporary, temporary_name
from bench.errors import DataError, UsageError
from bench.evaluation.counts import BINS, EDGES, SCORE_EDGES, find_bins
from bench.evaluation.protocol import load_protocol
from bench.execution import ProcessExecutor
from bench.harness.answers import (
    FAILED,
    answer_row,
    answers_agree,
    name_of,
    no_answer,
    read_answers,
    read_seconds,
    safe_name,
    segmentation_of,
    write_answers,
)
from bench.harness.datasets import StoredFrames
from bench.harness.digests import digest_recording
from bench.harness.exact import build_scorable
from bench.harness.frames import InputOnly
from bench.harness.manifest import AnswersManifest, CodeOfRun, DatasetOfRun, MethodOfRun
from bench.harness.references import evict_cache, find_references, pack_reference, reference_of
from bench.harness.run import RunRequest, cut_tasks, parse_part, plan_recording, process_task, run_benchmark
from bench.harness.stored import read_run
from bench.methods import Segmentation, build_method
from bench.methods.spherical.method import SphericalMethod
from bench.recordings import load_card, open_dataset
from bench.reference.build import ReferenceBuilder
from tests.evaluation.frames import reference_frame
from tests.support.changed_data import (
    change_annotation,
    change_calibration,
    change_egomotion,
    change_image,
    change_sweep,
    remove_image,
)
from tests.support.counts import counts_file
from tests.support.runs import IMAGES, PAPER, bytes_of, score
from tests.support.stored_files import change_manifest

CHANGES = [change_image, change_sweep, change_annotation, change_egomotion, change_calibration, remove_image]
SURFACE = load_protocol("surface-v1")
IMAGE = {"recording": "drive", "camera": "front", "timestamp_ns": 7}


def request(card, out, *protocols, method="nothing", **options) -> RunRequest:
    chosen = build_method(method) if isinstance(method, str) else method
    return RunRequest(card=load_card(card), method=chosen, folder=out, protocols=protocols or (PAPER,), **options)


# ---- answers


@pytest.mark.parametrize(("edges", "is_score"), [(EDGES, False), (SCORE_EDGES, True)])
def test_every_likelihood_comes_back_in_its_bin(tmp_path, edges, is_score):
    values = np.concatenate([edges[:-1], [0.999999 if is_score else 7.0]]).astype(np.float32)
    values = np.nextafter(values, np.float32(1)).reshape(1, -1)
    answer = Segmentation(cell_size_px=1, mask=values > 0, likelihood=values, likelihood_is_score=is_score)
    write_answers(tmp_path / "a.parquet", [answer_row(IMAGE, answer, seconds=0.5)])
    (stored,) = read_answers(tmp_path / "a.parquet")
    bins = find_bins(segmentation_of(stored).likelihood, edges)
    assert np.array_equal(bins, find_bins(values, edges))
    assert bins.max() == BINS - 1


def test_an_answer_comes_back_as_it_was_and_later_changes_do_not_count(tmp_path):
    random = np.random.default_rng(4)
    mask, undefined = random.random((2, 7, 9)) > 0.5
    cause = random.integers(0, 2, (7, 9)).astype(np.uint8)
    said = Segmentation(cell_size_px=5, mask=mask.copy(), undefined=undefined, cause=cause, causes=("a", "b"))
    answers = [answer_row(IMAGE, said, seconds=0.25), no_answer(IMAGE | {"timestamp_ns": 8}, "skipped", "a gap")]
    said.mask[:] = False
    write_answers(tmp_path / "a.parquet", answers)
    first, second = read_answers(tmp_path / "a.parquet")
    found = segmentation_of(first)
    for name, expected in (("mask", mask), ("undefined", undefined), ("cause", cause)):
        assert np.array_equal(getattr(found, name), expected)
    assert (found.cell_size_px, found.causes, found.likelihood, found.threshold) == (5, ("a", "b"), None, None)
    assert (second["status"], second["problem"], second["mask"]) == ("skipped", "a gap", None)
    assert read_answers(tmp_path / "a.parquet", timestamp_ns=8) == [second]


@pytest.mark.parametrize("name", ["drive", "a/b", "..", ".hidden", "Fahrt 1", "käse", "100%"])
def test_names_of_recordings_are_names_of_folders_and_come_back(name):
    assert name_of(safe_name(name)) == name
    assert "/" not in safe_name(name)
    assert not safe_name(name).startswith(".")


def test_answers_agree_where_masks_differ_by_a_thousandth_at_most():
    def answer(marked):
        mask = np.zeros((40, 50), dtype=bool)
        mask.ravel()[:marked] = True
        return answer_row(IMAGE, Segmentation(cell_size_px=1, mask=mask), seconds=marked)

    assert answers_agree(answer(100), answer(102))
    assert not answers_agree(answer(100), answer(103))
    failed = no_answer(IMAGE, FAILED, "no weights")
    assert answers_agree(failed, failed)
    assert not answers_agree(failed, answer(0))


@pytest.mark.parametrize("damage", ["mask", "likelihood", "rows"])
def test_a_damaged_answer_is_named(damage):
    mask = np.zeros((3, 4), dtype=bool)
    said = Segmentation(cell_size_px=1, mask=mask, likelihood=mask.astype(np.float32))
    row = dict(answer_row(IMAGE, said, seconds=0.0))
    row[damage] = {"mask": b"x", "likelihood": bytes([BINS] * 12), "rows": 1 << 30}[damage]
    with pytest.raises(DataError, match="answer of drive, front, 7 ns: expected a mask of rows x columns cells"):
        segmentation_of(row)


# ---- references


@pytest.mark.parametrize("protocol", [PAPER, SURFACE], ids=lambda protocol: protocol.name)
def test_a_stored_reference_is_equal_in_every_value(tiny_card, tmp_path, monkeypatch, protocol):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path))
    recording = open_dataset(load_card(tiny_card))[0].open()
    images, settings = recording.images["front"], protocol.reference

    def found():
        return find_references(recording, images, settings=[settings], digest="of it")[0]

    built = [reference_of(row, "x") for row in found()]
    monkeypatch.setattr(ReferenceBuilder, "build", lambda *_: pytest.fail("it is stored"))
    for before, stored in zip(built, found(), strict=True):
        after = reference_of(stored, "x")
        for name in ("labels", "ignored", "unknown", "left_out", "valid"):
            assert np.array_equal(getattr(before, name), getattr(after, name)), name
        assert (before.ego_speed_mps, before.annotated) == (after.ego_speed_mps, after.annotated)
        for one, other in zip(before.objects, after.objects, strict=True):
            for name in one.__slots__:
                assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert any(one.objects for one in built)


def test_references_that_could_not_be_built_are_not_stored(tiny_card, tmp_path, monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path))
    recording = open_dataset(load_card(tiny_card))[0].open()
    images, settings = recording.images["front"][:1], [PAPER.reference]

    def unreadable(_):
        raise DataError("sweep.npz", expected="a sweep", got="nothing")

    with monkeypatch.context() as damaged:
        damaged.setattr("bench.recordings.SweepRef.read", unreadable)
        ((row,),) = find_references(recording, images, settings=settings, digest="of it")
        assert "sweep.npz" in row
    ((row,),) = find_references(recording, images, settings=settings, digest="of it")
    assert reference_of(row, "x").annotated


def test_every_kind_of_pixel_of_a_reference_is_stored():
    flags = np.random.default_rng(1).random((4, 6, 8)) < 0.5
    kinds = dict(zip(("ignored", "unknown", "left_out", "valid"), flags, strict=True))
    row = pack_reference(replace(reference_frame(np.zeros((6, 8), dtype=np.int32)), **kinds))
    assert all(np.array_equal(getattr(reference_of(row, "drive"), name), kind) for name, kind in kinds.items())


def test_a_damaged_file_of_the_cache_is_built_again(tiny_card, tmp_path, monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path / "cache"))
    score(tiny_card, tmp_path / "one", method="everything")
    files = [*(tmp_path / "cache" / "references").rglob("*.pickle")]
    assert len(files) == 3
    for file in files:
        file.write_bytes(b"no pickle")
    score(tiny_card, tmp_path / "two", method="everything")
    assert bytes_of(tmp_path / "two") == bytes_of(tmp_path / "one")


def test_references_that_were_used_longest_ago_leave_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path))
    monkeypatch.setattr("bench.harness.references.LIMIT_BYTES", 20)
    for number, name in enumerate(("used", "old", "oldest")):
        folder = tmp_path / "references" / name
        folder.mkdir(parents=True)
        (folder / "front.pickle").write_bytes(bytes(10))
        os.utime(folder, (1000 - number, 1000 - number))
    evict_cache()
    assert sorted(folder.name for folder in (tmp_path / "references").iterdir()) == ["old", "used"]
    evict_cache()
    assert len([*(tmp_path / "references").iterdir()]) == 2, "what the limit takes stays"


# ---- what is there is done


def test_a_method_is_asked_once_for_any_number_of_protocols(tiny_card, tmp_path, monkeypatch):
    asked, segment = [], SphericalMethod.segment
    monkeypatch.setattr(SphericalMethod, "segment", lambda self, given: asked.append(given) or segment(self, given))
    for protocol in (PAPER, SURFACE):
        score(tiny_card, tmp_path / protocol.name, protocol=protocol)
    assert len(asked) == 2 * (IMAGES + 1), "the first image once more at the end"
    together = request(tiny_card, tmp_path / "run", PAPER, method="spherical")
    run_benchmark(together)
    assert len(asked) == 3 * (IMAGES + 1)
    both = run_benchmark(replace(together, protocols=[PAPER, SURFACE])).results
    assert len(asked) == 3 * (IMAGES + 1)
    assert [run.summary.provenance.images_asked for run in both] == [0, 0]
    assert [run.label for run in both] == ["run-paper-v1", "run"]
    for protocol in (PAPER, SURFACE):
        alone = bytes_of(tmp_path / protocol.name, protocol.name)
        assert bytes_of(tmp_path / "run", protocol.name) == alone
    assert np.isfinite(read_seconds(tmp_path / "run" / "answers")).sum() == IMAGES


def test_a_second_run_computes_nothing_removes_what_is_half_written_and_gives_the_same_bytes(
    stored, tiny_card, tmp_path
):
    shutil.copytree(stored, tmp_path / "run")
    first = bytes_of(tmp_path / "run")
    for place in ("answers", "paper-v1/counts"):
        (tmp_path / "run" / place / "crossing" / temporary_name("front-00000001", ".parquet")).touch()
    assert score(tiny_card, tmp_path / "run").provenance.images_asked == 0
    assert bytes_of(tmp_path / "run") == first
    assert not [file for file in (tmp_path / "run").rglob(".*") if is_temporary(file.name)]
    counts_file(tmp_path / "run" / "paper-v1", "objects", "standing").write_bytes(b"PAR1")
    counts_file(tmp_path / "run" / "paper-v1", "frames", "standing").unlink()
    assert score(tiny_card, tmp_path / "run").provenance.images_asked == 0
    assert bytes_of(tmp_path / "run") == first, "counts are taken again of the answers"
    for file in (tmp_path / "run" / "answers" / "crossing").iterdir():
        file.unlink()
    assert score(tiny_card, tmp_path / "run").provenance.images_asked == 4
    assert bytes_of(tmp_path / "run") == first


@pytest.fixture(scope="module")
def stored(tiny_card, tmp_path_factory):
    """A run, which is only read."""
    run = tmp_path_factory.mktemp("stored") / "run"
    score(tiny_card, run)
    return run


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_of_any_file_of_a_recording_changes_its_digest(own_card, change):
    handle = next(handle for handle in open_dataset(load_card(own_card)) if handle.name == "overtaking")
    before = digest_recording(handle.open())
    change(own_card.parent / "data" / "tiny" / "overtaking")
    assert digest_recording(handle.open()) != before


@pytest.mark.parametrize("change", [change_image, change_annotation])
def test_changed_data_are_named_and_only_what_depends_on_them_is_computed_again(stored, own_card, tmp_path, change):
    out = shutil.copytree(stored, tmp_path / "run")
    before = bytes_of(out)
    change(own_card.parent / "data" / "tiny" / "overtaking")
    with pytest.raises(DataError, match=r"data recordings changed: 'overtaking' \(1 of 3\).*--overwrite"):
        score(own_card, out)
    assert bytes_of(out) == before, "what is there stays"
    assert score(own_card, out, overwrite=True).provenance.images_asked <= 4
    score(own_card, tmp_path / "fresh")
    assert bytes_of(out) == bytes_of(tmp_path / "fresh") != before


def test_data_that_did_not_open_leave_nothing_in_the_way_of_the_same_run_once_they_do(own_card, tmp_path):
    drives = own_card.parent / "data" / "tiny"
    folders = [file.rename(file.with_suffix(".gone")) for file in drives.glob("*/recording.json")]
    with pytest.raises(DataError, match="expected a recording that can be used"):
        score(own_card, tmp_path / "run")
    for folder in folders:
        folder.rename(folder.with_suffix(".json"))
    assert score(own_card, tmp_path / "run").provenance.images_asked == IMAGES


def test_a_copy_that_was_scored_before_and_is_gone_is_not_read_any_more(own_card, tiny_card, tmp_path):
    score(own_card, tmp_path / "of-copy")
    shutil.rmtree(own_card.parent / "data")
    assert not score(tiny_card, tmp_path / "run").failures


def test_another_run_is_refused_by_name_and_replaced_only_when_asked(tiny_card, tmp_path):
    out = tmp_path / "run"
    score(tiny_card, out, settings={"threshold": 6e-4})
    (out / "notes.txt").write_text("mine")
    (out / "paper-v1" / "notes.txt").write_text("mine")
    (out / "paper-v1" / "index.html").write_text("an old page")
    with pytest.raises(DataError, match=r"got another one: threshold = 0\.001, was 0\.0006.*--overwrite"):
        score(tiny_card, out, settings={"threshold": 1e-3})
    again = score(tiny_card, out, settings={"threshold": 1e-3}, overwrite=True)
    assert again.provenance.images_asked == IMAGES
    assert {file.read_text() for file in out.rglob("notes.txt")} == {"mine"}
    assert not (out / "paper-v1" / "index.html").exists(), "a page of other numbers"


def test_other_rules_under_the_same_name_are_refused(stored, tiny_card, tmp_path):
    shutil.copytree(stored, tmp_path / "run")
    other = PAPER.model_copy(update={"version": 2})
    with pytest.raises(DataError, match="protocol paper-v1 version 2"):
        score(tiny_card, tmp_path / "run", protocol=other)
    assert score(tiny_card, tmp_path / "run", protocol=other, overwrite=True).provenance.images_asked == 0


def test_pictures_of_a_run_find_the_data_that_ship_wherever_they_are_drawn(stored, tiny_card, tmp_path, monkeypatch):
    monkeypatch.setattr("bench.harness.datasets.shipped_folder", lambda: tiny_card.parent)
    monkeypatch.chdir(tmp_path)
    shutil.copytree(stored, tmp_path / "run")
    image = read_run(Path("run")).frames([*IMAGE]).query("recording == 'crossing'").iloc[1].tolist()
    change_manifest(Path("run"), lambda content: content["dataset"].update(card="datasets/tiny.yaml"))
    assert StoredFrames(read_run(Path("run"))).process(*image).segmentation.mask.any()
    change_manifest(Path("run"), lambda content: content["dataset"].update(name="ours", card="datasets/ours.yaml"))
    with pytest.raises(DataError, match=r"datasets/ours\.yaml: expected a readable card"):
        StoredFrames(read_run(Path("run")))


def test_a_folder_that_is_no_run_is_refused_and_stays_as_it_is(tiny_card, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(DataError, match=r"expected an empty folder or that of a run, got one with thesis\.txt"):
            score(tiny_card, tmp_path, overwrite=overwrite)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


CELL = """
from bench.methods import Method, Segmentation

LEVEL = 100

class Bright(Method):
    name = "bright"

    def segment(self, frame):
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > LEVEL)
"""


def test_what_a_cell_of_a_notebook_defines_is_computed_anew(tiny_card, tmp_path, monkeypatch):
    notebook = ModuleType("notebook")
    monkeypatch.setitem(__import__("sys").modules, "notebook", notebook)
    found = []
    for code in (CELL, CELL.replace(">", "<"), "LEVEL = 50"):
        exec(code, vars(notebook))
        assert score(tiny_card, tmp_path / "run", method=notebook.Bright()).provenance.images_asked == IMAGES
        found.append(bytes_of(tmp_path / "run")["sums.csv"])
    assert len(set(found)) == 3
    with pytest.raises(UsageError, match=r"can import, got notebook:Bright, which no file holds"):
        score(tiny_card, tmp_path / "two", method=notebook.Bright(), executor=ProcessExecutor(workers=2))


def test_code_of_a_method_that_changed_is_named(tiny_card, tmp_path, monkeypatch):
    (tmp_path / "own").mkdir()
    source = tmp_path / "own" / "brightness.py"
    monkeypatch.syspath_prepend(tmp_path / "own")
    source.write_text(CELL)
    method = __import__("brightness").Bright()
    score(tiny_card, tmp_path / "run", method=method)
    source.write_text(CELL + "# edited\n")
    with pytest.raises(DataError, match="the method's own code, or files: digest"):
        score(tiny_card, tmp_path / "run", method=method)


# ---- in parts, in processes


def test_a_worker_with_other_code_than_the_run_began_with_is_refused(tiny_card, tmp_path):
    asked = request(tiny_card, tmp_path / "run")
    (task, *_) = plan_recording(asked.method, asked.recordings()[0]).tasks
    code = CodeOfRun.here().model_copy(update={"libraries": {"numpy": "0.1"}, "commit": "c0ffee"})
    dataset = DatasetOfRun(name="tiny", card="tiny", split=None)
    began = AnswersManifest(dataset=dataset, method=MethodOfRun.of(asked.method), code=code)
    with pytest.raises(DataError, match=r"the code that the run began with, got .*numpy \S+, was 0\.1"):
        process_task(asked, began, task)


def test_parts_share_a_folder_and_the_whole_finds_them_done(tiny_card, tmp_path):
    score(tiny_card, tmp_path / "whole", method="everything")
    asked = request(tiny_card, tmp_path / "run", method="everything")
    first, second = (run_benchmark(asked, part=parse_part(text)) for text in ("1/2", "2/2"))
    assert (first.tasks, second.tasks, first.tasks_of_run, first.done) == (2, 1, 3, 2)
    (run,) = run_benchmark(asked).results
    assert run.summary.provenance.images_asked == 0
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(UsageError, match="--shard: expected I/N"):
        parse_part(text)


@pytest.mark.slow
def test_what_a_method_remembers_ends_with_its_task(tiny_card, tmp_path):
    """Whatever the number of processes, in a run that is resumed, and with an object that was used before."""
    method = Remembering()
    score(tiny_card, tmp_path / "one", method=method)
    expected = bytes_of(tmp_path / "one")
    assert method._background is None
    for workers in (2, 3):
        score(tiny_card, tmp_path / str(workers), method=method, executor=ProcessExecutor(workers=workers))
        assert bytes_of(tmp_path / str(workers)) == expected
    for file in sorted((tmp_path / "one" / "answers").rglob("*.parquet")):
        file.unlink()
        assert score(tiny_card, tmp_path / "one", method=method).provenance.images_asked == 4
        assert bytes_of(tmp_path / "one") == expected


def test_a_method_that_cannot_be_copied_is_refused_before_anything_is_written(tiny_card, tmp_path):
    method = Remembering()
    method.open_file = (tmp_path / "log").open("w")
    with method.open_file, pytest.raises(UsageError, match=r"object of Remembering that can be copied.*TypeError"):
        score(tiny_card, tmp_path / "run", method=method)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("unscored", "history", "tasks"),
    [
        *[(0, 0, [(0, 2), (2, 4), (4, 5)]), (0, 1, [(1, 3), (3, 5)]), (1, 1, [(1, 3), (3, 5)])],
        *[(2, 1, [(2, 4), (4, 5)]), (2, 3, [(3, 5)]), (4, 1, [(4, 5)]), (5, 1, [])],
    ],
)
def test_every_image_to_be_scored_is_in_one_task(tiny_card, monkeypatch, unscored, history, tasks):
    monkeypatch.setattr("bench.harness.run.TASK_IMAGES", 2)
    handle = open_dataset(load_card(tiny_card))[0]
    recording = handle.open()
    images = [replace(image, scored=k >= unscored) for k, image in enumerate(recording.images["front"])]
    cut = cut_tasks(handle, replace(recording, images={"front": images}), "", InputOnly(history=history))
    assert [(task.start, task.stop) for task in cut] == tasks


# ---- oracles


def test_answers_of_oracles_depend_on_the_protocol_and_lie_beside_its_counts(tiny_card, tmp_path):
    asked = request(tiny_card, tmp_path / "run", PAPER, SURFACE, method=build_scorable("reference"))
    for run in run_benchmark(asked).results:
        assert run.answers == run.folder / "answers"
        assert run.summary.all_moving.iou.value == 1.0
        assert run.summary.false_positives.coverage.value == 0.0
    assert not (tmp_path / "run" / "answers").exists()
    assert read_run(tmp_path / "run").protocol.name == "surface-v1", "a run's folder stands for the usual protocol"
