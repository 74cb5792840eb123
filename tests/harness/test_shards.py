"""Parts of a run, scored in one folder or in many, make the run in one piece; anything else is refused."""

import json
import shutil
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.evaluation import load_protocol
from bench.harness import RunRequest, merge_shards, run_benchmark, run_shard
from bench.harness.shards import Shard
from bench.methods import build_method
from bench.recordings import load_card
from tests.support.changed_data import DAMAGES, change_annotation, change_calibration, change_egomotion, remove_image
from tests.support.runs import bytes_of

pytestmark = pytest.mark.slow

PAPER = load_protocol("paper-v1")
COUNT = 3


def score_part(card: Path, out: Path, number: int, *, count=COUNT, settings=None, protocol=PAPER, overwrite=False):
    return run_shard(
        [
            RunRequest(
                card=load_card(str(card)),
                method=build_method("spherical", settings or {}),
                protocol=protocol,
                out=out,
                overwrite=overwrite,
            )
        ],
        Shard(number=number, count=count),
    )[0]


@pytest.fixture(scope="module")
def whole(tiny_card, tmp_path_factory) -> Path:
    """The run in one piece."""
    out = tmp_path_factory.mktemp("whole") / "run"
    run_benchmark(
        RunRequest(card=load_card(str(tiny_card)), method=build_method("spherical", {}), protocol=PAPER, out=out)
    )
    return out


@pytest.fixture(scope="module")
def parts_once(tiny_card, tmp_path_factory) -> list[Path]:
    """The folders of three parts."""
    folder = tmp_path_factory.mktemp("parts")
    folders = [folder / f"part-{number}" for number in range(1, COUNT + 1)]
    for number, out in enumerate(folders, 1):
        score_part(tiny_card, out, number)
    return folders


@pytest.fixture
def parts(parts_once, tmp_path) -> list[Path]:
    """A copy of the three parts that a test may damage."""
    return [shutil.copytree(folder, tmp_path / folder.name) for folder in parts_once]


def merge(out: Path, folders: list[Path]):
    return merge_shards(out, folders)


def test_parts_of_many_folders_make_the_whole(whole, parts, tmp_path):
    summary = merge(tmp_path / "run", parts)
    assert bytes_of(tmp_path / "run") == bytes_of(whole)
    assert summary.provenance.work.units_computed == 3


def test_parts_may_be_merged_into_one_of_their_folders(whole, parts):
    merge(parts[0], parts)
    assert bytes_of(parts[0]) == bytes_of(whole)


def test_parts_of_one_folder_make_the_whole_in_any_order(whole, tiny_card, tmp_path):
    for number in (3, 1, 2):
        score_part(tiny_card, tmp_path, number)
    merge(tmp_path, [tmp_path])
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_more_parts_than_units_are_no_fault(whole, tiny_card, tmp_path):
    reports = [score_part(tiny_card, tmp_path, number, count=5) for number in range(1, 6)]
    assert [len(report.units) for report in reports] == [1, 1, 1, 0, 0]
    merge(tmp_path, [tmp_path])
    assert bytes_of(tmp_path) == bytes_of(whole)


def test_a_part_that_is_scored_again_computes_nothing(tiny_card, parts, whole):
    work = score_part(tiny_card, parts[1], 2).provenance.work
    assert (work.units_computed, work.units_reused) == (0, 1)
    merge(parts[1], parts)
    assert bytes_of(parts[1]) == bytes_of(whole)


def test_a_whole_run_takes_over_what_its_parts_have_computed(tiny_card, parts, whole):
    method = build_method("spherical", {})
    run_benchmark(RunRequest(card=load_card(str(tiny_card)), method=method, protocol=PAPER, out=parts[1]))
    assert bytes_of(parts[1]) == bytes_of(whole)
    assert not (parts[1] / "shards" / Shard(number=2, count=COUNT).file).exists()


def test_a_part_that_is_missing_is_named(parts, tmp_path):
    with pytest.raises(DataError, match="none of 2/3"):
        merge(tmp_path / "run", [parts[0], parts[2]])
    assert not (tmp_path / "run" / "summary.json").exists()


def test_no_part_at_all_is_told(tmp_path):
    with pytest.raises(DataError, match="parts of a run"):
        merge(tmp_path / "run", [tmp_path])


def test_a_part_that_comes_twice_is_refused(parts, tmp_path):
    with pytest.raises(DataError, match="each part once"):
        merge(tmp_path / "run", [*parts, parts[0]])


def test_parts_of_different_cuts_are_refused(tiny_card, parts, tmp_path):
    score_part(tiny_card, tmp_path / "other", 1, count=2)
    with pytest.raises(DataError, match="different cuts"):
        merge(tmp_path / "run", [*parts, tmp_path / "other"])


def test_a_part_of_another_method_is_refused(tiny_card, parts, tmp_path):
    score_part(tiny_card, parts[1], 2, settings={"threshold": 1e-3}, overwrite=True)
    with pytest.raises(DataError, match=r"part 2/3 with another method or other settings \(spherical\)"):
        merge(tmp_path / "run", parts)


def test_a_part_of_another_protocol_is_refused(tiny_card, parts, tmp_path):
    score_part(tiny_card, parts[1], 2, protocol=load_protocol("extended-v1"), overwrite=True)
    with pytest.raises(DataError, match="part 2/3 with another protocol"):
        merge(tmp_path / "run", parts)


