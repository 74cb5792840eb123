"""Labels that a person made or changed are replaced on request alone, and a copy of them stays."""

import pytest

from bench.annotation.export import store_labels
from bench.errors import OutputError

FILES = {"a.json": b"a", "drive/b.csv": b"b"}


def test_what_was_written_before_is_replaced(tmp_path):
    store_labels(tmp_path / "out", FILES)
    assert store_labels(tmp_path / "out", {"a.json": b"other"}) == ()
    assert (tmp_path / "out/a.json").read_bytes() == b"other"
    assert (tmp_path / "out/drive/b.csv").read_bytes() == b"b"


@pytest.mark.parametrize("made", ["by hand", "changed by hand", "an unreadable record"])
def test_what_a_person_made_stays_unless_asked_and_then_as_a_copy(tmp_path, made):
    if made != "by hand":
        store_labels(tmp_path, FILES)
    if made == "an unreadable record":
        (tmp_path / ".written-labels").write_bytes(b"[\0")
    (tmp_path / "drive").mkdir(exist_ok=True)
    (tmp_path / "drive/b.csv").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"labels that a person made or changed; .*--overwrite, which keeps a copy"):
        store_labels(tmp_path, {"a.json": b"new", "drive/b.csv": b"new"})
    assert (tmp_path / "drive/b.csv").read_bytes() == b"mine"
    assert not (tmp_path / "a.json").exists() or (tmp_path / "a.json").read_bytes() == b"a"  # all or none
    copies = store_labels(tmp_path, {"drive/b.csv": b"new"}, overwrite=True)
    assert copies == (tmp_path / "drive/b.csv.1",)
    assert (tmp_path / "drive/b.csv.1").read_bytes() == b"mine"
    (tmp_path / "drive/b.csv").write_bytes(b"mine again")
    assert store_labels(tmp_path, {"drive/b.csv": b"new"}, overwrite=True) == (tmp_path / "drive/b.csv.2",)
    assert store_labels(tmp_path, {"drive/b.csv": b"newer"}) == ()
    assert sorted(path.name for path in (tmp_path / "drive").iterdir()) == ["b.csv", "b.csv.1", "b.csv.2"]


def test_equal_labels_are_nobodys_loss(tmp_path):
    (tmp_path / "a.json").write_bytes(b"a")
    assert store_labels(tmp_path, {"a.json": b"a"}) == ()


def test_a_folder_in_the_way_is_one_line(tmp_path):
    (tmp_path / "a.json").mkdir()
    with pytest.raises(OutputError, match="a folder or device"):
        store_labels(tmp_path, {"a.json": b"a"}, overwrite=True)
