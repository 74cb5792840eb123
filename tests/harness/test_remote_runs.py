"""Runs on object storage: the same bytes as on disk, and they go on from wherever they stopped."""

import json

import pytest
import yaml

from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.execution import ProcessExecutor, SerialExecutor
from bench.harness import RunRequest, merge_shards, merged_units, run_benchmark, run_shard
from bench.harness.remote_runs import MARK, RemoteRun, downloaded_run
from bench.harness.shards import Shard
from bench.methods import build_method
from bench.recordings import load_card
from bench.recordings.object_storage import parse_location
from bench.recordings.remote import Storage
from tests.harness.test_resume import ALL, NONE, ONE, bytes_of, change_image, damage_image
from tests.support.object_storage import bucket, object_server

pytestmark = pytest.mark.slow

__all__ = ["bucket", "object_server"]

PAPER = load_protocol("paper-v1")
SERIAL = SerialExecutor()
URL = "s3://bench/runs/one"


def score(card, out, *, method="nothing", executor=SERIAL, **options):
    given = {"method": build_method(method), "protocol": PAPER, "executor": executor}
    return run_benchmark(RunRequest(card=load_card(str(card)), out=out, **given, **options))


def score_there(card, *, machine=None, monkeypatch=None, **options):
    """Score into the address, on a machine that has seen nothing yet where one is named."""
    if machine is not None:
        monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(machine))
    remote = RemoteRun(url=parse_location(URL))
    return score(card, remote.folder, mirror=remote, **options)


def remote_card(card, bucket) -> str:
    """A card like another one, of a copy of its data on the storage."""
    content = yaml.safe_load(card.read_text())
    url = bucket.put_folder(card.parent / content["root"], "sets/tiny")
    file = card.with_name("remote.yaml")
    file.write_text(yaml.safe_dump(content | {"root": url}))
    return file


def without_card(found: dict[str, bytes]) -> dict[str, bytes]:
    summary = json.loads(found["summary"])
    del summary["card"]
    return found | {"summary": json.dumps(summary).encode()}


@pytest.fixture
def work(monkeypatch):
    """Units computed and reused."""

    def counted(summary):
        return summary.provenance.work.units_computed, summary.provenance.work.units_reused

    return counted


@pytest.mark.parametrize("executor", [SERIAL, ProcessExecutor(workers=2)], ids=["here", "processes"])
def test_data_at_an_address_gives_the_same_bytes_as_on_disk(own_card, bucket, tmp_path, executor):
    damage_image(own_card.parent / "data" / "tiny" / "crossing")
    there = remote_card(own_card, bucket)
    of_disk = score(own_card, tmp_path / "disk", method="spherical")
    of_storage = score(there, tmp_path / "remote-run", method="spherical", executor=executor)
    assert without_card(bytes_of(tmp_path / "remote-run")) == without_card(bytes_of(tmp_path / "disk"))
    assert of_storage.provenance.data_fingerprint == of_disk.provenance.data_fingerprint
    assert len(of_disk.failures) == 2, "the damaged image and the one after it, told by names without a place"
    assert all("crossing/images/front" in failure and str(tmp_path) not in failure for failure in of_disk.failures)


def test_a_result_does_not_depend_on_where_the_data_lies(own_card, bucket, tmp_path, work):
    score(own_card, tmp_path / "run")
    assert work(score(remote_card(own_card, bucket), tmp_path / "run")) == (NONE, ALL)
    (own_card.parent / "data").rename(own_card.parent / "moved")
    own_card.write_text(own_card.read_text().replace("root: data/tiny", "root: moved/tiny"))
    assert work(score(own_card, tmp_path / "run")) == (NONE, ALL)


def test_changed_data_at_an_address_is_scored_again(own_card, bucket, tmp_path, work):
    there = remote_card(own_card, bucket)
    score(there, tmp_path / "run")
    change_image(own_card.parent / "data" / "tiny" / "standing")
    remote_card(own_card, bucket)
    assert work(score(there, tmp_path / "run")) == (ONE, ALL - ONE)


def test_a_run_at_an_address_has_the_files_of_a_local_one(own_card, bucket, tmp_path):
    score(own_card, tmp_path / "run")
    score_there(own_card)
    expected = {
        path.relative_to(tmp_path / "run").as_posix() for path in (tmp_path / "run").rglob("*") if path.is_file()
    }
    assert {key.removeprefix("runs/one/") for key in bucket.names("runs/one/")} == expected | {MARK}
    for name in ("objects.parquet", "frames.parquet", "masks.parquet", "image_maps.npz"):
        assert bucket.get(f"runs/one/{name}") == (tmp_path / "run" / name).read_bytes()
    told = bucket.get("runs/one/summary.json").decode()
    assert not any(secret in told for secret in ("secret-of-tests", "key-of-tests", bucket.endpoint))
    assert bytes_of(downloaded_run(parse_location(URL))) == bytes_of(tmp_path / "run")


