"""`evaluate`: masks and scores from disk, through the public command."""

import json
import re
import shutil
from typing import NamedTuple

import cv2
import numpy as np
import pytest

import bench
from bench.harness.stored import read_run
from bench.methods import Segmentation, build_method
from bench.recordings import load_card, open_dataset
from bench.records.reference import ReferenceFrame
from bench.reporting.run_tables import odd_masks
from tests.support.changed_data import without_scenario
from tests.support.commands import call
from tests.support.counts import read_tables

METHOD_COLUMNS = {"undefined_px", "fp_by_cause"}  # what only a method that runs can tell


class Image(NamedTuple):
    """An image that has one before it, and what the paper's method answers."""

    place: str
    timestamp_ns: int
    reference: ReferenceFrame
    answer: Segmentation

    @property
    def moving(self):
        return (self.reference.labels > 0).astype(np.uint8) * 255


@pytest.fixture(scope="session")
def images(tiny_card):
    method = build_method("spherical")
    return [
        Image(f"{frame.recording}/front", frame.timestamp_ns, frame.reference, method.segment(frame.input))
        for frame in bench.open_dataset(tiny_card).frames(protocol="paper-v1")
    ]


def write_map(folder, place, name, values):
    file = folder / place / f"{name}.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    if values.dtype == np.uint16:
        (folder / "predictions.yaml").write_text("sixteen_bits: score\n")
    assert cv2.imwrite(str(file), values)


def write_maps(folder, images, values_of):
    """A file for every image, named by its time."""
    shutil.rmtree(folder, ignore_errors=True)
    for image in images:
        write_map(folder, image.place, image.timestamp_ns, values_of(image))
    return folder


@pytest.fixture
def masks(images, tmp_path):
    """The reference as masks."""
    return write_maps(tmp_path / "masks", images, lambda image: image.moving)


@pytest.fixture
def evaluate(monkeypatch, tiny_card, tmp_path):
    """Evaluates a folder and expects an exit status; returns the run's folder. Tables are drawn where asked for."""

    def run(folder, *words, out="run", status=0, card=tiny_card, tables=False):
        if not tables:
            monkeypatch.setattr("bench.reporting.run_tables.write_report_files", lambda _: ())
            monkeypatch.setattr("bench.commands.evaluate.print_runs", lambda run: 2 if run.summary.failures else 0)
        named = ("--predictions", folder, "--out", tmp_path / out, "--no-pictures", "--overwrite")
        assert call(monkeypatch, "evaluate", card, *named, "--protocol", "paper-v1", *words) == status
        return tmp_path / out

    return run


def counts_of(run) -> list[str]:
    tables = read_tables(run, histograms=False)
    rows = [row for table in tables for row in table.to_pylist()]
    return [repr({k: v for k, v in row.items() if k not in METHOD_COLUMNS}) for row in rows]


def test_the_reference_scores_perfectly(evaluate, masks, capsys):
    run = evaluate(masks, "--name", "a network/v2")
    summary = read_run(run).summary
    moving = summary.all_moving
    assert moving.object_frames == 12
    for name in ("detection_rate", "detection_rate_50", "tpr", "tpr_all", "iou", "iou_detected"):
        assert moving.metric(name).value == 1.0
    assert summary.false_positives.coverage.value == summary.false_positives.frame_rate.value == 0.0
    assert summary.threshold_free is None
    method = read_run(run).manifest.method
    assert (method.name, method.settings["folder"]) == ("a network/v2", str(masks))
    assert "12 of 12 images have a usable mask" in capsys.readouterr().out


