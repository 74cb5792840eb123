"""Local copies: downloaded once, and again when the storage has something else."""

import errno
import os
import signal
import time
from multiprocessing import get_context
from pathlib import Path

import pytest

from bench.errors import DataError
from bench.recordings import object_storage
from bench.recordings.object_storage import StoredObject, local_copy, parse_location

pytestmark = pytest.mark.slow

FILES = {"a/1.png": b"one", "a/deep/2.png": b"second", "b/1.png": b"other", "top.yaml": b"rig"}
URL = parse_location("s3://bench/drives")


@pytest.fixture
def drives(bucket):
    for name, content in FILES.items():
        bucket.put(f"drives/{name}", content)


def content(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_a_copy_has_the_name_and_the_files_of_the_remote_folder(drives):
    copy = local_copy(URL)
    assert copy.name == "drives"
    assert content(copy) == FILES


def test_only_the_wanted_part_is_downloaded(drives, fetched):
    copy = local_copy(URL, ("a", "top.yaml"))
    assert sorted(fetched) == ["a/1.png", "a/deep/2.png", "top.yaml"] == sorted(content(copy))
    assert sorted(content(local_copy(URL, ("b",)))) == ["b/1.png"]


def test_what_did_not_change_is_not_downloaded_again(drives, fetched):
    first = local_copy(URL)
    del fetched[:]
    assert local_copy(URL) == first
    assert fetched == []


def test_a_copy_follows_changed_and_removed_objects_alone(drives, bucket, fetched):
    copy = local_copy(URL)
    del fetched[:]
    bucket.put("drives/a/1.png", b"ONE")  # as long as before
    bucket.remove("drives/b/1.png")
    bucket.remove("drives/top.yaml")
    bucket.put("drives/b", b"a file")
    bucket.put("drives/top.yaml/x", b"a folder")
    assert local_copy(URL) == copy
    assert sorted(fetched) == ["a/1.png", "b", "top.yaml/x"]
    expected = {"a/1.png": b"ONE", "a/deep/2.png": b"second", "b": b"a file", "top.yaml/x": b"a folder"}
    assert content(copy) == expected


def test_local_files_that_were_removed_or_changed_are_downloaded_again(drives, fetched):
    copy = local_copy(URL)
    (copy / "a" / "1.png").unlink()
    (copy / "b" / "1.png").write_bytes(b"c")
    (copy / "a" / "deep" / "2.png").write_bytes(b"sedond")  # as long as before
    (copy / "a" / "strange.png").write_bytes(b"x")
    del fetched[:]
    assert content(local_copy(URL)) == FILES
    assert sorted(fetched) == ["a/1.png", "a/deep/2.png", "b/1.png"]


@pytest.mark.parametrize("damage", [b"", b"{", b"[]", b'{"a/1.png": 3, "b/1.png": ["x"]}', b"\xff\xfe"])
def test_a_copy_whose_index_is_damaged_is_downloaded_again(drives, fetched, damage):
    copy = local_copy(URL)
    (copy.parent / object_storage.INDEX).write_bytes(damage)
    del fetched[:]
    assert content(local_copy(URL)) == FILES
    assert sorted(fetched) == sorted(FILES)


def test_an_interrupted_download_goes_on(drives, fetched, monkeypatch):
    monkeypatch.setattr(object_storage, "BATCH_FILES", 1)
    noted = object_storage.download

    def interrupted(url, files):
        noted(url, files)
        if len(fetched) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(object_storage, "download", interrupted)
    with pytest.raises(KeyboardInterrupt):
        local_copy(URL)
    monkeypatch.setattr(object_storage, "download", noted)
    assert content(local_copy(URL)) == FILES
    assert len(fetched) == 3 + 2, "two were whole before"


def _download_slowly(folder: Path) -> None:
    object_storage.BATCH_FILES = 1
    download = object_storage.download

    def slowly(url, files):
        download(url, files)
        time.sleep(0.5 if list(folder.rglob("*.png")) else 0.0)

    object_storage.download = slowly
    local_copy(URL)


def test_a_process_killed_while_it_downloads_leaves_what_the_next_one_uses(tmp_path, drives, fetched):
    process = get_context("spawn").Process(target=_download_slowly, args=(tmp_path / "remote",))
    process.start()
    end = time.monotonic() + 60
    while len(list((tmp_path / "remote").rglob("*.png"))) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert content(local_copy(URL)) == FILES
    assert 0 < len(fetched) < len(FILES)


def _download(log: Path) -> None:
    download = object_storage.download

    def noted(url, files):
        with log.open("a") as lines:
            lines.writelines(f"{name}\n" for name in files)
        download(url, files)

    object_storage.download = noted
    assert content(local_copy(URL)) == FILES


def test_processes_that_want_the_same_download_it_once(tmp_path, drives):
    context = get_context("spawn")
    started = [context.Process(target=_download, args=(tmp_path / "log",)) for _ in range(3)]
    for process in started:
        process.start()
    for process in started:
        process.join()
    assert [process.exitcode for process in started] == [0, 0, 0]
    assert sorted((tmp_path / "log").read_text().split()) == sorted(FILES)


def test_an_object_that_comes_shorter_than_listed_is_refused(drives, monkeypatch):
    download = object_storage.download

    def cut(url, files):
        download(url, files)
        files["a/deep/2.png"].write_bytes(b"sec")

    with monkeypatch.context() as patched:
        patched.setattr(object_storage, "download", cut)
        with pytest.raises(DataError, match=r"a/deep/2.png: expected 6 bytes, as listed, got 3"):
            local_copy(URL)
    assert content(local_copy(URL)) == FILES


def test_objects_that_change_while_they_are_downloaded_are_refused(drives, bucket, monkeypatch):
    download = object_storage.download

    def meddle(url, files):
        download(url, files)
        bucket.put("drives/a/1.png", b"two")

    monkeypatch.setattr(object_storage, "download", meddle)
    with pytest.raises(DataError, match="stay the same while they are downloaded"):
        local_copy(URL)
    monkeypatch.setattr(object_storage, "download", download)
    assert content(local_copy(URL)) == FILES | {"a/1.png": b"two"}


@pytest.mark.parametrize("key", ["drives/../../outside", "drives//etc/x", "drives/a/1.png/b", "drives/a\\b"])
def test_hostile_names_write_nothing(tmp_path, drives, bucket, fetched, key):
    bucket.put(key, b"evil")
    with pytest.raises(DataError, match="s3://bench/drives: expected"):
        local_copy(URL)
    assert fetched == []
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_folders_without_content_are_no_files(drives, bucket):
    bucket.put("drives/empty/", b"")
    assert content(local_copy(URL)) == FILES


def test_an_empty_place_is_told(drives):
    with pytest.raises(DataError, match="s3://bench/nowhere: expected a folder with data, got nothing there"):
        local_copy(parse_location("s3://bench/nowhere"))


def test_a_full_disk_and_a_folder_that_cannot_be_made_are_told(tmp_path, drives, monkeypatch):
    def full(self, files):
        raise OSError(errno.ENOSPC, "No space left on device", "x")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", full)
        with pytest.raises(DataError, match=r"No space left on device; free some disk space"):
            local_copy(URL)
    (tmp_path / "file").touch()
    monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path / "file"))
    with pytest.raises(
        DataError, match=r"expected a local folder with space for s3://bench/drives.*FISHEYE_BENCH_REMOTE"
    ):
        local_copy(URL)


def test_a_storage_without_versions_is_downloaded_every_time(drives, fetched, monkeypatch):
    listed = object_storage.list_objects

    def mute(url, parts=()):
        return {name: StoredObject(told.size_bytes, "") for name, told in listed(url, parts).items()}

    monkeypatch.setattr(object_storage, "list_objects", mute)
    assert content(local_copy(URL)) == content(local_copy(URL)) == FILES
    assert len(fetched) == 2 * len(FILES)


def test_other_protocols_of_fsspec_serve(tmp_path, monkeypatch):
    import fsspec

    monkeypatch.setenv("FISHEYE_BENCH_REMOTE", str(tmp_path))
    memory = fsspec.filesystem("memory")
    for name, told in FILES.items():
        memory.pipe(f"/shelf/drives/{name}", told)
    url = parse_location("memory://shelf/drives")
    assert content(local_copy(url)) == FILES
    memory.pipe("/shelf/drives/a/1.png", b"ONE")
    assert content(local_copy(url)) == FILES | {"a/1.png": b"ONE"}
    memory.rm("/shelf", recursive=True)
