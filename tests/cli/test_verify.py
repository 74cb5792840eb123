"""`verify` on a run as it was stored, and on forged ones: every planted change is found."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bench.exchange.verify import VERIFIED, is_verified, verify_run
from bench.harness.masks import MASKS
from bench.harness.unit_files import image_maps_bytes

from bench.errors import BenchError
from bench.evaluation import read_sums, sum_run, summary_of, write_sums
from bench.execution import SerialExecutor
from bench.harness import open_tables, read_image_maps, read_run
from bench.harness.stored import IMAGE_MAPS, SUMMARY, SUMS, sums_digest
from bench.recordings import load_card
from bench.recordings.checked_json import with_digest
from tests.support.changed_data import without_scenario
from tests.support.commands import call
from tests.support.stored_files import change_manifest, change_summary

OBJECTS, FRAMES = "objects.parquet", "frames.parquet"


@pytest.fixture(scope="module")
def run(tiny_card, tmp_path_factory) -> Path:
    """A run of a method with causes, a likelihood and cells without an answer."""
    out = tmp_path_factory.mktemp("verified") / "run"
    with pytest.MonkeyPatch.context() as monkeypatch:
        words = ("--out", out, "--protocol", "surface-v1", "--no-pictures")
        assert call(monkeypatch, "run", tiny_card, *words) == 0
    return out


def test_a_run_as_it_was_stored_is_equal_and_marked_until_something_changes(run, tmp_path, monkeypatch, capsys):
    copied = shutil.copytree(run, tmp_path / "runs" / "copied")
    assert call(monkeypatch, "leaderboard", tmp_path / "runs") == 0
    assert ", verified" not in capsys.readouterr().out
    assert call(monkeypatch, "verify", copied) == 0
    assert "equal: " in capsys.readouterr().out
    assert is_verified(copied)
    assert call(monkeypatch, "leaderboard", tmp_path / "runs", "--out", tmp_path / "board", "--no-pictures") == 0
    assert ", verified" in capsys.readouterr().out
    (group,) = json.loads((tmp_path / "board" / "leaderboard.json").read_text())["groups"]
    assert [entry["verified"] for entry in group["entries"]] == [True]
    reseal(copied, lambda summary: summary["all_moving"]["iou"].update(value=0.99))
    assert not is_verified(copied), "the mark is of another summary"
    assert call(monkeypatch, "verify", copied) == 1
    assert "all_moving.iou.value 0.99, recounted" in " ".join(capsys.readouterr().out.split())
    assert not (copied / VERIFIED).exists()


def test_a_run_is_scored_again_in_its_folder_after_it_was_marked(run, tiny_card, tmp_path, monkeypatch):
    copied = shutil.copytree(run, tmp_path / "run")
    assert call(monkeypatch, "verify", copied) == 0
    words = ("--out", copied, "--protocol", "surface-v1", "--no-pictures")
    assert call(monkeypatch, "run", tiny_card, *words) == 0
    assert not (copied / VERIFIED).exists()


def test_images_that_cannot_be_read_fail_again_and_a_mask_that_is_left_out_is_told(tiny_card, tmp_path, monkeypatch):
    card = shutil.copytree(tiny_card.parent, tmp_path / "data") / tiny_card.name
    without_scenario(card)
    image = sorted((card.parent / "data" / "tiny" / "crossing" / "images" / "front").iterdir())[3]
    image.write_bytes(b"damaged")
    run = tmp_path / "run"
    assert call(monkeypatch, "run", card, "--out", run, "--no-pictures", "--no-cache") == 2
    assert read_run(run).summary.images.failed == 2  # and the one after it
    assert call(monkeypatch, "verify", run) == 0
    leave_out(run)
    told = verify_run(run, load_card(card), executor=SerialExecutor()).differences
    assert any("no mask, though the data allow to score the image" in line for line in told)


def reseal(run: Path, change=lambda _: None) -> None:
    """Make a run's manifest and summary fit its files, as one who forges it would, and then change the summary."""
    change_manifest(run, lambda manifest: manifest.update(sums=sums_digest(run)))
    change_summary(run, change)


def recount(run: Path) -> None:
    """Bring sums and summary in line with forged tables."""
    reseal(run)
    protocol = read_run(run).protocol
    sums = sum_run(*open_tables(run), protocol=protocol)
    write_sums(sums, run / SUMS)
    metrics = summary_of(sums, protocol=protocol)
    reseal(run, lambda summary: summary.update(metrics.model_dump(mode="json")))


