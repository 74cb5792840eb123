"""What differs between two runs is answered in one place, in the same words for everybody."""

import pytest

from bench.errors import DataError
from bench.evaluation.protocol import load_protocol
from bench.harness.manifest import AnswersManifest, Aspect, differences, read_manifest, write_manifest
from tests.support.manifests import manifest

PLAIN = manifest(reference="a" * 64, recordings={"x": "0"})


def changed(part: str, **changes: object):
    return PLAIN.model_copy(update={part: getattr(PLAIN, part).model_copy(update=changes)})


@pytest.mark.parametrize(
    ("other", "told", "comparable", "decides"),
    [
        (changed("dataset", name="ours"), "data set 'ours', was 'demo'", False, True),
        (changed("dataset", split="night"), "split 'night', was none", False, True),
        (changed("dataset", input_errors={"yaw_deg": 0.5}), "yaw_deg = 0.5, was None", True, True),
        (changed("method", name="own"), "method 'own', was 'nothing'", True, True),
        (changed("method", settings={"a": {"b": 2}}), "a.b = 2, was None", True, True),
        (changed("method", asked={"a": {"b": 2}}), "a.b = 2, was None", True, True),
        (changed("method", code_digest="2" * 64), "the method's own code, or files: digest 2222", True, True),
        (
            changed("method", settings={"digest": "3" * 64}),
            "other predictions in the folder: digest 333333333333,",
            True,
            True,
        ),
        (changed("protocol", digest="e" * 64), "protocol paper-v1 version 1 (eeeeeeeeeeee), was paper-v1", False, True),
        (changed("code", commit="c0ffee+"), "commit c0ffee with changed files, was version 0 of an", True, False),
        (changed("code", answers="e" * 64), "other code of version 0 of an unknown commit: digest", True, True),
        (changed("code", counts="e" * 64), "other code of version 0 of an unknown commit: digest", True, True),
        (changed("code", libraries={"Python": "4"}), "Python 4, was 3", True, True),
        (changed("code", libraries={"Python": "3", "numpy": "2"}), "numpy 2, was not loaded", True, True),
        (changed("dataset", recordings={"x": "1"}), "data recordings changed: 'x' (1 of 1); digest ", True, True),
        (PLAIN.model_copy(update={"reference": "b" * 64}), "reference digest bbbbbbbbbbbb, was aaaaaaa", True, True),
    ],
)
def test_a_difference_says_what_it_is_and_what_it_means(other, told, comparable, decides):
    (found,) = differences(PLAIN, other)
    assert str(found).startswith(told)
    assert (found.comparable, found.decides) == (comparable, decides)


def test_the_same_run_and_what_one_does_not_know_yet_differ_in_nothing():
    unfinished = PLAIN.model_copy(update={"reference": None})
    assert differences(PLAIN, PLAIN) == differences(PLAIN, unfinished) == differences(unfinished, PLAIN) == ()
    by_another_name = changed("dataset", card="./demo.yaml")
    assert differences(PLAIN, by_another_name) == ()


def test_settings_of_other_methods_are_not_compared():
    other = manifest(method="own", settings={"threshold": 1}, reference="a" * 64, recordings={"x": "0"})
    assert [found.aspect for found in differences(PLAIN, other)] == [Aspect.METHOD]


def test_a_manifest_is_read_as_it_was_written(tmp_path):
    assert read_manifest(tmp_path) is None
    write_manifest(tmp_path / "manifest.json", PLAIN)
    assert read_manifest(tmp_path) == PLAIN
    for text, told in (("{}", "dataset: expected"), ("{", "expected")):
        (tmp_path / "manifest.json").write_text(text)
        with pytest.raises(DataError, match=rf"manifest\.json: {told}"):
            read_manifest(tmp_path)


def test_of_answers_alone_only_what_decides_them_is_compared():
    answers = AnswersManifest(dataset=PLAIN.dataset, method=PLAIN.method, code=PLAIN.code)
    counted = answers.model_copy(update={"code": PLAIN.code.model_copy(update={"counts": "e" * 64})})
    assert differences(answers, counted) == ()


def test_differences_come_in_the_order_of_cause():
    other = manifest(dataset="ours", method="own", protocol=load_protocol("surface-v1"), commit="c0ffee")
    assert [found.aspect for found in differences(manifest(), other)] == [
        Aspect.DATASET,
        Aspect.METHOD,
        Aspect.PROTOCOL,
        Aspect.CODE,
    ]