def test_another_machine_computes_nothing_again(own_card, bucket, tmp_path, monkeypatch, work):
    score_there(own_card)
    stored = {key: bucket.get(key) for key in bucket.names("runs/one/units/")}
    again = score_there(own_card, machine=tmp_path / "other", monkeypatch=monkeypatch)
    assert work(again) == (NONE, ALL)
    assert {key: bucket.get(key) for key in bucket.names("runs/one/units/")} == stored


def units_at(bucket) -> int:
    return sum(key.endswith(".unit") for key in bucket.names("runs/one/units/"))


def results_at(bucket) -> dict[str, bytes]:
    return {key: bucket.get(key) for key in bucket.names() if "/units/" not in key and "/shards/" not in key}


class CutError(Exception):
    """The process ends."""


def cut_after(monkeypatch, uploads: int) -> None:
    """End a run at an upload of a unit."""
    upload, left = Storage.upload, [uploads]

    def counted(self, files):
        if any(name.endswith(".unit") for name in files):
            left[0] -= 1
            if left[0] < 0:
                raise CutError
        upload(self, files)

    monkeypatch.setattr(Storage, "upload", counted)


def test_an_interrupted_run_goes_on_on_another_machine(own_card, bucket, tmp_path, monkeypatch, work):
    with monkeypatch.context() as patched:
        cut_after(patched, 1)
        with pytest.raises(CutError):
            score_there(own_card)
    assert "runs/one/summary.json" not in bucket.names()
    assert units_at(bucket) == ONE
    assert work(score_there(own_card, machine=tmp_path / "other", monkeypatch=monkeypatch)) == (ALL - ONE, ONE)
    score(own_card, tmp_path / "run")
    assert bytes_of(downloaded_run(parse_location(URL))) == bytes_of(tmp_path / "run")


def test_units_that_were_not_uploaded_are_by_the_next_run(own_card, bucket, monkeypatch, work):
    with monkeypatch.context() as patched:
        cut_after(patched, 1)
        with pytest.raises(CutError):
            score_there(own_card)
    assert work(score_there(own_card)) == (ONE, ALL - ONE), "the second was stored on this machine"
    assert units_at(bucket) == ALL


@pytest.mark.parametrize("damage", ["cut", "other", "gone"])
def test_a_damaged_unit_at_the_address_is_computed_and_stored_again(
    own_card, bucket, tmp_path, monkeypatch, work, damage
):
    score_there(own_card)
    stored = {key: bucket.get(key) for key in bucket.names("runs/one/units/")}
    (key,) = (key for key in stored if key.startswith("runs/one/units/crossing"))
    if damage == "gone":
        bucket.remove(key)
    else:
        bucket.put(key, stored[key][:-9] if damage == "cut" else b"x" * len(stored[key]))
    assert work(score_there(own_card, machine=tmp_path / "other", monkeypatch=monkeypatch)) == (ONE, ALL - ONE)
    assert {key: bucket.get(key) for key in bucket.names("runs/one/units/")} == stored


def test_a_unit_that_another_one_of_the_same_size_replaced_is_not_taken_for_it(own_card, bucket, work):
    """This machine has the former one; the storage counts."""
    score_there(own_card)
    (key,) = (key for key in bucket.names() if key.startswith("runs/one/units/crossing"))
    whole = bucket.get(key)
    bucket.put(key, whole[:-100] + b"x" * 100)
    assert work(score_there(own_card)) == (ONE, ALL - ONE)
    assert bucket.get(key) == whole


def test_a_unit_that_was_removed_at_the_address_is_stored_again_from_this_machine(own_card, bucket, work):
    score_there(own_card)
    (key,) = (key for key in bucket.names() if key.startswith("runs/one/units/crossing"))
    whole = bucket.get(key)
    bucket.remove(key)
    assert work(score_there(own_card)) == (NONE, ALL)
    assert bucket.get(key) == whole


def test_a_part_leaves_the_results_of_an_older_run(own_card, bucket):
    score_there(own_card)
    before = results_at(bucket)
    remote = RemoteRun(url=parse_location(URL))
    options = {"method": build_method("nothing"), "protocol": PAPER, "out": remote.folder, "mirror": remote}
    run_shard([RunRequest(card=load_card(str(own_card)), **options)], Shard(number=1, count=2))
    assert results_at(bucket) == before


def test_a_local_unit_of_the_same_size_is_not_taken_for_the_one_at_the_address(own_card, bucket, work):
    score_there(own_card)
    remote = RemoteRun(url=parse_location(URL))
    (file,) = (remote.folder / "units").glob("crossing*.unit")
    file.write_bytes(file.read_bytes()[:-100] + b"x" * 100)
    assert work(score_there(own_card)) == (NONE, ALL)


