"""All code that is loaded with a method, and every file that it reads, is part of what its results depend on."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.harness.digests import MethodCode
from bench.methods import Method, build_method
from tests.support.processes import PATIENCE_S, until
from tests.support.troubled_runs import command, environment

pytestmark = pytest.mark.slow

FILES = {
    "plug/__init__.py": "",
    "plug/method.py": """
from importlib import import_module
from pathlib import Path

from bench.methods import Method
from elsewhere.bases import Base
from .sibling import LEVEL

import_module("plug.by_name")

class Bright(Base, Method):
    name = "bright"
    files = (Path(__file__).parents[1] / "weights", str(Path(__file__).parents[1] / "lens.txt"))

    def __init__(self):
        from lazily import factor

    def segment(self, frame):
        raise NotImplementedError
""",
    "plug/sibling.py": "from .deeper import LEVEL\n",
    "plug/deeper.py": "LEVEL = 100\n",
    "plug/by_name.py": "",
    "elsewhere/bases.py": "class Base:\n    pass\n",
    "lazily.py": "factor = 1\n",
    "unrelated.py": "",
    "weights/a/first.bin": "1",
    "weights/second.bin": "2",
    "lens.txt": "3",
}
PART = [name for name in FILES if name != "unrelated.py"]
PLACE = "plug.method:Bright"
UNHEARD_OF = "un" + "heard_of"  # a word in no module
TELL = f"""
import os, sys

from bench.harness.digests import MethodCode
from bench.methods import build_method

for folder in sys.stdin:
    if os.fork() == 0:
        sys.path.insert(0, folder.rstrip())
        print(MethodCode.of(build_method({PLACE!r})).digest, flush=True)
        os._exit(0)
    if os.wait()[1]:
        sys.exit("no digest")
