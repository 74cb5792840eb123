"""The one import of open3d."""

import os
import subprocess
import sys

import numpy as np
import pytest

from bench.errors import UsageError
from bench.synthesis import rays


@pytest.fixture
def library():
    """The module open3d; where it does not load, tests are skipped but in CI, whose script installs what it needs."""
    try:
        return rays._open3d()
    except UsageError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))


def test_rays_meet_the_same_by_embreex_and_open3d(library):
    rng = np.random.default_rng(7)
    corners = rng.normal(size=(60, 3, 3)).astype(np.float32)
    origins, directions = rng.normal(size=(2, 500, 3)).astype(np.float32)
    if not rays.EMBREEX:
        pytest.skip("embreex has no wheel here")
    ours, other = (make(corners)(origins, directions) for make in (rays._embreex_scene, rays._open3d_scene))
    assert 100 < (ours >= 0).sum() < 450
    np.testing.assert_array_equal(ours, other)


def test_open3d_loads_without_the_viewers_that_it_brings(library):
    program = (
        "import sys; sys.modules['plotly'] = sys.modules['dash'] = None\n"
        "from bench.synthesis.rays import _open3d\n"
        "print(_open3d().core.Tensor([1.0]).shape, 'open3d.visualization' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout == "SizeVector[1] False\n", done.stderr


def test_an_open3d_that_does_not_load_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(UsageError, match=r"open3d: expected a library that loads.*apt-get install"):
        rays._open3d.__wrapped__()
