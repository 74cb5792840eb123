"""No answer of a method is taken for more than it is, and none changes what it is scored against."""

import os
import sys
from dataclasses import replace

import numpy as np
import pytest

from bench.errors import BenchError
from bench.harness.frames import FramePipeline
from bench.harness.stored import read_run
from bench.methods import Method, Segmentation, ask_method, build_method
from bench.recordings import load_card, open_dataset
from tests.support.counts import read_tables
from tests.support.runs import score
from tests.support.troubled_runs import call


class Misbehaving(Method):
    """Answers each image as the function of its fault does."""

    def __init__(self, *, fault: str) -> None:
        self.fault, self.name = fault, f"misbehaving-{fault}"

    def segment(self, frame):
        return FAULTS[self.fault](frame)


def calm(frame, **changes):
    """An answer in cells of 4 px, changed in some fields."""
    height, width = frame.valid.shape
    cells = np.zeros((-(-height // 4), -(-width // 4)), dtype=bool)
    cells[10:20, 10:30] = True
    return replace(Segmentation(cell_size_px=4, mask=cells), **changes)


def likely(frame, value, *, score=False, **changes):
    """The calm answer with a likelihood that has a value in one of its cells."""
    likelihood = calm(frame).mask.astype(np.float32)
    likelihood[3, 4] = value
    return calm(frame, likelihood=likelihood, likelihood_is_score=score, **changes)


def helper(frame):
    raise ValueError(f"boom at\n{frame.timestamps_ns[-1]}")


def change_valid(frame):
    mask = frame.valid
    mask &= False
    return calm(frame)


def change_image(frame):
    frame.images[-1][:] = 0
    return calm(frame)


def force_valid(frame):
    """Not by accident: what it is given is made writeable first."""
    for array in (frame.valid, *frame.images, frame.road.down):
        array.flags.writeable = True
        array[:] = 0
    return calm(frame)


returned = []


def change_later(frame):
    """Answers that were returned are other ones afterwards."""
    for said in returned:
        said.mask[:] = True
    returned.append(calm(frame))
    return returned[-1]


def go_away(frame):
    os.chdir("/")
    return calm(frame)


def forbid_rounding(frame):
    """Every underflow an error for what follows."""
    np.seterr(all="raise")
    return calm(frame)


seen = []


def remember(frame):
    """Each answer depends on how many images the process was asked for before."""
    seen.append(frame.timestamps_ns[-1])
    said = calm(frame)
    said.mask[0, : len(seen) % said.mask.shape[1]] = True
    return said


CELLS = "a whole number from 1 to 320"
FAULTY = {  # the function, and what is told of it
    "returns_none": (lambda _: None, "expected a bench.methods.Segmentation from segment(), got NoneType"),
    "returns_array": (lambda f: calm(f).mask, "expected a bench.methods.Segmentation from segment(), got ndarray"),
    "float_mask": (
        lambda f: calm(f, mask=calm(f).mask.astype(np.float32)),
        "mask: expected a (60, 80) array of bool, got (60, 80) of float32",
    ),
    "wrong_shape": (
        lambda f: calm(f, cell_size_px=2),
        "mask: expected a (120, 160) array of bool, got (60, 80) of bool",
    ),
    "cell_size_zero": (lambda f: calm(f, cell_size_px=0), f"cell_size_px: expected {CELLS}, got 0"),
    "cell_size_huge": (
        lambda _: Segmentation(cell_size_px=10**30, mask=np.ones((1, 1), dtype=bool)),
        f"cell_size_px: expected {CELLS}, got 1000000000000000000000000000000",
    ),
    "not_finite": (
        lambda f: likely(f, np.nan),
        "likelihood: expected finite numbers, 0 where undefined, got 1 that are NaN or infinite",
    ),
    "negative": (lambda f: likely(f, -1), "likelihood: expected at least 0, got -1 to 1"),
    "score_above_one": (lambda f: likely(f, 2, score=True), "likelihood: expected a score in [0, 1], got 0 to 2"),
    "score_just_above_one": (
        lambda f: likely(f, 1 + 2**-23, score=True),
        "likelihood: expected a score in [0, 1], got 0 to 1.00000012",
    ),
    "threshold_of_something_else": (
        lambda f: likely(f, 1, score=True, threshold=1.5),
        "threshold: expected one of the likelihood, a score in [0, 1], got 1.5",
    ),
    "cause_out_of_range": (
        lambda f: calm(f, causes=("a", "b"), cause=np.full(calm(f).mask.shape, 2, np.uint8)),
        "cause: expected indices into 2 causes, got 2",
    ),
    "cause_without_causes": (
        lambda f: calm(f, cause=np.zeros(calm(f).mask.shape, np.uint8)),
        "cause: expected indices into 0 causes, got 0",
    ),
    "same_cause_twice": (
        lambda f: calm(f, causes=("a", "a"), cause=np.ones(calm(f).mask.shape, np.uint8)),
        "causes: expected a tuple of names, each once, got ('a', 'a')",
    ),
    "raises": (helper, "ValueError: boom at "),
    "exits": (lambda _: sys.exit(0), "SystemExit: 0"),
    "change_valid": (change_valid, "ValueError: output array is read-only"),
    "change_image": (change_image, "ValueError: assignment destination is read-only"),
    "bench_error": (lambda _: build_method("spherical", {"threshold": -1.0}), "threshold"),
}
HARMLESS = {
    function.__name__: function for function in (calm, force_valid, change_later, go_away, forbid_rounding, remember)
}
FAULTS = HARMLESS | {name: function for name, (function, _) in FAULTY.items()}


@pytest.mark.parametrize("fault", FAULTY)
def test_a_fault_is_told_with_method_recording_and_image(tiny_card, fault):
    recording, method = open_dataset(load_card(tiny_card))[0].open(), Misbehaving(fault=fault)
    given = FramePipeline(recording, "front", method=method).method_input(1)
    with pytest.raises(BenchError) as told:
        ask_method(method, given)
    where = f"method 'misbehaving-{fault}', recording {recording.name!r}, camera 'front', image at "
    assert str(told.value).startswith(f"{where}{given.timestamps_ns[-1]} ns")
    assert FAULTY[fault][1] in str(told.value)
    assert str(told.value).isprintable()


def test_a_fault_fails_its_images_and_shows_the_methods_own_lines(tiny_card, tmp_path):
    summary = score(tiny_card, tmp_path / "run", method=Misbehaving(fault="raises"))
    assert summary.images.failed == summary.images.images == len(summary.failures) > 0
    assert summary.objects.evaluated == summary.images.evaluated == 0
    assert "misbehaving_methods.py:" in summary.failures[0]
    assert "in helper: raise ValueError(" in summary.failures[0]
    _, frames = read_tables(tmp_path / "run")
    assert frames["problem"].to_pylist() == [*summary.failures]


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["change_later", "go_away", "forbid_rounding", "force_valid"])
def test_what_a_method_does_beside_its_answer_changes_nothing_for_it_or_the_next(
    tiny_card, tmp_path, monkeypatch, fault
):
    monkeypatch.chdir(tiny_card.parent)  # so that paths of the data are relative ones
    for number, name in enumerate(("calm", fault, "calm")):
        assert score(tiny_card.name, tmp_path / str(number), method=Misbehaving(fault=name)).failures == ()
    usual, *others = (read_run(tmp_path / str(number)) for number in range(3))
    for other in others:
        assert other.manifest.reference == usual.manifest.reference
        assert other.summary.categories == usual.summary.categories
        for one, changed in zip(read_tables(usual.folder), read_tables(other.folder), strict=True):
            assert one.equals(changed)


@pytest.mark.slow
def test_what_a_method_notes_in_a_module_is_found_out(tiny_card, tmp_path):
    out = tmp_path / "run"
    words = ("--method", f"{__name__}:Misbehaving", "--set", "fault=remember", "--workers")
    done = call(tiny_card, out, *words, "1")
    assert done.returncode == 2, done.stdout + done.stderr
    assert "expected the same answer when asked again at the end, got another" in done.stdout
    (failure,) = read_run(out).summary.failures
    assert "random numbers without a seed" in failure
    again = call(tiny_card, out, *words, "2")
    assert again.returncode == 2, "it is not forgotten"
    assert read_run(out).summary.failures == (failure,)