"""


@pytest.fixture
def folder(tmp_path) -> Path:
    """A plug-in and what it needs."""
    for name, content in FILES.items():
        (tmp_path / "own" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "own" / name).write_text(content)
    return tmp_path / "own"


def with_path(folder: Path) -> dict[str, str]:
    inherited = environment()
    return inherited | {"PYTHONPATH": f"{folder}{os.pathsep}{inherited['PYTHONPATH']}"}


@pytest.fixture(scope="module")
def digest() -> Iterator[Callable[[Path], str]]:
    """The code as a new process takes it: one that has loaded this package, and nothing of the plug-in."""
    with subprocess.Popen(
        [sys.executable, "-c", TELL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment()
    ) as process:

        def told(folder: Path) -> str:
            process.stdin.write(f"{folder}\n")
            process.stdin.flush()
            found = process.stdout.readline()
            assert found, "its traceback is on stderr"
            return found

        yield told
        process.stdin.close()


def test_every_part_counts_and_nothing_else(folder, digest):
    before = digest(folder)
    assert digest(folder) == before
    for name in PART:
        (folder / name).write_text(FILES[name] + ("#" if name.endswith(".py") else "x"))
        assert digest(folder) != before, name
        (folder / name).write_text(FILES[name])
    (folder / "unrelated.py").write_text("changed = True\n")
    assert digest(folder) == before
    (folder / "weights" / "third.bin").touch()
    assert digest(folder) != before


def test_the_place_on_disk_does_not_count(folder, tmp_path, digest):
    before = digest(folder)
    assert digest(folder.rename(tmp_path / "moved")) == before


class Listing(Method):
    name = "listing"

    def __init__(self, files):
        self.files = files

    def settings(self):
        return {}

    def segment(self, frame):
        raise NotImplementedError


def test_files_that_are_no_list_of_paths_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"expected a sequence of paths, got 'weights\.bin'"):
        MethodCode.of(Listing("weights.bin"))
    with pytest.raises(UsageError, match="expected a file or folder, got no such path"):
        MethodCode.of(Listing([tmp_path / "missing.bin"]))


def test_settings_that_cannot_be_told_apart_are_refused():
    method = Listing([])
    method.settings = lambda: {"callable": object()}  # type: ignore[method-assign]
    with pytest.raises(
        UsageError, match=r"method 'listing' of class Listing: settings\(\): callable: expected finite numbers"
    ):
        MethodCode.of(method)


def test_what_changes_after_it_was_taken_is_refused(tmp_path):
    (tmp_path / "weights.bin").write_text("1")
    code = MethodCode.of(Listing([tmp_path / "weights.bin"]))
    code.refuse_change()
    state = (tmp_path / "weights.bin").stat()
    (tmp_path / "weights.bin").write_text("2")
    os.utime(tmp_path / "weights.bin", ns=(state.st_atime_ns, state.st_mtime_ns))
    with pytest.raises(DataError, match="got other content on disk; start the run again"):
        code.refuse_change()


def test_code_that_is_imported_after_it_was_taken_is_refused(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / f"{UNHEARD_OF}.py").write_text("")
    (tmp_path / "imported_later.py").write_text("")
    code = MethodCode.of(Listing([]))
    import_module(UNHEARD_OF)
    code.refuse_change()
    import_module("imported_later")
    for _ in range(2):
        with pytest.raises(DataError, match="got imported_later, which was imported later; import it at the top of a"):
            code.refuse_change()
    monkeypatch.delitem(sys.modules, "imported_later")


def test_versions_of_the_libraries_that_it_names_count(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    lines = [
        "from bench.methods import Method",
        "class Mine(Method):",
        "    name = 'mine'",
        "    def segment(self, frame): import yaml",
    ]
    (tmp_path / "names_a_library.py").write_text("\n".join(lines))
    code = MethodCode.of(build_method("names_a_library:Mine"))
    assert code.libraries == (("PyYAML", version("PyYAML")),)
    assert MethodCode.of(build_method("nothing")).libraries == ()


def test_code_that_was_typed_at_a_prompt_is_never_taken_for_another():
    tell = (
        "from bench.methods import Method\nclass Typed(Method):\n    name = 'typed'\n"
        "    def segment(self, frame): return None\n"
        "from bench.harness.digests import MethodCode; print(MethodCode.of(Typed()).digest)"
    )
    told = {
        subprocess.run(
            [sys.executable, "-c", tell], capture_output=True, text=True, env=environment(), check=True
        ).stdout
        for _ in range(2)
    }
    assert len(told) == 2


def test_methods_of_this_package_have_one_identity_each():
    assert MethodCode.of(build_method("nothing")).digest == MethodCode.of(build_method("nothing")).digest
    assert MethodCode.of(build_method("nothing")).digest != MethodCode.of(build_method("everything")).digest


SLOW = """
import time
from pathlib import Path

from bench.methods import Method, Segmentation
from slow_helper import LEVEL


class Slow(Method):
    name = "slow"

    def segment(self, frame):
        with Path(__file__).with_name("noted").open("a") as noted:
            noted.write("x")
        time.sleep(0.3)
        return Segmentation(cell_size_px=1, mask=frame.images[-1] > LEVEL)
"""


def test_editing_a_helper_while_a_run_goes_on_stores_nothing_under_the_new_code(tiny_card, tmp_path):
    own, out = tmp_path / "own", tmp_path / "run"
    own.mkdir()
    (own / "slow_method.py").write_text(SLOW)
    (own / "slow_helper.py").write_text("LEVEL = 100\n")
    words = [word if word != "troubled:Troubled" else "slow_method:Slow" for word in command(tiny_card, out)]
    words += ["--workers", "1"]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=with_path(own)
    ) as run:
        until((own / "noted").exists, "an image to be segmented")
        time.sleep(0.1)
        (own / "slow_helper.py").write_text("LEVEL = 200\n")
        told, _ = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 2, told
    assert "slow_helper.py: expected the file as it was when the run began" in told
    again = subprocess.run(words, capture_output=True, text=True, env=with_path(own), timeout=PATIENCE_S)
    assert again.returncode == 0, again.stdout + again.stderr
    assert "units computed 3, found done 0" in again.stdout
