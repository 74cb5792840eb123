"""The documentation: links that lead somewhere, commands that exist, code that compiles."""

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LOCAL = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
FOLDERS = ("datasets", "annotations", "reports")
PAGES = (
    *(ROOT / name for name in LOCAL),
    *(ROOT / folder / "README.md" for folder in FOLDERS),
    *sorted((ROOT / "docs").glob("*.md")),
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"`[^`\n]+`")
COMMAND = re.compile(r"fisheye-bench ([a-z][a-z-]*)(?: ([a-z]+))?")
every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())


@pytest.fixture(scope="module")
def hooks():
    spec = importlib.util.spec_from_file_location("docs_hooks", ROOT / "docs/hooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def prose(page):
    """A page without its blocks of code."""
    return FENCE.sub("", page.read_text("utf-8"))


def anchors(page):
    """What links can name: its headings, as code hosts and mkdocs spell them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def test_the_scores_of_the_readme_are_those_of_the_leaderboard():
    """Simulated and real side by side, each as its table of the leaderboard has it."""
    tables = (ROOT / "reports/leaderboard/leaderboard.md").read_text("utf-8").replace(" %", "").split("\n## ")
    simulated, real = (
        next(table for table in tables if table.startswith(f"{name}, all recordings, surface-v1"))
        for name in ("paper", "aimotive-sample")
    )
    rows = re.findall(r"^\| `(\S+)`, (.+) \|$", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE)
    assert len(rows) == 3
    for method, row in rows:
        cells = row.split(" | ")[1:]
        for table, (false_positives, iou) in ((simulated, cells[:2]), (real, cells[2:])):
            assert re.search(
                rf"^\| {method}(?: \(first_guess=False, flow=farneback\))? "
                rf"\| {re.escape(iou)} \| {re.escape(false_positives)} \|",
                table,
                re.MULTILINE,
            )


@every_page
def test_links_lead_to_files_and_headings(page):
    for link in LINK.findall(CODE.sub("", prose(page))):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.is_relative_to(ROOT), link
        assert target.is_file(), link
        assert not anchor or anchor in anchors(target), link


@every_page
def test_files_that_are_named_exist(page):
    for path in re.findall(r"`((?:bench|tests)/[\w/.-]+)`", prose(page)):
        assert (ROOT / path).exists(), path


@every_page
def test_commands_that_are_named_exist(page, hooks):
    known = {name for name, _ in hooks.commands()}
    groups = {name.split()[0] for name in known if " " in name}
    code = [*CODE.findall(prose(page)), *(b for kind, b in FENCE.findall(page.read_text("utf-8")) if kind != "bibtex")]
    for command, word in COMMAND.findall("\n".join(code)):
        assert (f"{command} {word}" if command in groups else command) in known


def test_every_command_is_in_the_reference(hooks):
    page = (ROOT / "docs/commands.md").read_text("utf-8")
    assert page.count(hooks.MARKER) == 1
    reference = hooks.command_reference()
    for name, command in hooks.commands():
        section = reference.partition(f"## {name}\n")[2].partition("\n## ")[0]
        assert f"fisheye-bench {name}" in section
        assert all(option in section for one in command.params for option in one.opts if option.startswith("--"))


@every_page
def test_code_compiles(page):
    for language, block in FENCE.findall(page.read_text("utf-8")):
        if language == "python":
            compile(block, str(page), "exec")


def test_the_program_that_writes_a_recording_runs(tmp_path, monkeypatch):
    from bench.recordings import open_native

    blocks = [block for _, block in FENCE.findall((ROOT / "docs/your-data.md").read_text("utf-8"))]
    (program,) = [block for block in blocks if "RecordingWriter(" in block]
    monkeypatch.chdir(tmp_path)
    exec(compile(program, "your-data.md", "exec"), {})
    recording = open_native(tmp_path / "my-drives/drive-01")
    assert [image.timestamp_ns for image in recording.images["front"]] == [0, 66_666_667]


def test_the_architecture_page_shows_the_layers_that_are_checked():
    (layers,) = [
        contract["layers"]
        for contract in tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers"
    ]
    rows = re.findall(r"^\| (`[^|]+`) \|", (ROOT / "docs/architecture.md").read_text("utf-8"), re.MULTILINE)
    assert [set(re.findall(r"`(\w+)`", row)) for row in rows] == [set(layer.split(" | ")) for layer in layers]


def test_every_page_is_in_the_navigation():
    named = set(re.findall(r"(\S+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE))
    notebooks = {notebook.with_suffix(".md").name for notebook in (ROOT / "docs").glob("*.ipynb")}
    assert named == {page.name for page in (ROOT / "docs").glob("*.md")} | notebooks


@pytest.fixture
def tiny_data(tiny_card, tmp_path, monkeypatch):
    """An empty working folder, where the data set `tiny` is found and rendered."""
    monkeypatch.setenv("FISHEYE_BENCH_DATASETS", str(tiny_card.parent))
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_the_notebook_is_shown_with_what_it_prints_and_draws(hooks, tmp_path, monkeypatch):
    file = ROOT / "docs/first-score.ipynb"
    stored = json.loads(file.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in stored), "clear the outputs: they are those of one machine"
    monkeypatch.chdir(tmp_path)
    page, pictures = hooks.notebook_page(file)
    assert len(pictures) == 3
    assert all(picture.startswith(b"\x89PNG") and f"]({name})" in page for name, picture in pictures.items())
    assert re.search(r"^all_moving +12 ", page, re.MULTILINE)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_programs_of_the_python_page_run(tiny_data, capsys):
    for _, block in FENCE.findall((ROOT / "docs/python.md").read_text("utf-8")):
        exec(compile(block, "python.md", "exec"), {})
    assert capsys.readouterr().out.startswith("0.428")


# The largest less the smallest of two images: ReduceMax, ReduceMin, Sub; made with onnx.helper.
DIFFERENCE_NETWORK = bytes.fromhex(
    "08083ae1010a370a06696d6167657312046d6f737422095265647563654d61782a0b0a04617865734001a001072a0f0a086b65657064696d73"
    "1800a001020a380a06696d6167657312056c6561737422095265647563654d696e2a0b0a04617865734001a001072a0f0a086b65657064696d"
    "731800a001020a1a0a046d6f73740a056c65617374120673636f7265732203537562120a646966666572656e63655a230a06696d6167657312"
    "190a17080112130a0312016e0a0208020a031201680a03120177621f0a0673636f72657312150a130801120f0a0312016e0a031201680a0312"
    "017742040a00100d"
)


def test_the_network_of_the_page_is_scored(tiny_data):
    import bench

    blocks = [block for _, block in FENCE.findall((ROOT / "docs/your-network.md").read_text("utf-8"))]
    (program,) = [block for block in blocks if "class MyNetwork" in block]
    Path("my_network.onnx").write_bytes(DIFFERENCE_NETWORK)
    names = {}
    exec(compile(program, "your-network.md", "exec"), names)
    method = names["MyNetwork"](threshold=0.1)
    frame = next(bench.open_dataset("tiny").frames(recordings=["standing"]))
    found = method.segment(frame.input)
    previous, current = (image.astype(int) for image in frame.input.images)
    expected = (abs(current - previous) / 255 > 0.1) & frame.input.valid
    assert expected.any()
    assert (found.mask == expected).all()


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("material") is None, reason="the extra `docs` is not installed")
def test_the_site_builds_and_needs_no_network(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    html = {page: page.read_text("utf-8") for page in (tmp_path / "site").rglob("*.html")}
    assert len(html) >= len(PAGES) - len(LOCAL)
    for page, text in html.items():
        assert not re.findall(r"<(?:script|img|link)[^>]*(?:src|href)=.?(?:https?:)?//", text), page