def test_a_part_of_other_data_is_refused(own_card, parts, tmp_path):
    """The data have fewer images since: the units are others."""
    shutil.rmtree(own_card.parent / "data" / "tiny" / "overtaking")
    score_part(own_card, parts[1], 2)
    with pytest.raises(DataError, match="part 2/3 with other data: recordings, calibration"):
        merge(tmp_path / "run", parts)


@pytest.mark.parametrize("change", [change_annotation, change_calibration, change_egomotion, remove_image])
def test_a_part_of_changed_data_is_refused(own_card, parts, tmp_path, change):
    """The change is in a recording of another part."""
    change(own_card.parent / "data" / "tiny" / "overtaking")
    score_part(own_card, parts[2], 3)
    with pytest.raises(DataError, match="part 3/3 with other data: recordings, calibration"):
        merge(tmp_path / "run", parts)


def test_a_part_of_another_name_for_the_card_is_the_same(tiny_card, parts, whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tiny_card.parent)
    score_part(Path("./tiny.yaml"), parts[1], 2)
    merge(tmp_path / "run", parts)
    assert bytes_of(tmp_path / "run") == bytes_of(whole)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"code": "0" * 64}, "with other code of fisheye-bench, another Python or other libraries"),
        ({"method": {"identity": "0" * 64}}, "with other code, libraries or files of the method 'spherical'"),
    ],
)
def test_a_part_of_other_code_is_refused(parts, tmp_path, changed, told):
    file = parts[1] / "shards" / Shard(number=2, count=COUNT).file
    content = json.loads(file.read_text())
    del content["sha256"]
    method = content["stamp"]["method"] | changed.get("method", {})
    content["stamp"] |= changed | {"method": method}
    file.write_text(json.dumps(content))
    with pytest.raises(DataError, match=f"part 2/3 {told}"):
        merge(tmp_path / "run", parts)


def test_parts_of_another_experiment_do_not_take_the_place_of_a_finished_run(tiny_card, parts, tmp_path):
    run_benchmark(
        RunRequest(card=load_card(str(tiny_card)), method=build_method("nothing"), protocol=PAPER, out=tmp_path / "run")
    )
    before = bytes_of(tmp_path / "run")
    with pytest.raises(DataError, match="--overwrite"):
        merge(tmp_path / "run", parts)
    assert bytes_of(tmp_path / "run") == before
    assert merge_shards(tmp_path / "run", parts, overwrite=True).manifest.method.name == "spherical"


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"schema_version": 1}', b"\xff\xfe", None])
def test_a_damaged_report_is_named(parts, tmp_path, damage):
    file = parts[1] / "shards" / Shard(number=2, count=COUNT).file
    file.write_bytes(file.read_bytes()[:-30] if damage is None else damage)
    with pytest.raises(DataError, match=r"expected (the report of a part|an object|a value), got") as raised:
        merge(tmp_path / "run", parts)
    assert str(raised.value).startswith(str(file))


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_unit_is_named(parts, tmp_path, damage):
    file = next(iter((parts[1] / "units").glob("*.unit")))
    DAMAGES[damage](file)
    with pytest.raises(DataError, match="expected a stored unit") as raised:
        merge(tmp_path / "run", parts)
    assert str(parts[1]) in str(raised.value)
    assert not (tmp_path / "run" / "summary.json").exists()


def test_a_unit_of_a_later_run_in_the_folder_is_refused(tiny_card, parts, tmp_path):
    report = parts[1] / "shards" / Shard(number=2, count=COUNT).file
    before = report.read_bytes()
    score_part(tiny_card, parts[1], 2, settings={"threshold": 1e-3}, overwrite=True)
    report.write_bytes(before)
    with pytest.raises(DataError, match="a later run has written"):
        merge(tmp_path / "run", parts)


def test_a_report_names_no_unit_elsewhere(parts, tmp_path):
    """A report is data: what it names stays in its folder."""
    file = parts[1] / "shards" / Shard(number=2, count=COUNT).file
    content = json.loads(file.read_text())
    del content["sha256"]
    content["units"][0]["recording"] = "../../../etc"
    file.write_text(json.dumps(content))
    with pytest.raises(DataError, match="expected a stored unit"):
        merge(tmp_path / "run", parts)


def test_a_unit_that_failed_is_told_by_the_whole(own_card, tmp_path):
    remove_image(own_card.parent / "data" / "tiny" / "overtaking")
    (own_card.parent / "data" / "tiny" / "standing" / "recording.json").unlink()
    for number in (1, 2):
        score_part(own_card, tmp_path / "run", number, count=2)
    method = build_method("spherical", {})
    run_benchmark(RunRequest(card=load_card(str(own_card)), method=method, protocol=PAPER, out=tmp_path / "whole"))
    summary = merge(tmp_path / "run", [tmp_path / "run"])
    assert len(summary.failures) >= 1
    assert bytes_of(tmp_path / "run") == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("text", ["", "1", "/", "1/", "/2", "0/2", "3/2", "-1/2", "1/2/3", "a/b", "²/3", "1.0/2"])
def test_a_part_that_is_none_is_a_usage_error(text):
    with pytest.raises(UsageError, match="--shard: expected I/N"):
        Shard.parse(text)
