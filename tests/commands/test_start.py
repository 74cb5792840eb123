"""Calls that cannot work: what the system gives is too little, or a name is not text."""

import errno
import json
import os

import pytest

from bench.commands.app import user_message
from tests.support import tiny
from tests.support.commands import called_here, error_line

CARD = "name: x\ntitle: x\nadapter: native\nroot: data\nlicence: x\n"
NOT_TEXT = b"caf\xe9"


@pytest.fixture
def folder(tmp_path):
    tiny.write_recording(tmp_path / "data" / "drive")
    (tmp_path / "x.yaml").write_text(CARD)
    return tmp_path


def test_a_lack_of_memory_is_told_in_one_line_and_a_bug_is_not():
    for lack in (MemoryError("12 GiB"), OSError(errno.ENOMEM, "no fork")):
        assert user_message(lack).startswith(f"expected memory and threads, got {type(lack).__name__}: ")
    assert user_message(RuntimeError("a bug")) is None


def test_an_argument_that_is_not_utf_8_is_told(monkeypatch, capsys):
    told = error_line(monkeypatch, capsys, "run", os.fsdecode(NOT_TEXT))
    assert "expected arguments in UTF-8, got 'caf\\udce9'; rename the file or folder" in told


def test_a_recording_whose_name_is_not_utf_8(folder):
    (folder / "data" / "drive").rename(folder / "data" / os.fsdecode(NOT_TEXT))
    for words in (("run", "x.yaml"), ("validate", "x.yaml")):
        done = called_here(*words, folder=folder)
        assert done.returncode == 2
        assert done.stderr == "error: data: expected recordings with names in UTF-8, got 'caf\\udce9'; rename it\n"


def test_a_file_whose_name_is_not_utf_8_is_told(folder):
    images = folder / "data" / "drive" / "images" / "front"
    (images / f"{tiny.TIMES_NS[1]}.png").rename(images / os.fsdecode(NOT_TEXT + b".png"))
    assert called_here("run", "x.yaml", "--out", "out", folder=folder).returncode == 2
    done = called_here("validate", "x.yaml", "--json", "told.json", folder=folder)
    assert (done.returncode, done.stderr) == (1, "")
    (recording,) = json.loads((folder / "told.json").read_text())["recordings"]
    files = [finding["file"] for finding in recording["findings"]]
    assert f"data/drive/images/front/{os.fsdecode(NOT_TEXT)}.png" in files
