"""Every command once: exit status, what it prints, which files it leaves."""

import shlex
import shutil

import pytest

import bench
from bench.commands.app import COMMANDS
from tests.support.commands import call, error_line, output_of


@pytest.fixture
def not_rendered(tiny_card, tmp_path):
    """The card of data that nobody has rendered."""
    folder = shutil.copytree(tiny_card.parent, tmp_path / "datasets", ignore=shutil.ignore_patterns("data"))
    return folder / tiny_card.name


def test_help_lists_every_command():
    shown = output_of("--help")
    assert all(f"  {name} " in shown for names in COMMANDS.values() for name in names)
    assert [shown.index(f"\n{panel}:\n") for panel in COMMANDS] == sorted(shown.index(f"\n{p}:\n") for p in COMMANDS)


def test_run_writes_the_report_and_ends_with_the_table(tiny_card, tmp_path):
    out = tmp_path / "run"
    shown = output_of("run", tiny_card, "--out", out)
    for name in ("summary.json", "table.md", "table.csv"):
        assert (out / "paper-v1" / name).stat().st_size > 100
    for name in ("summary.json", "table.md"):
        assert str(out / "paper-v1" / name) in shown
    assert shown.count(str(out)) < 13, "few paths"
    assert shown.index("by surface-v1, the rules of the leaderboard") < shown.index("by paper-v1, the paper's rules")
    assert shown.endswith(f"next, a page to read: fisheye-bench report {out}/surface-v1\n")
    assert bench.load_run(out).folder == out / "surface-v1", "what a run's folder stands for"
    assert f"more files in {out}/paper-v1" in shown
    for name in ("Crossing", "Overtaking", "Static ego-vehicle", "False positives"):
        assert name in shown
    for protocol in ("paper-v1", "surface-v1"):
        assert bench.load_run(out / protocol).manifest.protocol.name == protocol
    assert "Left out, without cases: preceding, approaching." in shown
    assert "16 annotated object-frames" in shown
    for picture in ("panels", "areas", "cluster-walker"):
        assert (out / "paper-v1" / "pictures" / "crossing" / f"{picture}.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_that_scores_no_object_says_so_above_its_table(monkeypatch, capsys, tiny_card, tmp_path):
    rules = tmp_path / "near.yaml"
    rules.write_text("{based_on: paper-v1, name: near, version: 1, reference: {range_limit_m: 0.01}}")
    run = ("run", tiny_card, "--method", "nothing", "--protocol", rules, "--no-pictures", "--out", tmp_path / "run")
    assert call(monkeypatch, *run) == 0
    _, objects, masks, *_ = capsys.readouterr().out.splitlines()
    assert masks.startswith("none of 12 masks marks anything")
    assert objects.startswith("no object was scored: 12 moving object-frames ignored")


def test_a_quick_look_scores_some_images_of_some_recordings(monkeypatch, tiny_card, tmp_path):
    out = tmp_path / "look"
    look = ("run", tiny_card, "--method", "nothing", "--protocol", "paper-v1", "--no-pictures", "--out", out)
    assert call(monkeypatch, *look, "--split", "crossing,standing[:3]") == 0
    found = bench.load_run(out)
    assert found.manifest.dataset.split == "crossing,standing[:3]"
    assert sorted(found.frames["recording"].unique()) == ["crossing", "standing"]
    assert found.summary.images.images == 4, "of three images the first has none before it"
    assert call(monkeypatch, "verify", out, "--data", tiny_card) == 0


def test_a_quick_look_renders_no_more_than_it_scores(monkeypatch, not_rendered, tmp_path):
    from bench.synthesis import production

    made = []
    monkeypatch.setattr(production, "_rendered", lambda _, specs, *__: made.extend(spec.name for spec in specs) or ())
    assert call(monkeypatch, "run", not_rendered, "--split", "standing", "--out", tmp_path / "run") == 2
    assert made == ["standing"]


FAILING = """
from bench.methods import Method


class Failing(Method):
    name = "failing"

    def segment(self, frame):
        raise ValueError("no such thing")
"""


def test_a_method_that_fails_everywhere_is_told_in_one_line_with_the_way_to_its_traceback(
    monkeypatch, capsys, tiny_card, tmp_path
):
    (tmp_path / "failing_everywhere.py").write_text(FAILING)
    monkeypatch.syspath_prepend(tmp_path)
    method = ("--method", "failing_everywhere:Failing")
    assert call(monkeypatch, "run", tiny_card, *method, "--no-pictures", "--out", tmp_path / "run") == 2
    *_, told, first, following = capsys.readouterr().out.splitlines()
    assert told == "failing failed on all 12 images"
    assert "ValueError: no such thing" in first
    words = shlex.split(following.partition("fisheye-bench ")[2])
    assert words[:2] == ["-v", "view"]
    assert call(monkeypatch, *words, "--out", tmp_path / "view") == 2
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "nowhere.yaml"), "nowhere"),
        (("run", "CARD", "--method", "sperical"), "did you mean 'spherical'"),
        (("run", "CARD", "--method", "../x:Y"), "expected a class at MODULE:NAME, as my_method:MyMethod, got '../x:Y'"),
        (("run", "CARD", "--protocol", "paper-v9"), "known are extended-v1, masks-v1, paper-v1"),
        (("run", "CARD", "--protocol", "paper-v1,paper-v1"), "expected each protocol once"),
        (("run", "CARD", "--split", "test"), "known are all, crossing, moving"),
        (("run", "CARD", "--set", "threshold"), "expected NAME=VALUE"),
        (("run", "CARD", "--set", "treshold=1"), "did you mean 'threshold'"),
        (("run", "CARD", "--workers", "0"), "--workers: expected a number from 1 on"),
        (("run", "CARD", "--shard", "3/2"), "--shard: expected I/N with I from 1 to N"),
        (("run", "CARD", "--out", "FULL"), "expected an empty folder or that of a run"),
        (("reference", "export", "CARD", "--out", "FULL"), "expected a new or an empty folder"),
        (("view", "CARD", "--recording", "crosing"), "did you mean 'crossing'"),
        (("view", "CARD", "--recording", "nope"), "unknown recording 'nope': known are crossing, overtaking, standing"),
        (("view", "CARD", "--camera", "rear"), "unknown camera 'rear': known are front"),
        (("view", "CARD", "--recording", "moving"), "--recording: expected one recording, got the split 'moving'"),
        (("evaluate", "CARD", "--predictions", "nope"), "--predictions: expected a folder of masks or scores, got"),
        (("audit", "CARD", "--recordings", "0"), "--recordings: expected at least 1, got 0"),
        (("synthesize", "nowhere.yaml", "--out", "OUT"), "nowhere.yaml"),
        (("report", "nope"), "nope: expected the folder of a finished run"),
        (("verify", "nope"), "nope: expected the folder of a finished run"),
        (("leaderboard", "nope"), "nope: expected a folder of runs"),
    ],
)
def test_a_mistake_is_one_clear_line_before_anything_is_rendered(
    monkeypatch, capsys, not_rendered, tmp_path, words, message
):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    named = {"CARD": not_rendered, "OUT": tmp_path / "out", "FULL": tmp_path / "full"}
    assert message in error_line(monkeypatch, capsys, *(named.get(word, word) for word in words))
    assert not (not_rendered.parent / "data").exists()
    assert not (tmp_path / "out").exists()


