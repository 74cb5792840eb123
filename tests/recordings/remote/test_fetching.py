"""Local copies: whole or not there, fetched once, fetched again when the storage has something else."""

import errno
import os
import signal
import time
from multiprocessing import get_context
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.recordings.atomic import alone_in
from bench.recordings.remote import FetchedData, Part, Storage, StoredObject, fetching, parse_place
from bench.recordings.remote.copies import Copies, let_go
from bench.recordings.remote.fetching import limit_from_environment

pytestmark = pytest.mark.slow

FILES = {"a/1.png": b"one", "a/deep/2.png": b"second", "b/1.png": b"other", "top.yaml": b"rig"}


@pytest.fixture
def url(bucket):
    for name, content in FILES.items():
        bucket.put(f"drives/{name}", content)
    return parse_place("s3://bench/drives")


def data(tmp_path: Path, limit_bytes: int = 10**9) -> FetchedData:
    return FetchedData(folder=tmp_path / "copies", limit_bytes=limit_bytes)


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_copy_has_the_name_and_the_files_of_the_remote_folder(tmp_path, url):
    copy = data(tmp_path).fetch(url)
    assert copy.name == "drives"
    assert content(copy) == FILES


def test_only_the_wanted_part_is_fetched(tmp_path, url, fetched):
    copy = data(tmp_path).fetch(url, Part(names=("a", "top.yaml")))
    assert sorted(fetched) == ["a/1.png", "a/deep/2.png", "top.yaml"] == sorted(content(copy))
    assert sorted(content(data(tmp_path).fetch(url, Part(without=("a",))))) == ["b/1.png", "top.yaml"]


def test_what_did_not_change_is_not_fetched_again(tmp_path, url, fetched):
    first = data(tmp_path).fetch(url)
    del fetched[:]
    assert data(tmp_path).fetch(url) == first
    assert fetched == []


def test_a_changed_object_alone_is_fetched_again_and_the_open_copy_stays(tmp_path, url, bucket, fetched):
    first = data(tmp_path).fetch(url)
    del fetched[:]
    bucket.put("drives/a/1.png", b"ONE")  # as long as before
    bucket.remove("drives/b/1.png")
    second = data(tmp_path).fetch(url)
    assert fetched == ["a/1.png"]
    assert content(first) == FILES
    assert content(second) == {name: told for name, told in (FILES | {"a/1.png": b"ONE"}).items() if name != "b/1.png"}
    let_go(first.parent)
    assert data(tmp_path).fetch(url) == second
    assert not first.exists(), "nobody has the former copy open"


def test_a_file_that_was_removed_from_a_copy_is_fetched_again(tmp_path, url, fetched):
    copy = data(tmp_path).fetch(url)
    (copy / "a" / "1.png").unlink()
    (copy / "b" / "1.png").write_bytes(b"cut"[:1])
    del fetched[:]
    assert content(data(tmp_path).fetch(url)) == FILES
    assert sorted(fetched) == ["a/1.png", "b/1.png"]


@pytest.mark.parametrize("times", ["told", "hidden"])
def test_a_file_of_a_copy_that_changed_by_one_byte_is_fetched_again(tmp_path, url, fetched, times):
    """Its size is as before, and its time of change too if somebody put that back."""
    copy = data(tmp_path).fetch(url)
    file = copy / "a" / "deep" / "2.png"
    before = file.stat()
    file.write_bytes(b"sedond")
    if times == "hidden":
        os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    del fetched[:]
    assert content(data(tmp_path).fetch(url)) == FILES
    assert fetched == ["a/deep/2.png"]


def test_what_changed_in_a_former_copy_is_not_taken_over(tmp_path, url, bucket, fetched):
    first = data(tmp_path).fetch(url)
    (first / "b" / "1.png").write_bytes(b"OTHER")
    bucket.put("drives/a/1.png", b"ONE")
    del fetched[:]
    assert content(data(tmp_path).fetch(url)) == FILES | {"a/1.png": b"ONE"}
    assert sorted(fetched) == ["a/1.png", "b/1.png"]


