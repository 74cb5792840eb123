"""Files appear whole or not at all; errors come whole from other processes."""

import pickle

import pytest

from bench.atomic import replacing, write_text
from bench.errors import DataError, OutputError, UnknownNameError


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "deep/a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:  # noqa: PT012 - the block is what fails
        temporary.write_text("half")
        assert (temporary.suffix, temporary.name[0]) == (".txt", ".")
        raise RuntimeError
    assert (path.read_text(), list(path.parent.iterdir())) == ("old", [path])
    write_text(path, "new")
    assert (path.read_text(), list(path.parent.iterdir())) == ("new", [path])


@pytest.mark.parametrize(
    "error",
    [
        DataError("drive.json", field="camera", expected="a lens", got="none", hint="add one"),
        OutputError("out", got="a full disk", hint="free some space"),
        UnknownNameError("method", "sperical", ["spherical"], hint="list them"),
    ],
)
def test_an_error_comes_whole_from_another_process(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), vars(again)) == (type(error), str(error), vars(error))
