"""A part is an unfinished run: what is stored is done, whoever computed it, and a run computes the rest."""

import shutil
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.evaluation import load_protocol
from bench.harness import Part, RunRequest, score_part
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.changed_data import DAMAGES, change_annotation, remove_image
from tests.support.commands import call
from tests.support.runs import PAPER, bytes_of, score

pytestmark = pytest.mark.slow

COUNT = 3


def score_of_part(card: Path, out: Path, number: int, *, count=COUNT, settings=None, protocol=PAPER, overwrite=False):
    method = build_method("spherical", settings or {})
    request = RunRequest(card=load_card(str(card)), method=method, runs={out: protocol}, overwrite=overwrite)
    return score_part(request, Part(number=number, count=count))


def work_of(summary) -> tuple[int, int]:
    work = summary.provenance.work
    return work.units_computed, work.units_reused


@pytest.fixture(scope="module")
def whole(tiny_card, tmp_path_factory) -> Path:
    """The run in one piece."""
    out = tmp_path_factory.mktemp("whole") / "run"
    score(tiny_card, out)
    return out


@pytest.fixture(scope="module")
def parts_once(tiny_card, tmp_path_factory) -> list[Path]:
    """The folders of three parts."""
    folders = [tmp_path_factory.mktemp("parts") / f"part-{number}" for number in range(1, COUNT + 1)]
    for number, out in enumerate(folders, 1):
        score_of_part(tiny_card, out, number)
    return folders


@pytest.fixture
def out(parts_once, tmp_path) -> Path:
    """A folder into which the units of all parts are copied."""
    for folder in parts_once:
        shutil.copytree(folder / "units", tmp_path / "run" / "units", dirs_exist_ok=True)
    return tmp_path / "run"


def test_units_of_many_folders_copied_together_make_the_whole(whole, out, tiny_card):
    assert not (out / "summary.json").exists()
    assert work_of(score(tiny_card, out)) == (0, COUNT)
    assert bytes_of(out) == bytes_of(whole)


def test_parts_of_one_folder_make_the_whole_in_any_order(whole, tiny_card, tmp_path):
    for number in (3, 1, 2):
        score_of_part(tiny_card, tmp_path, number)
    assert work_of(score(tiny_card, tmp_path)) == (0, COUNT)
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_more_parts_than_units_are_no_fault(tiny_card, tmp_path):
    scored = [score_of_part(tiny_card, tmp_path, number, count=5) for number in range(1, 6)]
    assert [len(one.units) for one in scored] == [1, 1, 1, 0, 0]
    assert {one.units_of_run for one in scored} == {COUNT}
    assert len(list((tmp_path / "units").glob("*.unit"))) == COUNT


def test_a_part_that_is_scored_again_computes_nothing_and_leaves_the_others(tiny_card, out):
    scored = score_of_part(tiny_card, out, 2)
    work = scored.provenance(out, images=0).work
    assert (work.units_computed, work.units_reused) == (0, 1)
    assert len(list((out / "units").glob("*.unit"))) == COUNT


def test_a_run_computes_what_is_missing_or_damaged(whole, out, tiny_card):
    for damage in DAMAGES.values():
        damage(min((out / "units").glob("standing*.unit")))
        assert work_of(score(tiny_card, out)) == (1, COUNT - 1)
    assert bytes_of(out) == bytes_of(whole)


def test_a_unit_under_the_name_of_another_is_not_used(whole, out, tiny_card):
    one, other = (min((out / "units").glob(f"{name}*.unit")) for name in ("crossing", "standing"))
    shutil.copy(one, other)
    assert work_of(score(tiny_card, out)) == (1, COUNT - 1)
    assert bytes_of(out) == bytes_of(whole)


@pytest.mark.parametrize(
    "other",
    [
        {"settings": {"threshold": 1e-3}},
        {"protocol": load_protocol("extended-v1")},
    ],
    ids=["settings", "protocol"],
)
def test_a_part_of_another_run_is_refused_in_the_folder_or_its_units_are_not_used(whole, tiny_card, tmp_path, other):
    out = tmp_path / "run"
    score_of_part(tiny_card, out, 1)
    with pytest.raises(DataError, match="expected an empty folder or the run that is asked for, got another one"):
        score_of_part(tiny_card, out, 2, **other)
    score_of_part(tiny_card, tmp_path / "other", 2, **other)
    shutil.copytree(tmp_path / "other" / "units", out / "units", dirs_exist_ok=True)
    assert work_of(score(tiny_card, out)) == (COUNT - 1, 1)
    assert bytes_of(out) == bytes_of(whole)
    assert len(list((out / "units").glob("*.unit"))) == COUNT, "what is not of the run does not stay"
    assert len(list((out / "units").iterdir())) == COUNT + 2, "the lists of its code and its method do"


def test_parts_before_and_after_a_change_of_data_do_not_mix(own_card, out, tmp_path):
    change_annotation(own_card.parent / "data" / "tiny" / "overtaking")
    assert work_of(score(own_card, out)) == (1, COUNT - 1)
    score(own_card, tmp_path / "fresh")
    assert bytes_of(out) == bytes_of(tmp_path / "fresh")


def test_a_part_of_another_name_for_the_card_is_the_same(tiny_card, tmp_path, monkeypatch):
    monkeypatch.chdir(tiny_card.parent)
    score_of_part(Path("./tiny.yaml"), tmp_path / "run", 2)
    assert work_of(score(tiny_card, tmp_path / "run")) == (COUNT - 1, 1)


def test_a_part_does_not_take_the_place_of_a_finished_run(tiny_card, tmp_path):
    out = tmp_path / "run"
    score(tiny_card, out, method="nothing")
    before = bytes_of(out)
    with pytest.raises(DataError, match="--overwrite"):
        score_of_part(tiny_card, out, 1)
    score_of_part(tiny_card, out, 1, overwrite=True)
    assert bytes_of(out) == before
    assert work_of(score(tiny_card, out, overwrite=True)) == (COUNT - 1, 1)


def test_a_unit_that_failed_is_told_by_the_part_and_by_the_whole(own_card, tmp_path):
    remove_image(own_card.parent / "data" / "tiny" / "overtaking")
    (own_card.parent / "data" / "tiny" / "standing" / "recording.json").unlink()
    out = tmp_path / "run"
    for number in (1, 2):
        assert any("'standing'" in failure for failure in score_of_part(own_card, out, number, count=2).failures(out))
    summary = score(own_card, out)
    assert any("'standing'" in failure for failure in summary.failures)
    score(own_card, tmp_path / "whole")
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


def test_the_command_says_how_far_it_is_and_what_comes_next(tiny_card, tmp_path, monkeypatch, capsys):
    out = tmp_path / "run"
    words = ("run", tiny_card, "--method", "nothing", "--workers", 1, "--no-pictures", "--out", out)
    assert call(monkeypatch, *words, "--shard", "1/2") == 0
    shown = capsys.readouterr().out
    assert f"part 1/2: 2 of its 2 units are in {out}, of 3 in all; the same command without --shard ends" in shown
    assert call(monkeypatch, *words) == 0
    assert "units computed 1, found done 2" in capsys.readouterr().out
    assert call(monkeypatch, "merge", out, "elsewhere", "--no-pictures") == 2
    assert "without --shard" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "1", "/", "1/", "/2", "0/2", "3/2", "-1/2", "1/2/3", "a/b", "²/3", "1.0/2"])
def test_a_part_that_is_none_is_a_usage_error(text):
    with pytest.raises(UsageError, match="--shard: expected I/N"):
        Part.parse(text)
