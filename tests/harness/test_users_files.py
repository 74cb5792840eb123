"""Nothing that a run did not write is ever changed or removed, whatever lies in its folder or interrupts it."""

import json
import random
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from bench.atomic import temporary_name
from bench.errors import DataError
from bench.harness.manifest import MANIFEST
from bench.harness.run_folder import add_own_files, held_run_folder, new_results
from bench.harness.unit import Unit
from bench.harness.unit_files import UnitStore
from bench.recordings.checked_json import with_digest

TREES = 1000
UNIT = Unit(recording="drive", camera="front", start=1, stop=3)
NAMES = ("summary.json", "manifest.json", "files.json", "table.csv", "maps.npz", "objects.parquet", "index.html")
FOLDERS = (".", "units", "pictures", "pictures/crossing", "figures-a", "mine", ".run.new", ".results")


class KilledError(BaseException):
    """The process is no more."""


def written(place: Path) -> dict[str, bytes | str]:
    """Every file and link below a folder, with its content or target."""
    found = {}
    for path in place.rglob("*"):
        if path.is_symlink():
            found[path.relative_to(place).as_posix()] = str(path.readlink())
        elif path.is_file():
            found[path.relative_to(place).as_posix()] = path.read_bytes()
    return found


def add_of_user(draw: random.Random, run: Path, documents: Path) -> None:
    """Put some files, links and folders of a user into a folder, under names that the program did not take."""
    taken = str(written(run).get("files.json", ""))
    for _ in range(draw.choice((0, 1, 3))):
        folder = run / draw.choice(FOLDERS)
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            place = folder / draw.choice((*NAMES, "notes.txt"))
            if f'"{place.relative_to(run).as_posix()}"' in taken:
                continue
            kind = draw.random()
            if kind < 0.6:
                with place.open("x") as file:
                    file.write(f"mine {draw.random()}")
            elif kind < 0.8:
                place.symlink_to(documents / draw.choice(("thesis.txt", "units", "nothing")))
            elif folder != run and not folder.is_symlink() and not any(folder.iterdir()):
                folder.rmdir()
                folder.symlink_to(documents / "units")


def run_once(draw: random.Random, run: Path, *, of_user: Path | None = None) -> None:
    """What a run does in its folder, killed at any of its renames."""
    left = draw.choice((99, *range(12)))
    replace = Path.replace

    def counted(self, target):
        nonlocal left
        left -= 1
        if left < 0:
            raise KilledError
        return replace(self, target)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Path, "replace", counted)
        if left < 12:
            patched.setattr(shutil, "rmtree", lambda *_, **__: None)
        with held_run_folder(run):
            add_own_files(run, [run / MANIFEST])
            UnitStore(run=run).write(UNIT, draw.randbytes(32).hex(), b"work")
            with new_results(run) as results:
                for name in draw.sample(NAMES[:2] + NAMES[3:], 4):
                    (results / name).write_text("result")
                for folder in draw.sample(FOLDERS[2:5], draw.randrange(3)):
                    (results / folder).mkdir(parents=True, exist_ok=True)
                    (results / folder / "drawn.png").write_text("result")
                if of_user is not None:
                    add_of_user(draw, run, of_user)
            UnitStore(run=run).keep_only({}, [])


def is_of_user(content: bytes | str) -> bool:
    return isinstance(content, str) or content.startswith(b"mine")


@pytest.mark.slow
def test_trees_of_users(tmp_path):
    """Random folders with files, links and halves of runs; what the program wrote says "result" or "work"."""
    done = refused = killed = 0
    for seed in range(TREES):
        draw = random.Random(seed)
        place = tmp_path / str(seed)
        run, documents = place / "run", place / "documents"
        (documents / "units").mkdir(parents=True)
        (documents / "thesis.txt").write_text("mine")
        (documents / "units" / UnitStore(run=run).file(UNIT, "a" * 64).name).write_text("mine")
        (place / ".run.new").mkdir()
        (place / ".run.new/summary.json").write_text("mine")
        for _ in range(4):
            if draw.random() < 0.4:
                add_of_user(draw, run, documents)
            before = {name: content for name, content in written(place).items() if is_of_user(content)}
            try:
                run_once(draw, run, of_user=documents if draw.random() < 0.3 else None)
                done += 1
            except DataError:
                refused += 1
            except KilledError:
                killed += 1
            after = written(place)
            assert {name: after.get(name) for name in before} == before, f"seed {seed}"
        shutil.rmtree(place)
    assert min(done, refused, killed) > 200, (done, refused, killed)


@pytest.mark.parametrize("name", ["../documents/thesis.txt", "/etc/hostname", "a/../../b"])
def test_a_list_of_files_that_leaves_the_folder_is_refused(tmp_path, name):
    with held_run_folder(tmp_path / "run"):
        add_own_files(tmp_path / "run", [tmp_path / "run" / "table.csv"])
    file = tmp_path / "run/files.json"
    content = json.loads(file.read_text())
    file.write_text(json.dumps(with_digest(content | {"files": [name]})))
    with pytest.raises(DataError, match=r"files\.json"), held_run_folder(tmp_path / "run"):
        pass


def test_what_a_killed_process_left_half_written_goes(tmp_path):
    run = tmp_path / "run"
    with held_run_folder(run):
        (run / temporary_name("results")).mkdir()
        (run / temporary_name("files", ".json")).write_text("{")
    with held_run_folder(run):
        assert [entry.name for entry in run.iterdir()] == ["units"]