def forged(run: Path, name: str, change) -> None:
    """Change the rows of a table: a function of the list of rows, in place or returned."""
    table = pq.read_table(run / name)
    rows = table.to_pylist()
    rows = change(rows) or rows
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), run / name)


def of_table(name: str, change):
    def forge(run: Path) -> None:
        forged(run, name, change)
        recount(run)

    return forge


def of_masks(change):
    def forge(run: Path) -> None:
        forged(run, MASKS, change)
        reseal(run)

    return forge


def of_summary(change):
    return lambda run: reseal(run, change)


def of_manifest(change):
    return lambda run: change_manifest(run, change)


def flip(rows) -> None:
    bits = np.unpackbits(np.frombuffer(rows[3]["mask"], np.uint8))
    middle = rows[3]["rows"] // 2 * rows[3]["columns"] + rows[3]["columns"] // 2
    bits[middle] ^= 1
    rows[3]["mask"] = np.packbits(bits).tobytes()


def swap(rows) -> None:
    rows[1]["mask"], rows[2]["mask"] = rows[2]["mask"], rows[1]["mask"]


def evaluated(rows) -> dict:
    return next(row for row in rows if row["status"] == "evaluated" and row["fn"] > 0)


def raise_tp(rows) -> None:
    row = evaluated(rows)
    row["tp"], row["fn"] = row["tp"] + 1, row["fn"] - 1


def without_the_worst(rows) -> list:
    worst = min((row for row in rows if row["status"] == "evaluated"), key=lambda row: row["tp"] / row["region_px"])
    return [row for row in rows if row is not worst]


def ignore(rows) -> None:
    evaluated(rows).update(status="ignored", reason="occluded", tp=0, fn=0, fp=0, region_px=0)


def less_false(rows) -> None:
    row = next(row for row in rows if row["fp_px"] > 10)
    row["fp_px"] -= 10
    row["detected_px"] -= 10
    row["fp_by_cause"] = [(name, px if k else px - 10) for k, (name, px) in enumerate(row["fp_by_cause"])]


def leave_out(run: Path) -> None:
    """The image with the most false positives was never scored."""
    frames = pq.read_table(run / FRAMES).to_pylist()
    worst = max(frames, key=lambda row: row["fp_px"])
    key = ("recording", "camera", "timestamp_ns")

    def other(row) -> bool:
        return any(row[name] != worst[name] for name in key)

    counts = [name for name, value in worst.items() if isinstance(value, int) and name != "timestamp_ns"]
    skipped = {"status": "skipped", "problem": "no history"} | dict.fromkeys(counts, 0)
    skipped |= {"fp_by_cause": [], "ego_speed_mps": math.nan}
    forged(run, FRAMES, lambda rows: [row if other(row) else row | skipped for row in rows])
    for name in (OBJECTS, MASKS):
        forged(run, name, lambda rows: [row for row in rows if other(row)])
    recount(run)


def leave_out_recording(run: Path) -> None:
    for name in (OBJECTS, FRAMES, MASKS):
        forged(run, name, lambda rows: [row for row in rows if row["recording"] != rows[0]["recording"]])
    recount(run)


def no_false_map(run: Path) -> None:
    maps = [*read_image_maps(run).values()]
    maps[0].false_px[:] = 0
    (run / IMAGE_MAPS).write_bytes(image_maps_bytes(maps))
    reseal(run)


def better_sums(run: Path) -> None:
    sums = read_sums(run / SUMS)
    row = sums[(sums["metric"] == "iou") & (sums["breakdown"] == "all_moving")].index[0]
    sums.loc[row, "numerator"] += 0.5
    write_sums(sums, run / SUMS)
    reseal(run)


def easier_protocol(run: Path) -> None:
    """Rules that evaluate less, under the same name."""
    content = json.loads((run / "protocol.json").read_text())
    content["scoring"]["chance_lag_s"] = 0.5
    (run / "protocol.json").write_text(json.dumps(content))
    from bench.evaluation import load_protocol

    digest = load_protocol(run / "protocol.json").digest
    change_manifest(run, lambda manifest: manifest["protocol"].update(digest=digest))


