"""The documentation: links that lead somewhere, commands that exist, code that runs, a site that browsers show."""

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import bench
from tests.support.browser import accessibility_faults, headless_chromium, opened

ROOT = Path(__file__).parents[1]
FOLDERS = (".", "datasets", "annotations", "reports", "docs", "reports/studies")
PAGES = sorted(page for folder in FOLDERS for page in (ROOT / folder).glob("*.md"))
NOTEBOOKS = {  # how many pictures each draws, and what it prints
    "first-score": (3, r"^all_moving +12 "),
    "masks-to-score": (1, r"^all_moving +12 .*\n(.*\n)*.*got 1 missing"),
    "bag-to-drive": (0, r"^0 errors, 0 warnings$(.*\n)*^1 errors, .*\n- .*road's height"),
    "red-gate": (0, r"^gate passed: (.*\n)*^gate FAILED: (.*\n)*exit status 1$"),
}
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
    """The headings of a page, as code hosts and mkdocs spell them in links."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def program(page, words):
    """The one block of code of a page that has these words."""
    (block,) = [block for _, block in FENCE.findall((ROOT / "docs" / page).read_text("utf-8")) if words in block]
    return block


def test_the_scores_of_the_readme_are_those_of_the_leaderboard():
    """The table is of rendered drives, the sentence below it of the real one, each as the leaderboard has it."""
    text = (ROOT / "reports/leaderboard/leaderboard.md").read_text("utf-8")
    tables = text.replace(" %", "").replace("<br>", " ").split("\n## ")
    simulated, real = (
        next(table for table in tables if table.startswith(f"{name}, all recordings, surface-v1"))
        for name in ("paper", "aimotive-sample")
    )
    text = (ROOT / "README.md").read_text("utf-8")
    rows = re.findall(r"^\| ([a-z' ]+), .+ \| (.+) \| (.+) \|$", text, re.MULTILINE)
    assert len(rows) == 7
    for name, false_positives, iou in rows:
        row = rf"\| {name}(?:, ceiling)? --method [^|]* \| {re.escape(iou)} \| {re.escape(false_positives)} \|"
        assert re.search(row, simulated), name
    named = r"^\| (?:[^|]* \| [^|]*--method )?"  # a rank, and the name that readers know, before the key
    told = re.findall(r"([\d.]+) % for\s+`(\S+)`", text.partition("16 object-frames")[2])
    assert len(told) == 4
    for iou, method in told:
        assert re.search(rf"{named}{method}(?: [^|]*)? \| {iou} \|", real, re.MULTILINE), method


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
    for path in re.findall(r"`((?:bench|tests)/[\w/.-]+)`", prose(page)):
        assert (ROOT / path).exists(), path


@every_page
def test_commands_that_are_named_exist_and_code_compiles(page, hooks):
    known = {name for name, _ in hooks.commands()}
    groups = {name.split()[0] for name in known if " " in name}
    code = [*CODE.findall(prose(page)), *(b for kind, b in FENCE.findall(page.read_text("utf-8")) if kind != "bibtex")]
    for command, word in COMMAND.findall("\n".join(code)):
        assert (f"{command} {word}" if command in groups else command) in known
    for language, block in FENCE.findall(page.read_text("utf-8")):
        if language == "python":
            compile(block, str(page), "exec")


def test_every_command_function_and_option_is_in_the_reference(hooks):
    page = (ROOT / "docs/reference.md").read_text("utf-8")
    assert page.count(hooks.MARKER) == page.count(hooks.FUNCTIONS_MARKER) == page.count(hooks.OPTIONS_MARKER) == 1
    reference, functions = hooks.command_reference(), hooks.function_reference()
    for name, command in hooks.commands():
        section = reference.partition(f"## {name}\n")[2].partition("\n## ")[0]
        assert f"fisheye-bench {name}" in section
        assert all(option in section for one in command.params for option in one.opts if option.startswith("--"))
    assert all(f"`bench.{name}`" in functions for name in bench.__all__ if name.islower())
    assert "| native: `bin_columns` |" in hooks.option_reference()


def test_the_lines_that_write_files_of_a_recording_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(program("your-data.md", "RecordingWriter("), {})
    written = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*.*")}
    assert written == {"my-drives/drive-01/lidar/0.npz", "my-drives/drive-01/images/front/0.png"}


def test_the_page_for_maintainers_shows_the_layers_that_are_checked():
    (layers,) = [
        contract["layers"]
        for contract in tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers"
    ]
    page = (ROOT / "docs/maintainers.md").read_text("utf-8").partition("## Decisions")[0]
    rows = re.findall(r"^\| (`[^|]+`) \|", page, re.MULTILINE)
    assert [set(re.findall(r"`(\w+)`", row)) for row in rows] == [set(layer.split(" | ")) for layer in layers]


def test_every_page_is_in_the_navigation():
    named = set(re.findall(r"(\S+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE))
    pages = {f"{page.stem}.md" for page in (ROOT / "docs").iterdir() if page.suffix in (".md", ".ipynb")}
    assert named == pages | {
        "index.md",
        "reports/leaderboard/leaderboard.md",
    }  # made of the README; committed elsewhere


@pytest.fixture
def tiny_data(tiny_card, tmp_path, monkeypatch):
    """An empty working folder, where the data set `tiny` is found and rendered."""
    monkeypatch.setenv("FISHEYE_BENCH_DATASETS", str(tiny_card.parent))
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_is_shown_with_what_it_prints_and_draws(hooks, tmp_path, monkeypatch, name):
    assert {notebook.stem for notebook in (ROOT / "docs").glob("*.ipynb")} == NOTEBOOKS.keys()
    file = ROOT / f"docs/{name}.ipynb"
    stored = json.loads(file.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in stored), "clear the outputs: they are those of one machine"
    monkeypatch.chdir(tmp_path)
    page, pictures = hooks.notebook_page(file)
    number, printed = NOTEBOOKS[name]
    assert len(pictures) == number
    assert all(picture.startswith(b"\x89PNG") and f"]({name})" in page for name, picture in pictures.items())
    assert re.search(printed, page, re.MULTILINE)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_programs_of_the_reference_run(tiny_data, capsys):
    for language, block in FENCE.findall((ROOT / "docs/reference.md").read_text("utf-8")):
        if language == "python":
            exec(block, {})
    assert capsys.readouterr().out.startswith("0.428")


@pytest.mark.slow
def test_the_first_score_is_the_one_of_the_docs(tiny_data):
    run = bench.run("tiny", "spherical", protocol="surface-v1", out="run", pictures=False)
    shown = run.metrics.loc["all_moving", ["iou", "tpr_all", "detection_rate", "detection_rate_50", "ceiling_iou"]]
    (rows,) = re.findall(r"^All moving +12 (.+)\nFalse positives +12 (.+)$", program("start.md", "Cases"), re.MULTILINE)
    assert " ".join(rows).split() == [f"{100 * value:.1f}" for value in (*shown, run.false_positives)]


# The largest less the smallest of two images: ReduceMax, ReduceMin, Sub; made with onnx.helper.
DIFFERENCE_NETWORK = bytes.fromhex(
    "08083ae1010a370a06696d6167657312046d6f737422095265647563654d61782a0b0a04617865734001a001072a0f0a086b65657064696d73"
    "1800a001020a380a06696d6167657312056c6561737422095265647563654d696e2a0b0a04617865734001a001072a0f0a086b65657064696d"
    "731800a001020a1a0a046d6f73740a056c65617374120673636f7265732203537562120a646966666572656e63655a230a06696d6167657312"
    "190a17080112130a0312016e0a0208020a031201680a03120177621f0a0673636f72657312150a130801120f0a0312016e0a031201680a0312"
    "017742040a00100d"
)


def test_the_network_of_the_page_is_scored(tiny_data):
    Path("my_network.onnx").write_bytes(DIFFERENCE_NETWORK)
    exec(program("your-method.md", "class MyNetwork"), names := {})
    frame = next(bench.open_dataset("tiny").frames(recordings=["standing"]))
    answer = names["MyNetwork"](threshold=0.1).segment(frame.input)
    previous, current = (image.astype(int) for image in frame.input.images)
    expected = (abs(current - previous) / 255 > 0.1) & frame.input.valid
    assert expected.any()
    assert (answer.mask == expected).all()


def test_the_class_of_the_page_is_scored(tiny_data, monkeypatch):
    Path("my_method.py").write_text(program("your-method.md", "class FrameDifference"), "utf-8")
    monkeypatch.syspath_prepend(Path.cwd())
    run = bench.run("tiny", "my_method:FrameDifference", settings={"threshold": 20.0}, out="run", pictures=False)
    assert (run.manifest.method.name, run.summary.images.evaluated) == ("my-frame-difference", 12)
    sys.modules.pop("my_method")


@pytest.fixture(scope="module")
def site_pages(tmp_path_factory):
    """All pages of the site but that of the theme for addresses that do not exist."""
    site = tmp_path_factory.mktemp("site")
    build = ["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    subprocess.run([sys.executable, *build], cwd=ROOT, check=True, capture_output=True)
    return sorted(page for page in site.rglob("*.html") if page.name != "404.html")


@pytest.mark.slow
def test_no_page_needs_the_network(site_pages):
    for page in site_pages:
        assert not re.findall(r"<(?:script|img|link)[^>]*(?:src|href)=.?(?:https?:)?//", page.read_text("utf-8")), page


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (390, "light")])
def test_every_page_is_accessible_and_as_wide_as_the_window(site_pages, tmp_path, width, scheme):
    faults = []
    with headless_chromium(tmp_path) as browser:
        for page in site_pages:
            opened(browser, page, width=width, scheme=scheme)
            needed_px = browser.execute_script("return document.documentElement.scrollWidth")
            faults += [f"{page.name}: {fault}" for fault in accessibility_faults(browser)]
            faults += [f"{page.name}: {needed_px} px wide"] * (needed_px > width)
    assert (len(site_pages) > 20, faults) == (True, [])