def test_what_changed_in_a_partial_copy_is_fetched_again(tmp_path, url, fetched, monkeypatch):
    monkeypatch.setattr(fetching, "BATCH_FILES", 1)
    noted = Storage.download

    def interrupted(self, files):
        if len(fetched) == 3:
            raise KeyboardInterrupt
        noted(self, files)

    monkeypatch.setattr(Storage, "download", interrupted)
    with pytest.raises(KeyboardInterrupt):
        data(tmp_path).fetch(url)
    (changed,) = (tmp_path / "copies").rglob("partial-*/**/2.png")
    changed.write_bytes(b"sedond")
    del fetched[:]
    monkeypatch.setattr(Storage, "download", noted)
    assert content(data(tmp_path).fetch(url)) == FILES
    assert sorted(fetched) == ["a/deep/2.png", "top.yaml"]


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"objects": {"a/1.png": [3, "x"]}}', b"\xff\xfe"])
@pytest.mark.parametrize("noted", [True, False])
def test_a_copy_whose_index_is_damaged_is_compared_with_the_notes_of_its_fetch(tmp_path, url, fetched, damage, noted):
    copy = data(tmp_path).fetch(url)
    copy.parent.with_suffix(".json").write_bytes(damage)
    (copy / "a" / "1.png").write_bytes(b"eno")
    if not noted:
        (copy.parent / fetching.FETCHED).write_bytes(damage)
    del fetched[:]
    assert content(data(tmp_path).fetch(url)) == FILES
    assert sorted(fetched) == (["a/1.png"] if noted else sorted(FILES))


def test_an_interrupted_fetch_is_not_taken_for_whole_and_goes_on(tmp_path, url, fetched, monkeypatch):
    monkeypatch.setattr(fetching, "BATCH_FILES", 1)
    noted = Storage.download

    def interrupted(self, files):
        noted(self, files)
        if len(fetched) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(Storage, "download", interrupted)
    with pytest.raises(KeyboardInterrupt):
        data(tmp_path).fetch(url)
    assert not list((tmp_path / "copies").glob("*/*.json"))
    monkeypatch.setattr(Storage, "download", noted)
    assert content(data(tmp_path).fetch(url)) == FILES
    assert len(fetched) == 3 + 2, "two were whole before"


def _fetch_slowly(folder: Path) -> None:
    fetching.BATCH_FILES = 1
    download = Storage.download

    def slowly(self, files):
        download(self, files)
        time.sleep(0.5 if list(folder.rglob("*.png")) else 0.0)

    Storage.download = slowly
    FetchedData(folder=folder, limit_bytes=10**9).fetch(parse_place("s3://bench/drives"))


def test_a_process_killed_while_it_fetches_leaves_what_the_next_one_uses(tmp_path, url, fetched):
    process = get_context("spawn").Process(target=_fetch_slowly, args=(tmp_path / "copies",))
    process.start()
    end = time.monotonic() + 60
    while len(list((tmp_path / "copies").rglob("*.png"))) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not list((tmp_path / "copies").glob("*/*.json"))
    assert content(data(tmp_path).fetch(url)) == FILES
    assert 0 < len(fetched) < len(FILES)


def _fetch(folder: Path, log: Path) -> None:
    download = Storage.download

    def noted(self, files):
        with log.open("a") as lines:
            lines.writelines(f"{name}\n" for name in files)
        download(self, files)

    Storage.download = noted
    copy = FetchedData(folder=folder, limit_bytes=10**9).fetch(parse_place("s3://bench/drives"))
    assert content(copy) == FILES


def test_processes_that_want_the_same_fetch_it_once(tmp_path, url):
    context = get_context("spawn")
    started = [context.Process(target=_fetch, args=(tmp_path / "copies", tmp_path / "log")) for _ in range(3)]
    for process in started:
        process.start()
    for process in started:
        process.join()
    assert [process.exitcode for process in started] == [0, 0, 0]
    assert sorted((tmp_path / "log").read_text().split()) == sorted(FILES)


def test_an_object_that_comes_shorter_than_listed_is_refused(tmp_path, url, monkeypatch):
    download = Storage.download

    def cut(self, files):
        download(self, files)
        files["a/deep/2.png"].write_bytes(b"sec")

    monkeypatch.setattr(Storage, "download", cut)
    with pytest.raises(DataError, match=r"a/deep/2.png: expected 6 bytes, as listed, got 3"):
        data(tmp_path).fetch(url)
    assert not list((tmp_path / "copies").glob("*/*.json"))


def test_objects_that_change_while_they_are_fetched_are_refused(tmp_path, url, bucket, monkeypatch):
    download = Storage.download

    def meddle(self, files):
        download(self, files)
        bucket.put("drives/a/1.png", b"two")

    monkeypatch.setattr(Storage, "download", meddle)
    with pytest.raises(DataError, match="stay the same while they are fetched"):
        data(tmp_path).fetch(url)
    monkeypatch.setattr(Storage, "download", download)
    assert content(data(tmp_path).fetch(url)) == FILES | {"a/1.png": b"two"}