def other_manifest(run: Path) -> None:
    """The manifest beside the summary says that another method was scored."""
    file = run / "manifest.json"
    content = json.loads(file.read_text())
    content["method"]["name"] = "mine"
    file.write_text(json.dumps(with_digest(content)))


def careless(run: Path) -> None:
    """A number in the summary, and nothing else."""
    (run / SUMMARY).write_text((run / SUMMARY).read_text().replace('"tracks": 3', '"tracks": 4'))


def first_recording(manifest) -> str:
    return next(iter(manifest["dataset"]["recordings"]))


FORGED = {
    "masks: a cell": of_masks(flip),
    "masks: two swapped": of_masks(swap),
    "masks: one gone": of_masks(lambda rows: rows[1:]),
    "masks: one twice": of_masks(lambda rows: [*rows, rows[0]]),
    "masks: of a time without an image": of_masks(lambda rows: [*rows, rows[0] | {"timestamp_ns": 1}]),
    "masks: everything defined": of_masks(lambda rows: [row | {"undefined": None} for row in rows]),
    "masks: empty": of_masks(lambda rows: [row | {"mask": bytes(len(row["mask"]))} for row in rows]),
    "objects: one pixel more found": of_table(OBJECTS, raise_tp),
    "objects: the worst gone": of_table(OBJECTS, without_the_worst),
    "objects: one ignored": of_table(OBJECTS, ignore),
    "objects: nearer": of_table(OBJECTS, lambda rows: [row | {"range_m": 1.0} for row in rows]),
    "objects: faster": of_table(OBJECTS, lambda rows: [row | {"speed_mps": 7.0} for row in rows]),
    "objects: a chance that there was not": of_table(OBJECTS, lambda rows: evaluated(rows).update(chance_tp=0)),
    "objects: lower ceiling": of_table(
        OBJECTS, lambda rows: [row | {"ceiling_tp": row["ceiling_tp"] and 1} for row in rows]
    ),
    "frames: fewer false positives": of_table(FRAMES, less_false),
    "frames: an image skipped": leave_out,
    "frames: a recording left out": leave_out_recording,
    "maps: no false positives": no_false_map,
    "sums: a larger numerator": better_sums,
    "summary: another value": of_summary(lambda s: s["categories"]["crossing"]["tpr_all"].update(value=0.999)),
    "summary: an interval": of_summary(lambda s: s["all_moving"]["iou"].update(ci95=[0.4, 0.5])),
    "summary: better at all thresholds": of_summary(lambda s: s["threshold_free"]["auprc"].update(value=0.999)),
    "summary: without a digest": careless,
    "manifest: other data": of_manifest(lambda m: m["dataset"].update(data="0" * 64)),
    "manifest: another recording's data": of_manifest(
        lambda m: m["dataset"]["recordings"].update({first_recording(m): "0" * 16})
    ),
    "manifest: another data set": of_manifest(lambda m: m["dataset"].update(name="demo")),
    "manifest: another reference": of_manifest(lambda m: m.update(reference="0" * 64)),
    "manifest: more history": of_manifest(lambda m: m["method"].update(history=2)),
    "manifest: no digest of the sums": of_manifest(lambda m: m.update(sums=None)),
    "manifest: sums of another run": of_manifest(lambda m: m.update(sums="0" * 64)),
    "manifest: two methods": other_manifest,
    "protocol: other rules": easier_protocol,
}


def test_the_last_bit_of_a_place_is_no_difference(run, tiny_card, tmp_path):
    copied = shutil.copytree(run, tmp_path / "run")
    of_table(OBJECTS, lambda rows: [row | {"x_m": math.nextafter(row["x_m"], 99)} for row in rows])(copied)
    assert verify_run(copied, load_card(tiny_card), executor=SerialExecutor()).differences == ()


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_run_is_found(run, tiny_card, tmp_path, name):
    copied = shutil.copytree(run, tmp_path / "run")
    FORGED[name](copied)
    try:
        found = verify_run(copied, load_card(tiny_card), executor=SerialExecutor()).differences
    except BenchError as error:
        found = (str(error),)
    assert found
    assert all(str(tmp_path) in line or line.split(":")[0] in NAMES for line in found), found
    assert not is_verified(copied)


NAMES = {OBJECTS, FRAMES, MASKS, SUMS, SUMMARY, IMAGE_MAPS, "manifest.json", "protocol.json"}