def test_empty_and_full_masks(evaluate, images, tmp_path):
    empty = read_run(evaluate(write_maps(tmp_path / "empty", images, lambda image: image.moving * 0))).summary
    assert (empty.all_moving.detection_rate.value, empty.false_positives.coverage.value) == (0.0, 0.0)
    assert (empty.all_moving.iou.value, empty.all_moving.tpr.cases) == (0.0, 0)
    full = read_run(evaluate(write_maps(tmp_path / "full", images, lambda image: image.moving | 255))).summary
    assert (full.all_moving.detection_rate.value, full.all_moving.tpr_all.value) == (1.0, 1.0)
    outside = [
        np.mean(image.reference.valid & (image.reference.labels == 0) & ~image.reference.ignored) for image in images
    ]
    assert full.false_positives.coverage.value == pytest.approx(np.mean(outside))


def test_a_methods_masks_count_as_the_method_does(evaluate, images, tiny_card, monkeypatch, tmp_path):
    words = ("run", tiny_card, "--out", tmp_path / "method", "--no-pictures", "--protocol", "paper-v1")
    assert call(monkeypatch, *words) == 0
    cells = evaluate(write_maps(tmp_path / "cells", images, lambda image: image.answer.mask.astype(np.uint8)), out="a")
    assert counts_of(cells) == counts_of(tmp_path / "method")
    assert read_run(cells).manifest.reference == read_run(tmp_path / "method").manifest.reference
    for side in (5, 15):  # px of a cell: at the image's size, and three times as large
        block = np.full((side, side), 255, "u1")
        maps = write_maps(tmp_path / "maps", images, lambda image, block=block: np.kron(image.answer.mask, block))
        assert counts_of(evaluate(maps, out="b")) == counts_of(cells)
    assert call(monkeypatch, "compare", tmp_path / "method", cells, "--out", tmp_path / "c", "--no-pictures") == 0


def spoil(folder, images) -> None:
    """One of each fault, in the first recording; and files that are of no image."""
    missing, cut, size, grey, colour, twice, *_ = images
    files = [folder / i.place / f"{i.timestamp_ns}.png" for i in (missing, cut, size, grey, colour, twice)]
    files[0].unlink()
    files[1].write_bytes(files[1].read_bytes()[:-20])
    cv2.imwrite(str(files[2]), np.zeros((100, 100), np.uint8))
    cv2.imwrite(str(files[3]), np.full((240, 320), 9, np.uint8))
    cv2.imwrite(str(files[4]), np.zeros((240, 320, 3), np.uint8))
    shutil.copy(files[5], files[5].with_suffix(".PNG"))
    write_map(folder, missing.place, 77, missing.moving)
    write_map(folder, "crosing/front", missing.timestamp_ns, missing.moving)
    (folder / "notes.txt").write_text("by hand")
    (folder / ".cache").mkdir()  # what is hidden is passed over
    (folder / ".cache" / "1.png").write_bytes(b"")


def test_everything_wrong_is_listed_at_once_and_nothing_scored_but_on_request(evaluate, images, masks, capsys):
    good = evaluate(masks)
    before = {file.name: file.read_bytes() for file in good.iterdir() if file.is_file()}
    spoil(masks, images)
    evaluate(masks, status=2)
    shown = capsys.readouterr()
    assert "got 1 missing, 4 unusable, 1 twice, 3 extra; fix them, all are listed with -v; or" in shown.err
    assert "6 of 12 images have a usable mask" in shown.out
    assert "expected 320 x 240 px, or a whole fraction or multiple of it, got 100 x 100" in " ".join(shown.out.split())
    assert {file.name: file.read_bytes() for file in good.iterdir() if file.is_file()} == before
    run = evaluate(masks, "--missing", "skip", status=2)
    summary = read_run(run).summary
    assert (summary.images.evaluated, summary.images.skipped, summary.images.failed) == (6, 1, 5)
    assert summary.all_moving.iou.value == 1.0
    assert sum(f"{images[1].place}/{images[1].timestamp_ns}.png" in failure for failure in summary.failures) == 1
    report = json.loads((run / "paper-v1" / "predictions.json").read_text())
    faults = {kind: [fault["place"] for fault in faults] for kind, faults in report["faults"].items()}
    keys = [f"{image.place}/{image.timestamp_ns}" for image in images]
    assert faults == {
        "missing": [keys[0]],
        "unusable": sorted(f"{key}.png" for key in keys[1:5]),
        "twice": [keys[5]],
        "extra": ["crosing/front/" + keys[0].split("/")[-1] + ".png", f"{images[0].place}/77.png", "notes.txt"],
    }