def test_units_of_another_data_set_do_not_stay_and_a_failed_run_leaves_the_results(own_card, bucket):
    score_there(own_card)
    bucket.put("runs/one/index.html", b"<p>of an older version</p>")
    bucket.put("runs/one/units/former-front-00000000.unit", b"{}")
    bucket.put("runs/one/shards/0001-of-0007.json", b"{}")
    score_there(own_card)
    assert not [key for key in bucket.names() if "former" in key or "0007" in key]
    for file in own_card.parent.glob("data/tiny/*/recording.json"):
        file.unlink()
    before = results_at(bucket)
    assert "runs/one/index.html" not in before
    assert "runs/one/summary.json" in before
    with pytest.raises(DataError):
        score_there(own_card)
    assert results_at(bucket) == before


def test_another_experiment_at_the_address_is_refused(own_card, bucket, tmp_path, monkeypatch):
    score_there(own_card)
    before = {key: bucket.get(key) for key in bucket.names()}
    with pytest.raises(DataError, match="a run with method 'nothing'"):
        score_there(own_card, method="everything", machine=tmp_path / "other", monkeypatch=monkeypatch)
    assert {key: bucket.get(key) for key in bucket.names()} == before
    score_there(own_card, method="everything", overwrite=True)
    assert b"everything" in bucket.get("runs/one/summary.json")


def test_other_objects_at_the_address_are_left_alone(own_card, bucket):
    bucket.put("runs/one/holiday.jpg", b"x")
    with pytest.raises(DataError, match=r"s3://bench/runs/one: expected an empty folder or an older run.*holiday.jpg"):
        score_there(own_card)
    assert bucket.names() == ["runs/one/holiday.jpg"]


def test_a_bucket_that_is_not_there_is_told_before_anything_is_computed(own_card, bucket, monkeypatch):
    monkeypatch.setattr("bench.harness.run.plan_recording", None)
    remote = RemoteRun(url=parse_location("s3://nobody/run"))
    with pytest.raises(DataError, match=r"s3://nobody/run: expected a folder that can be written.*check bucket"):
        score(own_card, remote.folder, mirror=remote)


def test_a_connection_that_breaks_names_what_is_done(own_card, bucket, monkeypatch, work):
    upload = Storage.upload

    def broken(self, files):
        if any(name.endswith(".unit") for name in files):
            raise DataError(self.url.text, expected="a folder that can be written", got="no answer")
        upload(self, files)

    with monkeypatch.context() as patched:
        patched.setattr(Storage, "upload", broken)
        with pytest.raises(DataError, match=r"no answer; what is done is in .*the same command goes on"):
            score_there(own_card)
    assert work(score_there(own_card)) == (ALL - ONE, ONE)


def test_parts_of_two_machines_merge_at_the_address(own_card, bucket, tmp_path, monkeypatch):
    score(own_card, tmp_path / "run")
    for number in (1, 2):
        monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / f"machine-{number}"))
        remote = RemoteRun(url=parse_location(URL))
        options = {"method": build_method("nothing"), "protocol": PAPER}
        run_shard(
            [RunRequest(card=load_card(str(own_card)), out=remote.folder, mirror=remote, **options)],
            Shard(number=number, count=2),
        )
    monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / "third"))
    remote = RemoteRun(url=parse_location(URL))
    remote.download_parts(write=True)
    merge_shards(remote.folder, [remote.folder])
    for unit in merged_units([remote.folder]):
        remote.upload_unit(unit)
    remote.upload_results()
    assert bytes_of(downloaded_run(parse_location(URL))) == bytes_of(tmp_path / "run")


def test_a_former_report_of_a_part_on_this_machine_does_not_replace_the_one_at_the_address(bucket):
    bucket.put(f"runs/one/{MARK}", b"")
    bucket.put("runs/one/shards/0001-of-0002.json", b"of another machine")
    remote = RemoteRun(url=parse_location(URL))
    report = remote.folder / "shards" / "0001-of-0002.json"
    report.parent.mkdir(parents=True)
    report.write_bytes(b"former")
    remote.begin(parts=2)
    remote.upload_results()
    assert bucket.get("runs/one/shards/0001-of-0002.json") == b"of another machine"
    RemoteRun(url=parse_location(URL)).download_parts(write=False)
    assert report.read_bytes() == b"of another machine"


def test_hostile_names_at_the_address_write_nothing_outside(own_card, bucket, tmp_path):
    bucket.put(f"runs/one/{MARK}", b"")
    bucket.put("runs/one/shards/../../../evil.json", b"{}")
    with pytest.raises(DataError, match="names of objects that can be files"):
        RemoteRun(url=parse_location(URL)).download_parts(write=True)
    assert not list(tmp_path.rglob("evil*"))