@pytest.mark.parametrize("key", ["drives/../../outside", "drives//etc/x", "drives/a/1.png/b", "drives/a\\b"])
def test_hostile_names_write_nothing(tmp_path, url, bucket, fetched, key):
    bucket.put(key, b"evil")
    with pytest.raises(DataError, match="s3://bench/drives: expected"):
        data(tmp_path).fetch(url)
    assert fetched == []
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_folders_without_content_are_no_files(tmp_path, url, bucket):
    bucket.put("drives/empty/", b"")
    assert content(data(tmp_path).fetch(url)) == FILES


def test_an_empty_place_is_told(tmp_path, url):
    with pytest.raises(DataError, match="s3://bench/nowhere: expected a folder with data, got nothing there"):
        data(tmp_path).fetch(parse_place("s3://bench/nowhere"))


@pytest.fixture
def three(bucket):
    """Three folders of 1000 bytes each."""
    for name in "pqr":
        bucket.put(f"many/{name}/x", name.encode() * 1000)
    return lambda name: (parse_place("s3://bench/many"), Part(names=(name,)))


def test_what_was_not_used_for_longest_goes_first(tmp_path, three):
    small = data(tmp_path, 2500)
    copies = {name: small.fetch(*three(name)) for name in "pq"}
    for name, used_s in {"p": 2e9, "q": 1e9}.items():
        os.utime(copies[name].parent, (used_s, used_s))
        let_go(copies[name].parent)
    copies["r"] = small.fetch(*three("r"))
    assert [copies[name].exists() for name in "pqr"] == [True, False, True]
    assert Copies(small.folder).use().size_bytes == 2000


def test_a_copy_that_another_process_has_open_stays(tmp_path, three):
    small = data(tmp_path, 1500)
    first = small.fetch(*three("p"))
    let_go(first.parent)
    with alone_in(first.parent, shared=True):
        second = small.fetch(*three("q"))
        assert (first.exists(), second.exists()) == (True, True)
    third = small.fetch(*three("r"))
    assert (first.exists(), third.exists()) == (False, True)


def test_a_process_gives_up_what_it_opened_longest_ago_for_room(tmp_path, three):
    small = data(tmp_path, 2500)
    copies = [small.fetch(*three(name)) for name in "pqr"]
    assert [copy.exists() for copy in copies] == [False, True, True]


def test_more_than_the_limit_is_refused(tmp_path, three):
    with pytest.raises(DataError, match=r"expected room for 0.0 MB for s3://bench/many, got less by its limit"):
        data(tmp_path, 999).fetch(*three("p"))


def test_a_full_disk_is_told_before_and_while_fetching(tmp_path, three, monkeypatch):
    usage = fetching.shutil.disk_usage(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(fetching.shutil, "disk_usage", lambda _: usage._replace(free=10))
        with pytest.raises(DataError, match=r"expected room for 0.0 MB .* make room"):
            data(tmp_path).fetch(*three("p"))

    def full(self, files):
        raise OSError(errno.ENOSPC, "No space left on device", "x")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(DataError, match=r"No space left on device; make room"):
        data(tmp_path).fetch(*three("p"))


@pytest.mark.parametrize("told", ["0", "-1", "many", "nan", "inf"])
def test_a_limit_that_is_none_is_refused(monkeypatch, told):
    monkeypatch.setenv("FISHEYE_BENCH_REMOTE_GB", told)
    with pytest.raises(UsageError, match="FISHEYE_BENCH_REMOTE_GB: expected a positive number"):
        limit_from_environment()


def test_a_storage_without_versions_is_fetched_every_time(tmp_path, url, fetched, monkeypatch):
    listed = Storage.objects

    def mute(self, below=""):
        return {
            name: StoredObject(size_bytes=told.size_bytes, version="") for name, told in listed(self, below).items()
        }

    monkeypatch.setattr(Storage, "objects", mute)
    first, second = data(tmp_path).fetch(url), data(tmp_path).fetch(url)
    assert first != second
    assert len(fetched) == 2 * len(FILES)


def test_other_protocols_of_fsspec_serve(tmp_path):
    import fsspec

    memory = fsspec.filesystem("memory")
    for name, told in FILES.items():
        memory.pipe(f"/shelf/drives/{name}", told)
    url = parse_place("memory://shelf/drives")
    assert content(data(tmp_path).fetch(url)) == FILES
    memory.pipe("/shelf/drives/a/1.png", b"ONE")
    assert content(data(tmp_path).fetch(url)) == FILES | {"a/1.png": b"ONE"}
    memory.rm("/shelf", recursive=True)
