"""What differs between two runs is answered in one place, in the same words for everybody."""

import pytest

from bench.errors import DataError
from bench.evaluation import load_protocol
from bench.harness.manifest import Aspect, differences, read_manifest, write_manifest
from tests.support.manifests import manifest, method_of_run

PLAIN = manifest(reference="a" * 64)


def changed(part: str, **changes: object):
    return PLAIN.model_copy(update={part: getattr(PLAIN, part).model_copy(update=changes)})


@pytest.mark.parametrize(
    ("other", "told", "comparable", "of_the_request"),
    [
        (changed("dataset", name="ours"), "data set 'ours', was 'demo'", False, True),
        (changed("dataset", split="night"), "split 'night', was none", False, True),
        (changed("dataset", input_errors={"yaw_deg": 0.5}), "yaw_deg = 0.5, was None", True, True),
        (changed("method", name="own"), "method 'own', was 'nothing'", True, True),
        (changed("method", settings={"a": {"b": 2}}), "a.b = 2, was None", True, True),
        (changed("method", asked={"a": {"b": 2}}), "a.b = 2, was None", True, True),
        (changed("method", settings={"digest": "x"}), "digest = x, was None", True, False),
        (changed("protocol", digest="e" * 64), "protocol paper-v1 version 1 (eeeeeeeeeeee), was paper-v1", False, True),
        (changed("code", commit="c0ffee+"), "commit c0ffee with changed files, was version 0 of an", True, False),
        (changed("code", python="4"), "Python 4, was 3", True, False),
        (changed("code", libraries={"numpy": "2"}), "numpy 2, was not loaded", True, False),
        (
            changed("dataset", data="f" * 64, recordings={"x": "1"}),
            "data digest ffffffffffff, was ",
            True,
            False,
        ),
        (PLAIN.model_copy(update={"reference": "b" * 64}), "reference digest bbbbbbbbbbbb, was aaaaaaa", True, False),
    ],
)
def test_a_difference_says_what_it_is_and_what_it_means(other, told, comparable, of_the_request):
    (found,) = differences(PLAIN, other)
    assert str(found).startswith(told)
    assert (found.comparable, found.of_the_request) == (comparable, of_the_request)


def test_the_same_run_and_what_one_does_not_know_yet_differ_in_nothing():
    unfinished = changed("dataset", data=None).model_copy(update={"reference": None})
    assert differences(PLAIN, PLAIN) == differences(PLAIN, unfinished) == differences(unfinished, PLAIN) == ()
    by_another_name = changed("dataset", card="./demo.yaml")
    assert differences(PLAIN, by_another_name) == ()


def test_settings_of_other_methods_are_not_compared():
    other = manifest(method="own", settings={"threshold": 1}, reference="a" * 64)
    assert [found.aspect for found in differences(PLAIN, other)] == [Aspect.METHOD]


def test_code_of_a_method_is_compared():
    one, two = (PLAIN.model_copy(update={"method": method_of_run("nothing", code_digest=digit * 64)}) for digit in "12")
    (found,) = differences(one, two)
    assert found.aspect is Aspect.METHOD_CODE
    assert "the method's own code, libraries or files" in str(found)


def test_a_manifest_is_read_as_it_was_written_or_not_at_all(tmp_path):
    assert read_manifest(tmp_path) is None
    write_manifest(tmp_path, PLAIN)
    assert read_manifest(tmp_path) == PLAIN
    file = tmp_path / "manifest.json"
    file.write_text(file.read_text().replace("demo", "dema"))
    with pytest.raises(DataError, match="expected the manifest of a run"):
        read_manifest(tmp_path)


def test_differences_come_in_the_order_of_cause():
    other = manifest(dataset="ours", method="own", protocol=load_protocol("surface-v1"), commit="c0ffee")
    assert [found.aspect for found in differences(manifest(), other)] == [
        Aspect.DATASET,
        Aspect.METHOD,
        Aspect.PROTOCOL,
        Aspect.CODE,
    ]
