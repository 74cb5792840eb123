"""No answer of a method is taken for more than it is, and none changes what it is scored against."""

import pytest

from bench.harness import read_run, read_tables
from tests.harness.misbehaving import FAULTS, Misbehaving
from tests.support.runs import score
from tests.support.troubled_runs import call

pytestmark = pytest.mark.slow

FAULTY = {
    "returns_none": "expected a bench.methods.Segmentation from segment(), got NoneType",
    "returns_array": "expected a bench.methods.Segmentation from segment(), got ndarray",
    "float_mask": "mask: expected a (60, 80) array of bool, got (60, 80) of float32",
    "wrong_shape": "mask: expected a (120, 160) array of bool, got (60, 80) of bool",
    "cell_size_zero": "cell_size_px: expected a whole number from 1 to 320, got 0",
    "cell_size_huge": "cell_size_px: expected a whole number from 1 to 320, got 1000000000000000000000000000000",
    "not_finite": "likelihood: expected finite numbers, 0 where undefined, got 1 that are NaN or infinite",
    "negative": "likelihood: expected at least 0, got -1 to 0",
    "score_above_one": "likelihood: expected a score in [0, 1], got 0 to 2",
    "threshold_of_something_else": "threshold: expected one of the likelihood, a score in [0, 1], got 1.5",
    "cause_out_of_range": "cause: expected indices into 2 causes, got 2",
    "raises": "ValueError: boom at ",
    "exits": "SystemExit: 0",
    "change_valid": "ValueError: output array is read-only",
    "change_image": "ValueError: assignment destination is read-only",
    "bench_error": "threshold",
}


def test_every_fault_is_tried():
    assert FAULTY.keys() == FAULTS.keys() - {
        "none",
        "force_valid",
        "change_later",
        "go_away",
        "lower_limits",
        "remember",
    }


@pytest.mark.parametrize("fault", FAULTY)
def test_a_fault_fails_its_image_and_names_method_recording_and_image(tiny_card, tmp_path, fault):
    summary = score(tiny_card, tmp_path / "run", method=Misbehaving(fault=fault))
    assert summary.images.failed == summary.images.images > 0
    assert summary.images.evaluated == 0
    assert summary.objects.evaluated == 0
    for failure in summary.failures:
        assert failure.startswith(f"method 'misbehaving-{fault}', recording '")
        assert "camera 'front', image at " in failure
        assert FAULTY[fault] in failure
    _, frames = read_tables(tmp_path / "run" / "paper-v1")
    assert set(frames["recording"].to_pylist()) == {f.split("recording '")[1].split("'")[0] for f in summary.failures}
    assert not list(tmp_path.rglob("*escaped*"))


def test_what_a_method_raises_is_shown_with_its_own_lines(tiny_card, tmp_path):
    failures = score(tiny_card, tmp_path / "run", method=Misbehaving(fault="raises")).failures
    assert "misbehaving.py:" in failures[0]
    assert "in helper: raise ValueError(" in failures[0]
    assert all(failure.isprintable() for failure in failures)


@pytest.mark.parametrize("fault", ["raises", "exits", "returns_none"])
def test_the_command_ends_with_2(tiny_card, tmp_path, fault):
    place = "tests.harness.misbehaving:Misbehaving"
    out = tmp_path / "run"
    done = call(tiny_card, out, "--method", place, "--set", f"fault={fault}", "--workers", "2")
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"misbehaving-{fault}" in done.stdout + done.stderr
    assert (out / "paper-v1" / "summary.json").exists(), done.stdout + done.stderr
    assert read_run(out).summary.images.evaluated == 0


@pytest.mark.parametrize("fault", ["change_later", "go_away", "lower_limits"])
def test_what_a_method_does_after_or_beside_its_answer_changes_no_score(tiny_card, tmp_path, monkeypatch, fault):
    monkeypatch.chdir(tiny_card.parent)  # so that paths of the data are relative ones
    calm, other = (score(tiny_card.name, tmp_path / name, method=Misbehaving(fault=name)) for name in ("none", fault))
    assert (other.all_moving, other.false_positives) == (calm.all_moving, calm.false_positives)
    assert other.failures == ()


def test_what_a_method_notes_in_a_module_is_found_out(tiny_card, tmp_path):
    out = tmp_path / "run"
    words = ("--method", "tests.harness.misbehaving:Misbehaving", "--set", "fault=remember", "--workers")
    done = call(tiny_card, out, *words, "1")
    assert done.returncode == 2, done.stdout + done.stderr
    assert "expected the same answer when asked again at the end, got another" in done.stdout
    (failure,) = read_run(out).summary.failures
    assert "random numbers without a seed" in failure
    again = call(tiny_card, out, *words, "2")
    assert again.returncode == 2, "it is not forgotten"
    assert read_run(out).summary.failures == (failure,)


def test_a_method_cannot_change_what_it_is_scored_against(tiny_card, tmp_path):
    """Nor what others find: the reference and the metrics are those of a method that changes nothing."""
    names = ("none", "force_valid", "none")
    for number, name in enumerate(names):
        score(tiny_card, tmp_path / str(number), method=Misbehaving(fault=name))
    calm, forced, later = (read_run(tmp_path / str(number)) for number in range(len(names)))
    assert forced.manifest.reference == calm.manifest.reference == later.manifest.reference
    for other in (forced, later):
        assert other.summary.categories == calm.summary.categories
        assert other.summary.false_positives == calm.summary.false_positives
        for one, changed in zip(read_tables(calm.folder), read_tables(other.folder), strict=True):
            assert one.equals(changed)
