"""Calls that cannot work: what the system gives is too little, or a name is not text."""

import json
import os
import re
import resource
import subprocess
import sys

import pytest

from bench.commands.app import LEAST_ADDRESSES_BYTES, user_message
from tests.support import tiny
from tests.support.commands import called_here

pytestmark = pytest.mark.slow

CARD = "name: x\ntitle: x\nadapter: native\nroot: data\nlicence: x\n"
NOT_TEXT = b"caf\xe9"


@pytest.fixture
def folder(tmp_path):
    tiny.write_recording(tmp_path / "data" / "drive")
    (tmp_path / "x.yaml").write_text(CARD)
    return tmp_path


def called(folder, *words, addresses_bytes=None):
    """Status and what was said, of a process of its own."""

    def limit():
        if addresses_bytes is not None:
            resource.setrlimit(resource.RLIMIT_AS, (addresses_bytes, addresses_bytes))

    done = subprocess.run(
        [sys.executable, "-m", "bench", *words], cwd=folder, capture_output=True, preexec_fn=limit, check=False
    )
    return done.returncode, done.stdout.decode(), done.stderr.decode()


def test_less_memory_than_libraries_need_is_told_before_they_are_loaded(folder):
    status, shown, told = called(folder, "validate", "x.yaml", addresses_bytes=300_000_000)
    assert (status, shown) == (2, "")
    assert told.startswith("error: ulimit -v: expected a limit of at least ")
    assert told.count("\n") == 1


def test_help_needs_less(folder):
    status, shown, told = called(folder, "run", "--help", addresses_bytes=200_000_000)
    assert (status, told) == (0, "")
    assert "--method" in shown


def test_the_least_memory_that_is_taken_is_enough(folder):
    words = ("run", "x.yaml", "--method", "nothing", "--no-pictures", "--workers", "2", "--out", "out", "--quiet")
    status, _, told = called(folder, *words, addresses_bytes=LEAST_ADDRESSES_BYTES)
    assert (status, told) == (0, "")


def of_chain():
    try:
        raise ImportError("libarrow.so: failed to map segment from shared object")
    except ImportError as error:
        raise ValueError("the 'schema' argument is not supported") from error


def no_memory():
    raise MemoryError


def no_thread():
    raise RuntimeError("can't start new thread")


def no_fork():
    raise OSError(12, os.strerror(12))


@pytest.mark.parametrize("lack", [of_chain, no_memory, no_thread, no_fork])
def test_a_library_that_gets_no_memory_is_told_in_one_line(lack):
    with pytest.raises(Exception) as raised:  # noqa: PT011 - of any kind
        lack()
    assert re.match(r"expected memory and threads, got [A-Z]\w+Error", user_message(raised.value))


def test_other_errors_stay_what_they_are():
    assert user_message(RuntimeError("a bug")) is None


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
