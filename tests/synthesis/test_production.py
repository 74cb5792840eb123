from __future__ import annotations

import threading
from pathlib import Path

import pytest

from bench.errors import DataError, UsageError
from bench.synthesis import production, synthesize
from tests.synthesis.conftest import MINIATURE


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_same_scenario_gives_same_bytes_in_one_process_and_in_two(scenario_file: Path, tmp_path: Path) -> None:
    synthesize(scenario_file, tmp_path / "once", workers=1)
    synthesize(scenario_file, tmp_path / "again", workers=2)
    once, again = contents(tmp_path / "once"), contents(tmp_path / "again")
    assert len([name for name in once if name.startswith("crossing/images/front/")]) == 2
    assert once.keys() == again.keys()
    assert [name for name in once if once[name] != again[name]] == []


def test_order_of_recordings_changes_nothing(scenario_file: Path, tmp_path: Path) -> None:
    synthesize(scenario_file, tmp_path / "a", workers=1)
    head, recordings = scenario_file.read_text().split("recordings:\n")
    first, second = recordings.split("  - name: reversing")
    scenario_file.write_text(f"{head}recordings:\n  - name: reversing{second}{first}")
    synthesize(scenario_file, tmp_path / "b", workers=1)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_interrupted_run_leaves_whole_recordings_and_resumes(
    scenario_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    render = production.render_recording

    def fails_on_second(scenario: object, spec: object, root: Path) -> None:
        render(scenario, spec, root)  # type: ignore[arg-type]
        if root.name == "reversing":
            raise KeyboardInterrupt

    monkeypatch.setattr(production, "render_recording", fails_on_second)
    with pytest.raises(KeyboardInterrupt):
        synthesize(scenario_file, out, workers=1)
    assert [path.parent.name for path in out.glob("*/recording.json")] == ["crossing"]
    before = contents(out / "crossing")
    monkeypatch.setattr(production, "render_recording", _only("reversing", render))
    seen: list[tuple[int, int]] = []
    folders = synthesize(scenario_file, out, workers=1, progress=lambda done, total: seen.append((done, total)))
    assert folders == [out / "crossing", out / "reversing"]
    assert all((folder / "recording.json").is_file() for folder in folders)
    assert seen == [(1, 2), (2, 2)]
    assert contents(out / "crossing") == before
    assert sorted(path.name for path in out.iterdir()) == ["crossing", "reversing"]


def test_only_what_changed_is_rendered_again_and_former_recordings_go(
    scenario_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    synthesize(scenario_file, out, workers=1)
    before = contents(out / "crossing")
    scenario_file.write_text(scenario_file.read_text().replace("speed_kmh: [5]", "speed_kmh: [6]"))
    monkeypatch.setattr(production, "render_recording", _only("reversing", production.render_recording))
    synthesize(scenario_file, out, workers=1)
    assert contents(out / "crossing") == before
    scenario_file.write_text(scenario_file.read_text().split("  - name: reversing")[0])
    synthesize(scenario_file, out, workers=1)
    assert [path.name for path in out.iterdir()] == ["crossing"]


def test_second_run_into_the_same_folder_waits_for_the_first_and_renders_nothing(
    scenario_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, render = tmp_path / "out", production.render_recording
    rendered: list[str] = []
    seconds: list[threading.Thread] = []

    def starts_another_run(scenario: object, spec: object, root: Path) -> None:
        if not seconds:
            seconds.append(threading.Thread(target=synthesize, args=(scenario_file, out), kwargs={"workers": 1}))
            seconds[0].start()
            seconds[0].join(timeout=0.5)
            assert seconds[0].is_alive(), "the second run has to wait"
        rendered.append(root.name)
        render(scenario, spec, root)  # type: ignore[arg-type]

    monkeypatch.setattr(production, "render_recording", starts_another_run)
    synthesize(scenario_file, out, workers=1)
    seconds[0].join()
    assert rendered == ["crossing", "reversing"]


def test_recording_of_a_longer_series_is_not_rendered_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = MINIATURE.split("recordings:\n")[0]
    series = "series:\n  - {name: drive, count: COUNT, frames: 2, host: {speed_kmh: [{uniform: [5, 20]}]}}\n"
    scenario_file = tmp_path / "series.scenario.yaml"
    scenario_file.write_text(head + series.replace("COUNT", "1"))
    synthesize(scenario_file, tmp_path / "out", workers=1)
    scenario_file.write_text(head + series.replace("COUNT", "2"))
    monkeypatch.setattr(production, "render_recording", _only("drive-02", production.render_recording))
    folders = synthesize(scenario_file, tmp_path / "out", workers=1)
    assert [folder.name for folder in folders] == ["drive-01", "drive-02"]


def test_foreign_folder_is_not_overwritten(scenario_file: Path, tmp_path: Path) -> None:
    own = tmp_path / "out" / "crossing"
    own.mkdir(parents=True)
    (own / "thesis.txt").write_text("mine")
    with pytest.raises(DataError, match="crossing"):
        synthesize(scenario_file, tmp_path / "out", workers=1)
    assert (own / "thesis.txt").read_text() == "mine"


def test_no_workers_are_refused(scenario_file: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="workers"):
        synthesize(scenario_file, tmp_path / "out", workers=0)


def _only(name: str, render: object) -> object:
    def checked(scenario: object, spec: object, root: Path) -> None:
        assert root.name == name
        render(scenario, spec, root)  # type: ignore[operator]

    return checked