def test_empty_counts_missing_images_as_nothing(evaluate, images, masks):
    for image in images[:3]:
        (masks / image.place / f"{image.timestamp_ns}.png").unlink()
    summary = read_run(evaluate(masks, "--missing", "empty")).summary
    assert (summary.images.evaluated, summary.images.failed) == (12, 0)
    assert (summary.all_moving.detection_rate.value, summary.all_moving.tpr.value) == (9 / 12, 1.0)
    run = read_run(evaluate(masks, "--missing", "skip"))
    skipped = run.summary
    assert (skipped.images.evaluated, skipped.images.skipped, skipped.failures) == (9, 3, ())
    assert run.manifest.method.settings["missing"] == "skip"


def test_scores_on_another_scale_are_told_with_the_largest_and_the_threshold(evaluate, images, tmp_path, capsys):
    folder = write_maps(tmp_path / "p", images, lambda image: np.where(image.moving, 10_000, 0).astype(np.uint16))
    evaluate(folder, "--threshold", 0.51)
    told = " ".join(capsys.readouterr().out.split())
    assert "the largest score is 0.1526, and above 0.51 a pixel moves, so that none does" in told
    run = tmp_path / "run" / "paper-v1"
    assert odd_masks(read_run(run)).startswith("none of 12 masks marks anything")
    report = json.loads((run / "predictions.json").read_text())
    assert (report["largest"], report["threshold"]) == (pytest.approx(10_000 / 65535), 0.51)


def test_inverted_masks_are_told_before_the_table(evaluate, images, tmp_path, capsys):
    evaluate(write_maps(tmp_path / "inverted", images, lambda image: 255 - image.moving), tables=True)
    told = capsys.readouterr().out
    assert told.index("masks marks more than half of the valid pixels") < told.index("All moving")


def test_a_split_needs_its_own_predictions_only(evaluate, masks, capsys):
    run = evaluate(masks, "--split", "moving")
    assert read_run(run).summary.images.evaluated == 8
    report = json.loads((run / "paper-v1" / "predictions.json").read_text())
    assert (report["expected"], report["elsewhere"], report["faults"]["extra"]) == (8, 4, [])
    shutil.rmtree(masks / "standing")
    evaluate(masks, "--split", "moving")
    capsys.readouterr()
    evaluate(masks, status=2)
    assert "got 4 missing; fix them, all are listed with -v; or score what is there" in capsys.readouterr().err


def probability(image) -> np.ndarray:
    """The likelihood as a score: the paper's threshold lies at one half."""
    odds = image.answer.likelihood.astype(np.float64) / 6e-4
    return odds / (1 + odds)


def test_scores_give_figures_over_all_thresholds(evaluate, images, tmp_path, capsys):
    sixteen = write_maps(tmp_path / "p", images, lambda image: np.round(65535 * probability(image)).astype(np.uint16))
    run = evaluate(sixteen, out="a", tables=True)
    summary = read_run(run).summary
    assert read_run(run).manifest.method.settings["threshold"] == 0.5
    free = summary.threshold_free
    assert "Over all thresholds: AUPRC" in capsys.readouterr().out
    assert "Over all thresholds: AUPRC" in (run / "paper-v1" / "table.md").read_text()
    assert free.images == 12
    other = read_run(evaluate(sixteen, "--threshold", "0.9", out="b")).summary
    assert other.threshold_free == free
    assert other.false_positives.coverage.value < summary.false_positives.coverage.value


