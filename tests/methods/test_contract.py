"""What holds for every registered method."""

import json
import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from bench.cameras.model import ray_grid
from bench.errors import UnknownNameError, UsageError
from bench.harness.exact import require_scorable
from bench.methods import METHODS, FlowMethod, Method, build_method, describe_method, known_methods
from bench.records.segmentation import segmentation_fault
from tests.support.board_scene import HEIGHT, STEP, WIDTH, crossing, frame, scaled

every_method = pytest.mark.parametrize("name", sorted(known_methods()))


@every_method
def test_contract(name):
    method = build_method(name)
    assert method.name == name
    assert method.history == 1
    assert method.most_history >= 1
    again = build_method(name, json.loads(json.dumps(method.settings())))
    assert again.settings() == method.settings()
    assert describe_method(known_methods()[name])
    assert describe_method("tests.methods.test_contract:Bare") == ""  # not what its base class says of itself
    given, _ = crossing()
    found = method.segment(given)
    rows, columns = -(-HEIGHT // found.cell_size_px), -(-WIDTH // found.cell_size_px)
    assert found.mask.shape == (rows, columns)
    assert found.mask.dtype == bool
    assert found.mask_at(WIDTH, HEIGHT).shape == (HEIGHT, WIDTH)
    if found.likelihood is not None:
        assert found.likelihood.shape == (rows, columns)
        assert np.isfinite(found.likelihood).all()
        assert found.likelihood.min() >= 0
    if found.cause is not None:
        assert found.cause.shape == (rows, columns)
        assert found.cause.max() < len(found.causes)
    previous, current = given.images
    other = frame(current, previous, -STEP)
    method.segment(replace(other, timestamps_ns=tuple(time_ns + 10**9 for time_ns in other.timestamps_ns)))
    again = method.segment(given)  # whatever came before
    np.testing.assert_array_equal(found.mask, again.mask)
    np.testing.assert_array_equal(found.likelihood, again.likelihood)


def test_methods_that_take_flow_agree_on_its_grid_and_its_unit():
    given, (width, height) = crossing()[0], (643, 481)  # no multiple of any cell
    found = build_method("spherical").segment(given)
    assert found.mask_at(WIDTH - 3, HEIGHT - 2).shape == (HEIGHT - 2, WIDTH - 3)
    given, flows = scaled(given, width, height), []
    for name in ("spherical", "rigid-scene"):
        method = build_method(name)
        assert isinstance(method, FlowMethod)
        cells = ray_grid(given.camera, method.flow_cell_px(width))
        flow = method.mean_flow(given)
        assert flow.shape == cells.pixels.shape
        assert segmentation_fault(method.segment_flow(given, flow), width=width, height=height) is None
        flows.append(cv2.resize(flow, (width, height), interpolation=cv2.INTER_NEAREST))
    difference_px = np.linalg.norm(flows[0] - flows[1], axis=-1)
    assert np.median(difference_px) < 0.2 * np.median(np.linalg.norm(flows[0], axis=-1))
    assert not isinstance(build_method("nothing"), FlowMethod)


class Bare(Method):
    name = "bare"

    def segment(self, frame):
        raise NotImplementedError


def test_what_a_method_leaves_out_has_a_default():
    bare = Bare()
    assert (bare.history, bare.most_history, bare.colour, bare.reads_images, bare.files) == (1, 1, False, True, ())
    assert bare.settings() == {}
    bare.history = 2
    assert bare.most_history == 2
    bare.longest_history = 5
    assert bare.most_history == 5


@dataclass
class Inner:
    scale: float = 0.5


class Own(Bare):
    name = "own"

    def __init__(self, level: int = 3, inner: Inner = Inner(), *, forgotten: str = "") -> None:  # noqa: B008
        self.level, self.inner, self.kept_to_itself = level, inner, forgotten


class Whole(Own):
    def __init__(self, level: int = 3, inner: Inner = Inner(), *, forgotten: str = "") -> None:  # noqa: B008
        super().__init__(level, inner)
        self.forgotten = forgotten


class Annotated(Bare):
    name = "annotated"

    def __init__(self, threshold: float = 0.5, images: int | None = None, anything=None) -> None:
        self.threshold, self.images, self.anything = threshold, images, anything


HERE = f"{__name__}:"
NOT_DERIVED = r"derived from bench\.methods\.Method, got {0}.*class {0}\(Method\)"


@pytest.mark.parametrize(
    ("name", "settings", "error", "message"),
    [
        ("sperical", {}, UnknownNameError, "did you mean 'spherical'"),
        ("nowhere:Method", {}, UsageError, "No module named 'nowhere'"),
        ("bench.methods.baselines:Nobody", {}, UsageError, "no attribute 'Nobody'"),
        (HERE + "Inner", {}, UsageError, NOT_DERIVED.format("Inner")),
        (HERE + "test_contract", {}, UsageError, NOT_DERIVED.format("test_contract")),
        ("bench.methods:Method", {}, UsageError, "abstract class Method"),
        (HERE + "Own", {}, UsageError, r"attribute 'forgotten' .* set self\.forgotten, or write settings\(\)"),
        (HERE + "Whole", {"levle": 4}, UnknownNameError, "known are forgotten, inner, level; did you mean 'level'"),
        (HERE + "Annotated", {"threshold": "abc"}, UsageError, "a valid number for threshold, got 'abc'"),
        (HERE + "Annotated", {"images": 2.5}, UsageError, "a valid integer for images, got 2.5"),
        (HERE + "Annotated", {"threshold": math.nan}, UsageError, "expected finite numbers, .* got .*'threshold': nan"),
        # A field that a data class inherits.
        ("spherical", {"threshold": "abc"}, UsageError, "expected a valid number for threshold, got 'abc'"),
        ("spherical", {"threshold": 0}, UsageError, "expected greater than 0 for threshold, got 0"),
        ("spherical", {"treshold": 1}, UnknownNameError, "unknown setting of spherical .*; did you mean 'threshold'"),
        ("spherical", {"weights": {"epi": 1}}, UnknownNameError, "of weights 'epi': .* did you mean 'epipolar'"),
        ("spherical", {"weights": 3}, UsageError, "weights: expected values of weights.epipolar, .*, got 3"),
        ("spherical", {"flow_parameters": {"level": 3}}, UnknownNameError, "flow farneback 'level': .* 'levels'"),
        ("spherical-visual-odometry", {"weights": {"positive_height": 0.2, "anti_parallel": 0.2}}, UsageError,
         r"positive_height and anti_parallel need the length of the translation.*scale=given"),
        ("spherical-visual-odometry", {"scale": "wheel"}, UsageError,
         "expected 'none' or 'given' for scale, got 'wheel'"),
        ("rigid-scene", {"objects": {"floating": 1.5}}, UsageError, "floating"),
        ("learned", {"threshold": 1}, UsageError, "expected less than 1 for threshold, got 1"),
        *(
            (name, {setting: value}, UsageError, f"{name}: expected")
            for name, setting, bad in (
                ("flow-magnitude", "threshold", (0, math.nan, math.inf)),
                ("rotation-compensated-flow", "cell_size_px", (0,)),
                ("frame-difference", "threshold_grey", (-1, 255, math.nan, math.inf)),
                ("background-subtraction", "images", (0, 2.5, math.nan, math.inf)),
                ("background-subtraction", "deviations", (-1, 0, math.nan, math.inf)),
            )
            for value in bad
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_built_is_refused(name, settings, error, message):
    with pytest.raises(error, match=message):
        build_method(name, settings)


def test_a_method_by_its_place_takes_values_of_the_annotated_type():
    assert set(METHODS) <= set(known_methods())
    built = build_method(HERE + "Annotated", {"threshold": 1, "images": None, "anything": "abc"})
    assert (built.threshold, built.images, built.anything) == (1.0, None, "abc")
    whole = build_method(HERE + "Whole", {"level": 7, "forgotten": "x"})
    assert whole.settings() == {"level": 7, "inner": {"scale": 0.5}, "forgotten": "x"}


def test_the_name_of_a_file_is_answered_by_how_its_method_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").touch()
    for name in ("mine", "mine.py", "./mine.py"):
        with pytest.raises(UnknownNameError, match=r"a method in it is mine:ITS_CLASS"):
            build_method(name)


class _SilentError(Exception):
    def __str__(self):
        raise ValueError("no message")


def _raise():
    raise _SilentError


UNFIT = {
    "name": (("name", 7), "method 7 of class Unfit: name: expected a valid string, got 7"),
    "no name": (("name", ""), "method '' of class Unfit: name: expected text to have at least 1 character, got ''"),
    "history": (("history", 1.5), "history: expected a valid integer, got 1.5"),
    "negative history": (("history", -1), "history: expected greater than or equal to 0, got -1"),
    "reads_images": (("reads_images", None), "reads_images: expected a valid boolean, got None"),
    "files": (("files", [None]), r"files: expected a valid string, got \[None\]"),
    "numpy": (("settings", lambda: {"a": np.float32(1)}), r"settings\(\): expected finite numbers, .*float32"),
    "number as name": (("settings", lambda: {1: 2}), r"settings\(\): expected a valid string, got {1: 2}"),
    "none": (("settings", lambda: None), r"settings\(\): expected a valid dictionary, got None"),
    "raises": (("settings", _raise), r"class Unfit: settings\(\): _SilentError: its message cannot be read"),
}


@pytest.mark.parametrize("case", UNFIT)
def test_an_attribute_that_is_not_what_the_contract_asks_for_is_named_with_its_class(case, monkeypatch):
    class Unfit(Bare):
        def __init__(self):
            setattr(self, *attribute)

    attribute, told = UNFIT[case]
    monkeypatch.setattr(f"{__name__}.Unfit", Unfit, raising=False)
    with pytest.raises(UsageError, match=told):
        build_method(f"{__name__}:Unfit")
    with pytest.raises(UsageError, match=told):
        require_scorable(Unfit())
