"""Names, titles, licences and failures that try to act where they are printed or written: on a terminal, as a command
of a CI server, as rich's markup, in Markdown, XML and HTML."""

import json
import re
import shutil
import unicodedata

import pytest

from bench.commands import console
from bench.plain_text import escape_markdown, plain
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import call
from tests.support.planting import change_json
from tests.support.stored_files import change_manifest

pytestmark = pytest.mark.slow

WILD = "w\n::error::pwned\x1b[2J\x9b2J[/x][bold red]:warning:##[error]p##vso[task.x]\u202e\u200b\r\u2028<b>|`*e*"
IN_A_PATH = WILD.replace("/", "")
FOREIGN = f"run{IN_A_PATH}"


def harmless(shown: str) -> bool:
    """Whether no character acts, and no line is a command of GitHub or Azure."""
    return visible(shown) and not re.search(r"^\s*::[A-Za-z]|##\w*\[", shown, re.MULTILINE)


def visible(shown: str) -> bool:
    return all(c == "\n" or c.isprintable() or unicodedata.category(c) == "Zs" for c in shown)


@pytest.fixture(scope="module")
def wild(tiny_card, tmp_path_factory):
    """A data set whose objects, title, licence and caveats are wild words, and one with a recording of a wild name."""
    folder = shutil.copytree(tiny_card.parent, tmp_path_factory.mktemp("wild") / "datasets")
    card = (folder / "tiny.yaml").read_text().replace("scenario: tiny.scenario.yaml\n", "")
    card = re.sub("title: .*", lambda _: f"title: {json.dumps(WILD)}", card)
    card = card.replace("licence: CC0-1.0", f"licence: {json.dumps(WILD)}\ncaveats: {json.dumps(WILD)}")
    (folder / "tiny.yaml").write_text(card)
    for file in (folder / "data" / "tiny").glob("*/annotations.json"):
        content = json.loads(file.read_text())
        for entry in (content["openlabel"], *content["openlabel"]["frames"].values()):
            entry["objects"] = {f"{name}{WILD}": value for name, value in entry["objects"].items()}
        file.write_text(json.dumps(content))
    broken = shutil.copytree(folder, folder.parent / "broken") / "data" / "tiny"
    (broken / "crossing").rename(broken / IN_A_PATH)
    return folder.parent


@pytest.fixture(scope="module")
def runs(wild):
    """A run that somebody sent, its folder and its method of wild names, the run that it was, and a baseline."""
    foreign, own = wild / FOREIGN, wild / "everything"
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.chdir(wild)
        words = ("--out", own, "--no-pictures", "--workers", 1, "--protocol", "paper-v1")
        assert call(monkeypatch, "run", wild / "datasets" / "tiny.yaml", "--method", "everything", *words) == 0
        words = ("gate", own, "--baseline", wild / "b", "--update")
        assert call(monkeypatch, *words) == 0
    shutil.copytree(own, foreign)
    change_manifest(foreign, lambda content: content["method"].update(name=WILD, settings={"words": WILD}))
    # Few recordings are not judged; a baseline of another reference fails, whatever they say.
    change_json(wild / "b" / "manifest.json", lambda content: content.update(reference="0" * 64))
    return foreign, own


@pytest.fixture(autouse=True)
def _there(wild, monkeypatch):
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    monkeypatch.chdir(wild)


COMMANDS = {
    "list": (0, ("list", "datasets")),
    "failed run": (2, ("run", "broken/tiny.yaml", "--method", "nothing", "--out", "failed", "--no-pictures")),
    "validate": (1, ("validate", "broken/tiny.yaml")),
    "run": (0, ("run", "datasets/tiny.yaml", "--method", "nothing", "--out", f"again{IN_A_PATH}")),
    "compare": (0, ("compare", "everything", FOREIGN, "--out", "compared", "--no-pictures")),
    "leaderboard": (0, ("leaderboard", ".", "--out", "leaderboard")),
    "report": (0, ("report", FOREIGN, "--no-pictures")),
    "gate": (1, ("gate", FOREIGN, "--baseline", "b")),
}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.usefixtures("runs")
def test_what_a_command_prints_does_nothing(monkeypatch, capsys, name):
    expected, words = COMMANDS[name]
    status = call(monkeypatch, *words)
    shown = capsys.readouterr()
    assert status == expected, shown.err
    told = shown.out + shown.err
    assert harmless(told)
    assert "pwned" in told
    assert "Traceback" not in told


