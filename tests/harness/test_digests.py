"""Equal values have equal digests, in every process; any change shows."""

import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import PurePosixPath

import numpy as np
import pytest
from pydantic import BaseModel
from scipy.spatial.transform import Rotation

from bench.harness.digests import digest_of

GRID = np.arange(6.0).reshape(2, 3)


@dataclass(frozen=True)
class Pair:
    one: object
    two: object


class Model(BaseModel):
    one: int
    two: float = 0.0

    @cached_property
    def worked_out(self) -> int:
        return self.one + 1


DIFFERENT: list[object] = [
    *[None, False, True, 0, 1, -1, 1.0, -0.0, 0.0, float("nan"), float("inf"), "", "1", b"1"],
    *[PurePosixPath("1"), (), [], {}, (1,), (1, 2), (2, 1), ((1,), 2), ((1, 2),)],
    *[("a", "bstrc"), ("astrb", "c")],  # one after the other, the same bytes
    *[{"a": 1}, {"a": 2}, {"b": 1}, Pair(1, 2), Pair(2, 1), Pair((1, 2), ())],
    *[np.zeros(2), np.zeros(3), np.zeros(2, dtype=np.float32), np.zeros((2, 1)), np.array([0, 0]), GRID, GRID.T],
    *[np.array([0.0, -0.0]), np.array([np.nan, 0.0]), np.float64(1.0), np.float32(1.0)],
    *[Rotation.identity(), Rotation.from_rotvec([0, 0, 1e-9])],
    *[Model(one=1), Model(one=2), Model(one=1, two=1e-12)],
    *[digest_of, Pair, partial(digest_of), partial(digest_of, 1), partial(digest_of, one=1)],
]


def test_different_values_have_different_digests():
    digests = [digest_of(value) for value in DIFFERENT]
    twice = [(DIFFERENT[i], DIFFERENT[k]) for i in range(len(digests)) for k in range(i) if digests[i] == digests[k]]
    assert not twice


def test_order_of_mappings_layout_in_memory_and_what_a_model_worked_out_do_not_count():
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})
    assert digest_of(np.asfortranarray(GRID)) == digest_of(GRID)
    model = Model(one=1)
    assert model.worked_out == 2
    assert digest_of(model) == digest_of(Model(one=1))


def test_every_process_gives_the_same():
    told = (
        "from bench.harness.digests import digest_of; print(digest_of({'a': {'x': 'y', 'z': 1}, 'b': (1, 2.5, None)}))"
    )
    words, other = [sys.executable, "-c", told], {"PYTHONHASHSEED": "1"}
    done = subprocess.run(words, env=other, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digest_of({"a": {"x": "y", "z": 1}, "b": (1, 2.5, None)})


def test_what_it_does_not_know_is_refused():
    with pytest.raises(TypeError, match="generator"):
        digest_of([1, (i for i in range(2))])
