"""A run in one file: packed, sent, unpacked, verified and listed; foreign ones are looked at first."""

import shutil
from copy import copy
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import pytest

from bench.errors import DataError
from bench.exchange.bundle import FILES, is_bundle, unpack_bundle, write_bundle
from bench.harness import read_run
from tests.support.commands import call, error_line


@pytest.fixture(scope="module")
def run(tiny_card, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("bundled") / "run"
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert call(monkeypatch, "run", tiny_card, "--method", "nothing", "--out", out, "--no-pictures") == 0
    return out


@pytest.fixture(scope="module")
def bundle(run) -> Path:
    file = run.parent / "sent.run.zip"
    write_bundle(run, file)
    return file


def test_a_run_is_sent_unpacked_verified_and_listed(run, tmp_path, monkeypatch, capsys):
    file, out = tmp_path / "sent.run.zip", tmp_path / "runs" / "theirs"
    assert call(monkeypatch, "verify", run) == 0
    assert call(monkeypatch, "bundle", run, "--out", file) == 0
    out.parent.mkdir()
    shutil.copy(file, tmp_path / "runs" / "theirs.run.zip")
    assert call(monkeypatch, "leaderboard", tmp_path / "runs") == 2
    unpack = f"fisheye-bench unbundle {out}.run.zip --out {out}"
    assert (
        f"expected at least one run, got no summary.json at any depth; unpack it: {unpack}" in capsys.readouterr().err
    )
    shutil.copytree(run, tmp_path / "runs" / "mine")
    assert call(monkeypatch, "leaderboard", tmp_path / "runs") == 0
    assert f"theirs.run.zip is a run in one file; unpack it: {unpack}" in "".join(capsys.readouterr().out.split("\n"))
    shutil.rmtree(tmp_path / "runs" / "mine")
    assert call(monkeypatch, "unbundle", file, "--out", out) == 0
    assert "nothing of it is verified yet" in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    assert names == FILES | {"files.json"}, "neither the mark nor the cost comes along"
    assert all((out / name).read_bytes() == (run / name).read_bytes() for name in FILES)
    assert call(monkeypatch, "leaderboard", tmp_path / "runs") == 0
    assert ", verified" not in capsys.readouterr().out
    assert call(monkeypatch, "verify", out) == 0
    assert call(monkeypatch, "leaderboard", tmp_path / "runs") == 0
    assert "nothing, verified" in capsys.readouterr().out


def test_the_same_run_gives_the_same_file(run, bundle, tmp_path):
    write_bundle(run, tmp_path / "again.run.zip")
    assert (tmp_path / "again.run.zip").read_bytes() == bundle.read_bytes()


def test_a_run_that_lacks_a_table_is_not_packed(run, tmp_path):
    copied = shutil.copytree(run, tmp_path / "run")
    (copied / "masks.parquet").unlink()
    with pytest.raises(DataError, match=r"masks\.parquet: expected a file of the run, got no such file"):
        write_bundle(copied, tmp_path / "out.run.zip")
    assert not (tmp_path / "out.run.zip").exists()


def test_a_folder_that_holds_something_stays_as_it_is(bundle, tmp_path, monkeypatch, capsys):
    (tmp_path / "mine").write_text("mine")
    line = error_line(monkeypatch, capsys, "unbundle", bundle, "--out", tmp_path)
    assert "expected a new or an empty folder" in line
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def repacked(bundle: Path, out: Path, change, *, compression: int = ZIP_STORED) -> Path:
    """The bundle with other content: a function of all files by name."""
    with ZipFile(bundle) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files = change(files) or files
    with ZipFile(out, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(ZipInfo(name) if compression == ZIP_STORED else name, content)
    return out


def renamed(old: str, new: str):
    def changed(files) -> None:
        files[new] = files.pop(old)

    return changed


def without(name: str):
    def changed(files) -> None:
        del files[name]

    return changed


def other_content(name: str):
    def changed(files) -> None:
        files[name] = files[name][:-1] + b"x"

    return changed


def of_another_manifest(files) -> None:
    files["manifest.json"] = files["summary.json"]


ONE_OF = "expected each of these at most once: .*objects.parquet"
CHANGES = {
    "a file more": (lambda files: files.update(mine=b"x"), f"mine: {ONE_OF}"),
    "a file less": (without("sums.csv"), "sums.csv: expected a file of the run, got no such file"),
    "no summary": (without("summary.json"), "summary.json: expected the summary of a run"),
    "no manifest": (without("manifest.json"), "manifest.json: expected the manifest of a run, got no such file"),
    "no protocol": (without("protocol.json"), "protocol.json: expected the protocol of a run, got no such file"),
    "other tables": (other_content("objects.parquet"), "objects.parquet: expected the file that summary.json is of"),
    "another summary": (other_content("summary.json"), "summary.json: expected the summary of a run"),
    "another manifest": (of_another_manifest, "manifest.json"),
    "a place outside": (renamed("sums.csv", "../sums.csv"), ONE_OF),
    "an absolute place": (renamed("sums.csv", "/tmp/sums.csv"), ONE_OF),
    "a mark": (renamed("sums.csv", "verified.json"), ONE_OF),
    "a program": (renamed("sums.csv", "method.py"), ONE_OF),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_bundle_that_was_changed_is_refused_and_nothing_stays(bundle, tmp_path, name):
    change, message = CHANGES[name]
    file = repacked(bundle, tmp_path / "sent.run.zip", change)
    with pytest.raises(DataError, match=message):
        unpack_bundle(file, tmp_path / "out")
    assert [*tmp_path.iterdir()] == [file]


def test_a_file_that_stands_twice_and_files_larger_than_the_bundle_are_refused(bundle, tmp_path):
    """Entries of an archive may share their bytes, so that a small one unpacks to many times its size."""
    twice = shutil.copy(bundle, tmp_path / "twice.run.zip")
    with ZipFile(twice, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr(ZipInfo("sums.csv"), b"x")
    with pytest.raises(DataError, match="one that stands twice"):
        unpack_bundle(twice, tmp_path / "out")
    shared = tmp_path / "shared.run.zip"
    with ZipFile(shared, "w") as archive:
        archive.writestr(ZipInfo("objects.parquet"), bytes(100_000))
        (entry,) = archive.filelist
        archive.filelist += [copy_of(entry, name) for name in sorted(FILES - {entry.filename})]
    with pytest.raises(DataError, match=r"expected files of at most \d+ bytes, its own size, got 800000 bytes"):
        unpack_bundle(shared, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def copy_of(entry: ZipInfo, name: str) -> ZipInfo:
    """An entry of another name for the same bytes."""
    other = copy(entry)
    other.filename = name
    return other


def test_a_compressed_or_cut_bundle_and_what_is_none_are_refused(bundle, tmp_path):
    packed = repacked(bundle, tmp_path / "packed.run.zip", lambda _: None, compression=ZIP_DEFLATED)
    cut = tmp_path / "cut.run.zip"
    cut.write_bytes(bundle.read_bytes()[: bundle.stat().st_size // 2])
    text = tmp_path / "text.run.zip"
    text.write_text("text")
    for file, message in (
        (packed, "expected a file without compression"),
        (cut, "expected the bundle of a run"),
        (text, "expected the bundle of a run"),
        (tmp_path, "expected the bundle of a run"),
        (tmp_path / "missing", "expected the bundle of a run"),
    ):
        assert is_bundle(file) == (file == packed)
        with pytest.raises(DataError, match=message):
            unpack_bundle(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_sent_run_is_a_run(bundle, run, tmp_path):
    sent, unpacked = read_run(run), unpack_bundle(bundle, tmp_path / "out")
    assert (unpacked.folder, unpacked.label) == (tmp_path / "out", "out")
    for found in (unpacked, read_run(tmp_path / "out")):
        assert (found.manifest, found.summary, found.protocol) == (sent.manifest, sent.summary, sent.protocol)