def test_an_annotation_is_one_command_and_a_row_of_the_summary_one_line(monkeypatch, capsys, runs, wild):
    summary = wild / "summary.md"
    summary.unlink(missing_ok=True)
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    assert call(monkeypatch, "gate", runs[0], "--baseline", "b", "--github", "--junit", "junit.xml") == 1
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("::")]
    assert lines
    assert all(re.match(r"::error title=gate%3A [^:]*::", line) for line in lines)
    assert all(plain(line) == line for line in lines)
    assert "pwned" in (wild / "junit.xml").read_text()
    told = summary.read_text()
    assert "pwned" in told
    rows = [line for line in told.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {11}
    assert visible(told)
    assert "<b>" not in told


def test_files_for_people_hold_no_foreign_markup(monkeypatch, runs, wild):
    assert call(monkeypatch, "report", runs[0], "--no-pictures") == 0
    assert call(monkeypatch, "compare", runs[1], runs[0], "--out", "compared", "--no-pictures") == 0
    assert call(monkeypatch, "leaderboard", ".", "--out", "board") == 0
    results = runs[0] / "paper-v1"
    page = (results / "index.html").read_text()
    assert "pwned" in page
    assert "<b>|" not in page
    for file in (results / "table.md", wild / "compared/compare.md", wild / "board/leaderboard.md"):
        told = file.read_text()
        assert "pwned" in told, file
        assert visible(told), file
        assert "<b>" not in told, file
        assert "*e*" not in told.replace(r"\*e\*", ""), file


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\nb", r"a\nb"),
        ("\x1b[2J", r"\u001b[2J"),
        ("\u202eabc\u200b", r"\u202eabc\u200b"),
        ("\udcff", r"\udcff"),
        ("\U000e0001", r"\U000e0001"),
        ("größer　als 5 µm", "größer　als 5 µm"),
    ],
)
def test_plain_text_is_one_line_of_visible_characters(text, shown):
    assert plain(text) == shown
    assert plain(shown) == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("static_ego, a_b [1.0, 2.0] <0.001 & more", "static_ego, a_b [1.0, 2.0] <0.001 & more"),
        ("_x_ *y* `z` ~q~ $m$ a|b", r"\_x\_ \*y\* \`z\` \~q\~ \$m\$ a\|b"),
        ("[a](http://b) <img src=x> &lt;", r"[a]\(http://b) &lt;img src=x> &amp;lt;"),
        ("line\n# heading", r"line\\n# heading"),
    ],
)
def test_markdown_is_escaped_where_it_would_act(text, shown):
    assert escape_markdown(text) == shown


def test_a_printed_document_of_json_means_what_it_says(capsys):
    content = {"::error::x": "##[error] ##vso[y]", "b": "::warning::z"}
    console.write_out(json.dumps(content, indent=1))
    shown = capsys.readouterr().out
    assert json.loads(shown) == content
    assert harmless(shown)


@pytest.mark.parametrize("name", ["../../evil", "/evil", "\n\x1b[2J", "x" * 5000])
def test_names_of_objects_lead_nowhere(monkeypatch, capsys, tmp_path, name):
    folder = tmp_path / "a" / "b" / "work"
    tiny.write_recording(folder / "data" / "drive")
    write_card(folder)
    monkeypatch.chdir(folder)

    def rename(content):
        for entry in (content["openlabel"], *content["openlabel"]["frames"].values()):
            entry["objects"][name] = entry["objects"].pop("van")

    def listing():
        return {path for path in tmp_path.rglob("*") if not path.is_relative_to(folder / "out")}

    change_json(folder / "data/drive/annotations.json", rename)
    before = listing()
    assert call(monkeypatch, "view", "x.yaml", "--method", "nothing", "--out", folder / "out") == 0
    if name.startswith("../"):  # the pictures of a run are named by objects too
        assert call(monkeypatch, "run", "x.yaml", "--method", "nothing", "--out", folder / "out" / "run") in {0, 2}
    assert "Traceback" not in capsys.readouterr().err
    assert listing() == before