def test_missing_scores_may_count_as_empty(evaluate, images, tmp_path):
    folder = write_maps(tmp_path / "p", images, lambda image: image.moving.astype(np.uint16) * 257)
    free = read_run(evaluate(folder)).summary.threshold_free
    assert (free.auprc.value, free.fpr95.value) == (1.0, 0.0)
    (folder / images[0].place / f"{images[0].timestamp_ns}.png").unlink()
    free = read_run(evaluate(folder, "--missing", "empty")).summary.threshold_free
    assert free.images == 12
    assert 0.0 < free.auprc.value < 1.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--threshold", "0.3"), "threshold: expected none for masks, got 0.3"),
        (("--threshold", "1"), "threshold: expected a number in [0, 1), got 1.0"),
        (("--name", "spherical"), "--name: expected another name than those of methods, got 'spherical'"),
    ],
)
def test_mistakes_of_the_call_are_one_clear_line(evaluate, masks, capsys, words, message):
    assert not evaluate(masks, *words, status=2).exists()
    shown = capsys.readouterr().err
    assert message in shown
    assert shown.count("\n") == 1


def test_folders_that_are_no_predictions(evaluate, images, masks, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    evaluate(tmp_path / "empty", "--missing", "empty", status=2)
    assert f"such as {images[0].place}/{images[0].timestamp_ns}.png, got no file" in capsys.readouterr().err
    evaluate(masks / "crossing", "--missing", "empty", status=2)
    assert re.search("got front/[0-9]+.png and 3 more", capsys.readouterr().err)


def test_links_that_lead_outside_are_not_followed(evaluate, images, masks, tmp_path):
    first, second, *_ = images
    file = masks / first.place / f"{first.timestamp_ns}.png"
    file.rename(tmp_path / "secret.png")
    file.symlink_to(tmp_path / "secret.png")
    shutil.move(masks / "standing", tmp_path / "elsewhere")
    (masks / "standing").symlink_to(tmp_path / "elsewhere")
    (masks / second.place / f"{second.timestamp_ns}.png").unlink()
    (masks / second.place / f"{second.timestamp_ns}.png").symlink_to(f"{images[2].timestamp_ns}.png")
    run = evaluate(masks, "--missing", "skip", status=2)
    report = json.loads((run / "paper-v1" / "predictions.json").read_text())
    assert report["usable"] == 7  # the link inside the folder is one of them
    (outside,) = report["faults"]["unusable"]
    assert outside["place"] == f"{first.place}/{first.timestamp_ns}.png"
    assert "a link that leads outside" in outside["reason"]
    assert [fault["place"] for fault in report["faults"]["extra"]] == ["standing"]


def test_images_are_not_read_for_masks(evaluate, masks, tiny_card, tmp_path):
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    card = folder / tiny_card.name
    without_scenario(card)
    for handle in open_dataset(load_card(str(card))):
        for image in handle.open().images["front"]:
            image.path.write_bytes(b"")
    summary = read_run(evaluate(masks, card=card)).summary
    assert (summary.images.evaluated, summary.all_moving.iou.value) == (12, 1.0)


def test_the_fingerprint_is_of_the_content_not_of_the_names(evaluate, images, masks, tmp_path):
    by_time = read_run(evaluate(masks, out="a")).manifest.method.settings["digest"]
    for file in list(masks.rglob("*.png")):
        file.rename(file.with_suffix(".PNG"))
    assert read_run(evaluate(masks, out="b")).manifest.method.settings["digest"] == by_time
    write_maps(masks, images, lambda image: image.moving * (image is not images[0]))
    assert read_run(evaluate(masks, out="b")).manifest.method.settings["digest"] != by_time


def test_what_predictions_were_made_of_is_not_rendered_anew(evaluate, masks, tiny_card, tmp_path):
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets")
    drives = sorted(mark.parent for mark in (folder / "data" / "tiny").glob("*/recording.json"))
    for drive in drives:  # as after a change of the renderer
        (drive / "synthesis.json").write_text("{}")
    evaluate(masks, card=folder / tiny_card.name)
    assert [(drive / "synthesis.json").read_text() for drive in drives] == ["{}"] * 3
