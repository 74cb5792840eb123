"""Files that a command did not write are never replaced by its output; those that it wrote are."""

import shutil

import pytest

from tests.support.commands import call, error_line

HERE = {
    "report": (("report", "RUN", "--no-pictures", "--out", "OUT/mine.html"), "mine.html"),
    "report, of the run": (("report", "RUN", "--no-pictures", "--out", "RUN/paper-v1/summary.json"), ""),
    "compare": (("compare", "RUN", "OTHER", "--no-pictures", "--out", "OUT"), "compare.md"),
    "leaderboard": (("leaderboard", "RUNS", "--out", "OUT"), "index.html"),
    "leaderboard, table": (("leaderboard", "RUNS", "--out", "OUT"), "leaderboard.json"),
    "video": (("view", "CARD", "--recording", "crossing", "--video", "OUT/mine.avi"), "mine.avi"),
    "gate": (("gate", "RUN", "--baseline", "BASELINE", "--json", "OUT/mine.json"), "mine.json"),
    "gate, junit": (("gate", "RUN", "--baseline", "BASELINE", "--junit", "OUT/mine.xml"), "mine.xml"),
    "gate, sums of a run": (("gate", "RUN", "--baseline", "BASELINE", "--junit", "RUN/paper-v1/sums.csv"), ""),
    "gate, summary of a run": (("gate", "RUN", "--baseline", "BASELINE", "--json", "RUN/paper-v1/summary.json"), ""),
}


@pytest.fixture(scope="module")
def places(tiny_card, tmp_path_factory):
    folder = tmp_path_factory.mktemp("read")
    with pytest.MonkeyPatch.context() as patched:
        for name in ("nothing", "everything"):
            words = ("run", tiny_card, "--method", name, "--protocol", "paper-v1", "--no-pictures")
            assert call(patched, *words, "--out", folder / "runs" / name) == 0
        words = ("gate", folder / "runs" / "nothing", "--baseline", folder / "baseline", "--update", "--allow-dirty")
        assert call(patched, *words) == 0
    return {"CARD": tiny_card, "RUNS": folder / "runs", "OTHER": folder / "runs" / "everything"} | {
        "RUN": folder / "runs" / "nothing",
        "BASELINE": folder / "baseline",
    }


def words_of(name, places, out):
    known = {key: str(value) for key, value in (places | {"OUT": out}).items()}
    first = [str(word).partition("/") for word in HERE[name][0]]
    return ["".join([known.get(head, head), *rest]) for head, *rest in first]


@pytest.mark.parametrize("name", HERE)
def test_a_file_of_the_users_or_of_a_run_stays(monkeypatch, capsys, places, tmp_path, name):
    run = shutil.copytree(places["RUN"], tmp_path / "run")
    out = tmp_path / "out"
    out.mkdir()
    if there := HERE[name][1]:
        (out / there).write_text("mine")
    before = {file: file.read_bytes() for file in [*out.iterdir(), *run.rglob("*")] if file.is_file()}
    line = error_line(monkeypatch, capsys, *words_of(name, places | {"RUN": run}, out))
    assert "got a file that is there and is something else; move it away, or name another place" in line
    assert {file: file.read_bytes() for file in before} == before


@pytest.mark.slow
@pytest.mark.parametrize("name", ["report", "compare", "leaderboard", "gate", "gate, junit"])
def test_an_earlier_output_is_replaced(monkeypatch, places, tmp_path, name):
    words = words_of(name, places, tmp_path / "out")
    assert call(monkeypatch, *words) == call(monkeypatch, *words) != 2
