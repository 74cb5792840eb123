"""Names of objects that may not become files."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import DataError
from bench.recordings.remote.urls import parse_place, refuse_unsafe

URL = parse_place("s3://bench/x")


@pytest.mark.parametrize(
    "name",
    ["../x", "a/../../x", "/etc/x", "a//b", "a/./b", "..", ".", "", "a/", "a\\b", "C:/x", "a\nb", "a\0b", "x" * 256,
     "\u202egnp.exe"],
)  # fmt: skip
def test_names_that_lead_elsewhere_are_refused(name):
    with pytest.raises(DataError, match="names of objects that can be files"):
        refuse_unsafe(URL, ["fine/1.png", name])


def test_a_file_that_is_also_a_folder_is_refused():
    with pytest.raises(DataError, match="both of 'a/b'"):
        refuse_unsafe(URL, ["a/b", "a/b/c/d"])
    with pytest.raises(DataError, match="both of 'a'"):
        refuse_unsafe(URL, ["a", "a"])


@given(st.lists(st.text(st.characters(codec="ascii") | st.sampled_from("./\\")), max_size=4))
def test_what_is_not_refused_stays_inside(tmp_path_factory, names):
    root = tmp_path_factory.getbasetemp() / "root"
    try:
        refuse_unsafe(URL, names)
    except DataError:
        return
    assert all((root / name).resolve().is_relative_to(root) and (root / name).resolve() != root for name in names)
