import shutil
import threading
from multiprocessing import active_children
from signal import SIGKILL
from time import sleep

import pytest

from bench.errors import DataError, UsageError
from bench.synthesis import production, read_scenario, synthesize
from bench.synthesis.production import MANIFEST
from tests.synthesis.conftest import IDEAL, contents

pytestmark = pytest.mark.slow


@pytest.fixture
def quick(monkeypatch):
    """Recordings that hold their lines of the scenario instead of images; gives the names of what was made."""
    made = []

    def written(scenario, spec, root):
        made.append(root.name)
        (root / "images").mkdir(parents=True)
        (root / "images" / "0.png").write_text(spec.model_dump_json())
        (root / "recording.json").write_text(scenario.model_dump_json(exclude={"recordings"}))

    monkeypatch.setattr(production, "render_recording", written)
    return made


def test_same_bytes_in_two_processes_of_which_one_is_killed_and_in_another_order(scenario_file, tmp_path, rendered):
    head, recordings = scenario_file.read_text().split("recordings:\n")
    first, second = recordings.split("  - name: reversing")
    scenario_file.write_text(f"{head}recordings:\n  - name: reversing{second}{first}")
    out, killed = tmp_path / "out", []

    def kill_one_that_renders():
        while not list((out / production.UNFINISHED).glob("*")):
            sleep(0.02)
        killed.append(active_children()[0])
        killed[0].kill()

    killing = threading.Thread(target=kill_one_that_renders)
    killing.start()
    folders = synthesize(scenario_file, out, workers=2)
    killing.join()
    assert killed[0].exitcode == -SIGKILL
    assert [folder.name for folder in folders] == ["reversing", "crossing"]
    assert not (out / production.UNFINISHED).exists()
    once, again = contents(rendered(IDEAL) / "out"), contents(out)
    assert len([name for name in once if name.startswith("crossing/images/front/")]) == 2
    assert once.keys() == again.keys()
    assert [name for name in once if once[name] != again[name]] == []


def test_interrupted_run_leaves_whole_recordings_and_resumes(scenario_file, tmp_path, quick, monkeypatch):
    out = tmp_path / "out"
    render = production.render_recording

    def fails_on_second(scenario, spec, root):
        render(scenario, spec, root)
        if root.name == "reversing":
            raise KeyboardInterrupt

    monkeypatch.setattr(production, "render_recording", fails_on_second)
    with pytest.raises(KeyboardInterrupt):
        synthesize(scenario_file, out, workers=1)
    assert [path.parent.name for path in out.glob("*/recording.json")] == ["crossing"]
    before = contents(out / "crossing")
    monkeypatch.setattr(production, "render_recording", render)
    quick.clear()
    seen = []
    folders = synthesize(scenario_file, out, workers=1, progress=lambda done, total: seen.append((done, total)))
    assert quick == ["reversing"]
    assert folders == [out / "crossing", out / "reversing"]
    assert all((folder / "recording.json").is_file() for folder in folders)
    assert seen == [(1, 2), (2, 2)]
    assert contents(out / "crossing") == before
    assert sorted(path.name for path in out.iterdir()) == ["crossing", "reversing"]


def test_second_run_into_the_same_folder_waits_and_renders_nothing(scenario_file, tmp_path, quick, monkeypatch):
    out, render = tmp_path / "out", production.render_recording
    seconds = []

    def starts_another_run(scenario, spec, root):
        if not seconds:
            seconds.append(threading.Thread(target=synthesize, args=(scenario_file, out), kwargs={"workers": 1}))
            seconds[0].start()
            seconds[0].join(timeout=0.5)
            assert seconds[0].is_alive(), "the second run has to wait"
        render(scenario, spec, root)

    monkeypatch.setattr(production, "render_recording", starts_another_run)
    synthesize(scenario_file, out, workers=1)
    seconds[0].join()
    assert quick == ["crossing", "reversing"]


