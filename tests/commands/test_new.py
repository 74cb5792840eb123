"""`fisheye-bench new`: what it writes runs as it is, and it writes over nothing."""

import importlib
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench import plug_ins
from bench.errors import DataError
from bench.recordings import catalogue
from tests.support.commands import call, error_line, output_of


@pytest.fixture
def place(tmp_path, monkeypatch, tiny_card):
    """An empty working folder, where the data set `tiny` is found and rendered."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("FISHEYE_BENCH_DATASETS", str(tiny_card.parent))
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", "")).startswith(str(tmp_path)):
            sys.modules.pop(name)


@pytest.mark.slow
def test_a_new_method_scores_as_it_is(place, monkeypatch):
    told = output_of("new", "method", "grey-change")
    assert "grey_change.py\n" in told
    assert "fisheye-bench run tiny --method grey_change:GreyChange" in told
    words = ("--method", "grey_change:GreyChange", "--set", "threshold=20", "--no-pictures")
    assert call(monkeypatch, "run", "tiny", *words) == 0
    assert (place / "reports/runs/tiny-grey-change-threshold-20/paper-v1/summary.json").is_file()
    tests = importlib.import_module("test_grey_change")
    tests.test_every_answer_is_a_segmentation_of_its_image()
    tests.test_nothing_moves_between_equal_images()
    tests.test_it_scores(place / "of its tests")


def test_a_new_data_set_validates_and_scores_as_it_is(place, monkeypatch, capsys):
    assert call(monkeypatch, "new", "dataset", "car-park") == 0
    assert call(monkeypatch, "validate", "car-park") == 2
    assert "python write_car_park.py" in capsys.readouterr().err
    program = importlib.import_module("write_car_park")
    program.write(program.FOLDER / "drive-01")
    assert "0 errors and 0 warnings in 1 recording" in output_of("validate", "car-park")
    assert "11 annotated object-frames: 11 evaluated" in output_of(
        "run", "car-park", "--method", "everything", "--no-pictures"
    )
    tests = importlib.import_module("test_car_park")
    (place / "of its tests").mkdir()
    data = tests.written(place / "of its tests")
    tests.test_nothing_looks_wrong(data)
    tests.test_every_image_shows_its_object(data)


def test_a_new_adapter_keeps_its_contract_and_is_found_by_its_entry_point(place, monkeypatch):
    assert call(monkeypatch, "new", "adapter", "lab_format") == 0
    monkeypatch.chdir(place / "lab-format")
    monkeypatch.syspath_prepend(place / "lab-format")
    importlib.import_module("example").main()
    tests = importlib.import_module("test_lab_format")
    tests.test_it_keeps_the_contract(place / "one")
    tests.test_images_and_points_are_those_of_the_files(place / "two")
    point = EntryPoint(name="lab-format", value="lab_format:recordings", group=catalogue.ENTRY_POINTS)
    assert f'{point.name} = "{point.value}"' in Path("pyproject.toml").read_text()
    monkeypatch.setattr(plug_ins, "installed_points", lambda group: [point] if group == point.group else [])
    assert "2 images: 2 scored, 0 skipped, 0 failed" in " ".join(
        output_of("run", "lab-format.yaml", "--method", "nothing", "--out", "run", "--no-pictures").split()
    )
    next(Path("example/monday/scans").iterdir()).write_bytes(b"123")
    with pytest.raises(DataError, match="expected rows of 4 float32"):
        tests.check_adapter(tests.recordings, Path("example"))


IMPORTED = "names something that the new files import"


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("method", "numpy", "the name of an installed package"),
        ("method", "../up", "letters, digits"),
        ("method", "class", "letters, digits"),
        *(("method", name, IMPORTED) for name in ("segmentation", "method-input", "np")),
        ("adapter", "example", IMPORTED),
    ],
)
def test_names_that_cannot_be_taken_are_refused(place, monkeypatch, capsys, kind, name, message):
    assert message in error_line(monkeypatch, capsys, "new", kind, name)
    assert not list(place.iterdir())


def test_nothing_is_written_over(place, monkeypatch, capsys):
    (place / "test_mine.py").write_text("precious")
    told = error_line(monkeypatch, capsys, "new", "method", "mine")
    assert "test_mine.py: expected a writable path, got a file that is there already" in told
    assert [path.name for path in place.iterdir()] == ["test_mine.py"]
    assert (place / "test_mine.py").read_text() == "precious"
