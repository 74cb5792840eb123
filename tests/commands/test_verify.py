"""`verify` on a run as it was stored, and on forged ones: every planted change is found."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from bench.commands.verify import card_to_verify
from bench.evaluation.protocol import Protocol, load_protocol
from bench.evaluation.summary import summary_of
from bench.evaluation.sums import read_sums, sum_run, write_sums
from bench.harness.counts import TABLES, read_parts
from bench.harness.stored import read_run
from bench.recordings.cards import shipped_folder
from tests.conftest import DATASETS
from tests.support.changed_data import without_scenario
from tests.support.commands import call, error_line, output_of
from tests.support.counts import change_table
from tests.support.stored_files import change_manifest, change_summary

BY = "surface-v1"


@pytest.fixture(scope="module")
def run(tiny_card, tmp_path_factory) -> Path:
    """A run of a method with causes, a likelihood and cells without an answer."""
    out = tmp_path_factory.mktemp("verified") / "run"
    card = tiny_card.with_name("with-caveats.yaml")
    card.write_text(f"{tiny_card.read_text()}\ncaveats: rendered\n")
    with pytest.MonkeyPatch.context() as monkeypatch:
        words = ("--out", out, "--protocol", BY, "--no-pictures", "--workers", 1)
        assert call(monkeypatch, "run", card, *words) == 0
    return out


def test_a_run_as_it_was_stored_is_equal_and_called_verified_by_whoever_did_it(run, tiny_card, tmp_path, monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path / "mine"))
    copied = shutil.copytree(run, tmp_path / "runs" / "copied")
    before = sorted(file.name for file in copied.rglob("*"))
    assert ", verified" not in output_of("leaderboard", tmp_path / "runs")
    told = output_of("verify", copied, "--data", tiny_card)
    assert f"data: card {tiny_card}, root {tiny_card.parent / 'data' / 'tiny'}" in told.replace("\n", "")
    assert "equal: " in told
    assert sorted(file.name for file in copied.rglob("*")) == before, "the run tells nothing of it"
    assert ", verified" in output_of("leaderboard", tmp_path / "runs", "--out", tmp_path / "board")
    (group,) = json.loads((tmp_path / "board" / "leaderboard.json").read_text())["groups"]
    assert [entry["verified"] for entry in group["entries"]] == [True]
    change_summary(copied, lambda summary: summary["all_moving"]["iou"].update(value=0.99))
    assert ", verified" not in output_of("leaderboard", tmp_path / "runs"), "it is another summary now"
    assert "all_moving: other metrics than its counts give" in " ".join(
        output_of("verify", copied, "--data", tiny_card, status=1).split()
    )
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", str(tmp_path / "theirs"))
    assert ", verified" not in output_of("leaderboard", run.parent), "nobody else believes it"


def test_images_that_cannot_be_read_fail_again_and_caveats_are_those_of_the_data(tiny_card, tmp_path, monkeypatch):
    card = shutil.copytree(tiny_card.parent, tmp_path / "data") / tiny_card.name
    without_scenario(card)
    card.write_text(f"{card.read_text()}\ncaveats: drawn by nobody\n")
    image = sorted((card.parent / "data" / "tiny" / "crossing" / "images" / "front").iterdir())[3]
    image.write_bytes(b"damaged")
    run = tmp_path / "run"
    words = ("--method", "frame-difference", "--protocol", BY, "--no-pictures", "--workers", 1)
    assert call(monkeypatch, "run", card, *words, "--out", run) == 2
    assert read_run(run).summary.images.failed == 2  # and the one after it
    assert call(monkeypatch, "verify", run, "--data", card) == 0
    change_summary(run, lambda summary: summary.update(caveats=""))
    assert call(monkeypatch, "verify", run, "--data", card) == 1


def test_a_card_that_only_the_run_names_is_not_opened(run, tiny_card, tmp_path, monkeypatch, capsys):
    """Neither by its path, nor by its name beside the run: its scenario would be rendered into any folder."""
    copied = shutil.copytree(run, tmp_path / "run")
    theirs = tmp_path / "datasets" / "theirs.yaml"
    theirs.parent.mkdir()
    theirs.write_text(
        f"{{name: theirs, title: t, adapter: native, root: {tmp_path / 'mine'}, scenario: t.scenario.yaml, licence: x}}"
    )
    shutil.copy(DATASETS / "tiny.scenario.yaml", tmp_path / "datasets" / "t.scenario.yaml")
    monkeypatch.chdir(tmp_path)
    for card in (str(theirs), "theirs"):
        change_manifest(copied, lambda manifest, card=card: manifest["dataset"].update(name="theirs", card=card))
        told = error_line(monkeypatch, capsys, "verify", copied)
        assert "that ships with the package, got 'theirs'; name the card of your own copy with --data" in told
    assert not (tmp_path / "mine").exists()
    shutil.copy(tiny_card, tmp_path / "datasets")
    assert card_to_verify(run, None).file.parent == shipped_folder(), "not the one beside the run"
    assert card_to_verify(run, "tiny").file.parent == Path("datasets"), "whoever names it has looked at it"


def recount(run: Path) -> None:
    """Bring sums and summary in line with forged counts."""
    results, protocol = run / BY, load_protocol(BY)
    sums = sum_run(*(read_parts(results, table) for table in TABLES), protocol=protocol)
    write_sums(sums, results / "sums.csv")
    metrics = summary_of(sums, protocol=protocol)
    change_summary(results, lambda summary: summary.update(metrics.model_dump(mode="json")))


def of_table(table: str, change):
    """Change the rows of a table: a function of the list of rows, in place or returned."""

    def forge(run: Path) -> None:
        def changed(stored: pa.Table) -> pa.Table:
            rows = stored.to_pylist()
            return pa.Table.from_pylist(change(rows) or rows, schema=stored.schema)

        change_table(run / BY, table, changed, recording="crossing")
        recount(run)

    return forge


def of_answers(change):
    def forge(run: Path) -> None:
        file = next((run / "answers" / "crossing").iterdir())
        stored = pq.read_table(file)
        rows = stored.to_pylist()
        pq.write_table(pa.Table.from_pylist(change(rows) or rows, schema=stored.schema), file)

    return forge


def flip(rows) -> None:
    bits = np.unpackbits(np.frombuffer(rows[2]["mask"], np.uint8))
    bits[rows[2]["rows"] // 2 * rows[2]["columns"] + rows[2]["columns"] // 2] ^= 1
    rows[2]["mask"] = np.packbits(bits).tobytes()


def raise_tp(rows) -> None:
    row = next(row for row in rows if row["status"] == "evaluated" and row["tp"] > 0)
    row["tp"], row["fn"] = row["tp"] - 1, row["fn"] + 1


def less_false(rows) -> None:
    row = next(row for row in rows if row["fp_px"] > 10)
    row["fp_px"] -= 10
    row["detected_px"] -= 10
    row["fp_by_cause"] = [(name, px if k else px - 10) for k, (name, px) in enumerate(row["fp_by_cause"])]


def leave_out(run: Path) -> None:
    """An image was never answered, and so never scored."""
    reason = {"status": "skipped", "problem": "no history"}
    of_answers(lambda rows: [rows[0] | reason, *rows[1:]])(run)
    gone = []

    def skipped(rows):
        gone.append(rows[0]["timestamp_ns"])
        zero = dict.fromkeys([name for name, value in rows[0].items() if isinstance(value, int)], 0)
        left = {"timestamp_ns": gone[0], "fp_by_cause": [], "ego_speed_mps": float("nan")}
        empty = {name: None for name in rows[0] if name.startswith("likelihood_")}
        return [rows[0] | zero | reason | left | empty, *rows[1:]]

    of_table("frames", skipped)(run)
    of_table("objects", lambda rows: [row for row in rows if row["timestamp_ns"] != gone[0]])(run)


def leave_out_recording(run: Path) -> None:
    for place in (run / "answers" / "crossing", run / BY / "counts" / "crossing"):
        shutil.rmtree(place)
    recount(run)


def better_sums(run: Path) -> None:
    sums = read_sums(run / BY / "sums.csv")
    row = sums[(sums["metric"] == "iou") & (sums["breakdown"] == "all_moving")].index[0]
    sums.loc[row, "numerator"] += 0.01
    write_sums(sums, run / BY / "sums.csv")


def easier_protocol(run: Path) -> None:
    """Rules that evaluate less, under the same name."""
    file = run / BY / "protocol.json"
    content = json.loads(file.read_text())
    content["scoring"]["chance_lag_s"] = 0.5
    file.write_text(json.dumps(content))
    digest = Protocol.model_validate(content).digest
    change_manifest(run, lambda manifest: manifest["protocol"].update(digest=digest))


FORGED = {
    "answers: a cell": of_answers(flip),
    "answers: one gone": of_answers(lambda rows: rows[1:]),
    "answers: everything defined": of_answers(lambda rows: [row | {"undefined": None} for row in rows]),
    "answers: empty": of_answers(lambda rows: [row | {"mask": bytes(len(row["mask"]))} for row in rows]),
    "objects: one pixel": of_table("objects", raise_tp),
    "objects: one fewer": of_table("objects", lambda rows: rows[1:]),
    "objects: one twice": of_table("objects", lambda rows: [*rows, rows[0] | {"track_id": "another"}]),
    "frames: ten false pixels fewer": of_table("frames", less_false),
    "an image that was left out": leave_out,
    "a recording that was left out": leave_out_recording,
    "sums": better_sums,
    "summary": lambda run: change_summary(run, lambda summary: summary["false_positives"]["coverage"].update(value=0)),
    "protocol": easier_protocol,
    "manifest: other data": lambda run: change_manifest(
        run, lambda manifest: manifest["dataset"]["recordings"].update(crossing="0" * 16)
    ),
    "manifest: other reference": lambda run: change_manifest(run, lambda manifest: manifest.update(reference="0" * 64)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FORGED)
def test_a_forged_run_is_found(run, tiny_card, tmp_path, monkeypatch, capsys, name):
    copied = shutil.copytree(run, tmp_path / "run")
    FORGED[name](copied)
    words = ("--data", tiny_card.with_name("with-caveats.yaml"), "--workers", 1)
    assert call(monkeypatch, "verify", copied, *words) in (1, 2), capsys.readouterr().out