CHANGES = {
    "speed": lambda text, _, __: text.write_text(text.read_text().replace("speed_kmh: [5]", "speed_kmh: [6]")),
    "generator": lambda _, __, patch: patch.setattr(production, "GENERATOR_VERSION", -1),
    "a recording removed": lambda _, out, __: shutil.rmtree(out / "reversing"),
    "an image removed": lambda _, out, __: (out / "reversing" / "images" / "0.png").unlink(),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_stale_recordings_are_never_taken_for_fresh_ones(change, scenario_file, tmp_path, quick, monkeypatch):
    out = tmp_path / "out"
    synthesize(scenario_file, out, workers=1)
    before = contents(out / "crossing")
    change(scenario_file, out, monkeypatch)
    quick.clear()
    synthesize(scenario_file, out, workers=1)
    assert quick == (["crossing", "reversing"] if production.GENERATOR_VERSION < 0 else ["reversing"])
    assert contents(out / "crossing") == before or "crossing" in quick
    fresh = tmp_path / "fresh"
    synthesize(scenario_file, fresh, workers=1)
    assert contents(out) == contents(fresh)
    scenario_file.write_text(scenario_file.read_text().split("  - name: reversing")[0])
    synthesize(scenario_file, out, workers=1)
    assert sorted(path.name for path in out.iterdir()) == ["crossing"]


OWN = {
    "an edited file": lambda drive: (drive / "images" / "0.png").write_text("mine"),
    "a file more": lambda drive: (drive / "notes.txt").write_text("mine"),
    "a link": lambda drive: (drive / "images" / "documents").symlink_to(drive.parent),
    "another's manifest": lambda drive: shutil.copy(drive.parent / "crossing" / MANIFEST, drive / MANIFEST),
    "a broken manifest": lambda drive: (drive / MANIFEST).write_text('{"files": "2"}'),
    "no manifest": lambda drive: (drive / MANIFEST).unlink(),
}


@pytest.mark.parametrize("change", OWN.values(), ids=OWN.keys())
def test_what_others_changed_is_refused_where_it_would_be_rendered_again(change, scenario_file, tmp_path, quick):
    out = tmp_path / "out"
    synthesize(scenario_file, out, workers=1)
    change(out / "reversing")
    scenario_file.write_text(scenario_file.read_text().replace("kmh: [5]", "kmh: [6]").replace("[18, 14]", "[18, 15]"))
    before = contents(out)
    with pytest.raises(DataError, match=r"reversing: expected .* got one with files that are of others.*move it away"):
        synthesize(scenario_file, out, workers=1)
    assert contents(out) == before
    assert quick == ["crossing", "reversing"]


def test_copies_and_edited_recordings_that_the_scenario_does_not_have_stay(scenario_file, tmp_path, quick):
    out = tmp_path / "out"
    synthesize(scenario_file, out, workers=1)
    copied = shutil.copytree(out / "crossing", out / "crossing-with-noise")
    (copied / "images" / "0.png").write_text("hours of work")
    shutil.copytree(out / "crossing", out / "copied")
    (out / "elsewhere").symlink_to(out / "copied")
    (out / "reversing" / "annotations.json").write_text("by hand")
    scenario_file.write_text(scenario_file.read_text().split("  - name: reversing")[0])
    before = contents(out)
    synthesize(scenario_file, out, workers=1)
    assert contents(out) == before
    assert (out / "elsewhere").is_symlink()
    assert quick == ["crossing", "reversing"]


def test_what_is_wanted_alone_is_rendered(scenario_file, tmp_path, quick):
    first, second = [spec.name for spec in read_scenario(scenario_file).recordings][:2]
    assert synthesize(scenario_file, tmp_path / "out", only=[second]) == [tmp_path / "out" / second]
    assert quick == [second]
    synthesize(scenario_file, tmp_path / "out")
    assert quick[1:] == [spec.name for spec in read_scenario(scenario_file).recordings if spec.name != second]
    assert (tmp_path / "out" / first).is_dir()
    with pytest.raises(UsageError, match="workers"):
        synthesize(scenario_file, tmp_path / "out", workers=0)