def test_synthesize_keeps_what_is_there(tiny_card):
    scenario = tiny_card.parent / "tiny.scenario.yaml"
    assert "3 recordings in" in output_of("synthesize", scenario, "--out", tiny_card.parent / "data" / "tiny")


def test_lists(monkeypatch):
    told = {"datasets": "Three rendered drives", "methods": "The paper's method", "protocols": "surface-patches",
            "formats": "ASAM OpenLABEL"}  # fmt: skip
    for what, line in told.items():
        shown = output_of("list", what)
        assert [word for word, other in told.items() if other in shown] == [what]
        assert line in shown
    shown = output_of("list")
    assert all(line in shown for line in told.values())
    assert call(monkeypatch, "list", "methods", "--schema", "card") == 2


def test_names_are_looked_up_in_three_folders(monkeypatch, capsys, tiny_card, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FISHEYE_BENCH_DATASETS", str(tmp_path / "own"))
    for folder, title in (("own", "mine"), ("datasets", "nearest")):
        (tmp_path / folder).mkdir()
        card = tiny_card.read_text().replace("title: Three rendered drives", f"title: {title},")
        (tmp_path / folder / "tiny.yaml").write_text(card)
        shown = output_of("list", "datasets")
        assert f" {title}," in shown
        assert all(f"\n{name} " in shown for name in ("demo", "paper", "woodscape"))
        assert f"{tmp_path / 'own'}: 1 card" in " ".join(shown.split())
    assert call(monkeypatch, "run", "tini") == 2
    told = capsys.readouterr().err
    assert f"looked in datasets, {tmp_path / 'own'}, " in told
    assert "did you mean 'tiny'" in told
    assert call(monkeypatch, "run", "datasets/demo.yaml") == 2
    assert "the card 'demo' ships with the package" in capsys.readouterr().err
    assert call(monkeypatch, "run", "own") == 2
    assert "own: expected a data set's card (a .yaml file), got a folder" in capsys.readouterr().err


def test_a_run_tells_less_or_more(monkeypatch, capsys, tiny_card, tmp_path):
    paper = ("--protocol", "paper-v1", "--no-pictures")
    words = ("run", tiny_card, "--out", tmp_path / "run", "--method", "nothing", *paper)
    assert call(monkeypatch, *words, "--quiet") == 0
    shown = capsys.readouterr()
    assert "Crossing" in shown.out
    assert "summary.json" not in shown.out
    assert "images per second" not in shown.out
    assert call(monkeypatch, "-v", *words) == 0
    shown = capsys.readouterr()
    assert "summary.json" in shown.out
    assert f"card {tiny_card}, root data/tiny" in shown.err
    assert call(monkeypatch, "run", "nowhere.yaml", "-v") == 2
    assert "Traceback" in capsys.readouterr().err
    assert output_of("--version") == f"fisheye-bench {bench.__version__}\n"


def test_version_tells_what_a_report_of_a_problem_needs(monkeypatch):
    monkeypatch.setenv("FISHEYE_BENCH_CACHE", "/somewhere")
    shown = output_of("--version", "--verbose")
    for line in (f"fisheye-bench {bench.__version__}", "commit: ", " cores", "numpy ", "optional: distributed ",
                 "opencv-python not installed", "FISHEYE_BENCH_CACHE=/somewhere"):  # fmt: skip
        assert line in " ".join(shown.split())
    assert "pytest" not in shown, "of developers"
