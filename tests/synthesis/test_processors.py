"""A recording has the same bytes on every processor: libraries are told to use the instructions of another one."""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest

from bench.synthesis.mesh import Surface, joined
from bench.synthesis.rays import RayScene, depths_m
from tests.synthesis.conftest import REAL, contents
from tests.synthesis.pictures import wall

PROGRAM = """
import sys
from pathlib import Path
from bench.synthesis import rays, synthesize
rays.EMBREEX = rays.EMBREEX and "open3d" not in sys.argv
synthesize(Path(sys.argv[1]), Path(sys.argv[2]), workers=1)
"""
FOUND = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])  # beyond what every processor has
OF_2008 = {
    "NPY_DISABLE_CPU_FEATURES": " ".join(FOUND),
    "OPENBLAS_CORETYPE": "Nehalem",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA",
    "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX512-ICL,AVX512F,AVX2,FMA3,AVX",
}


def differing_elsewhere(here, folder, *words, **environment):
    """Files of a small scenario that have other bytes when a process of its own renders it."""
    command = [sys.executable, "-c", PROGRAM, str(here / "scenario.yaml"), str(folder / "out"), *words]
    subprocess.run(command, env=os.environ | environment, check=True)
    one, other = contents(here / "out"), contents(folder / "out")
    assert one.keys() == other.keys()
    assert len([name for name in one if "/lidar/" in name]) == 6
    return [name for name in one if one[name] != other[name]]


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() != "x86_64", reason="switches of x86-64")
def test_same_bytes_with_the_instructions_of_a_processor_of_2008(rendered, tmp_path):
    assert differing_elsewhere(rendered(REAL), tmp_path, **OF_2008) == []


@pytest.mark.slow
def test_same_bytes_by_the_embree_of_open3d(rendered, tmp_path):
    assert differing_elsewhere(rendered(REAL), tmp_path, "open3d") == []


def face(x_m, albedo, y_m=(-5, 5)):
    return wall(x_m, Surface(albedo=albedo, contrast=0.0), y_m=y_m, height_m=5)


def test_of_faces_that_lie_on_each_other_the_first_is_met():
    layers = joined(face(30.1, 0.5), face(30.1, 0.2), face(30.1, 0.8), face(30.2, 0.1))
    assert depths_m(layers) == pytest.approx(np.repeat([0.0, 2e-4, 4e-4, 0.0], 2))
    rng = np.random.default_rng(3)
    rays = np.column_stack([np.ones(2000), *rng.uniform(-0.08, 0.08, (2, 2000))])
    hits = RayScene(layers.corners_m, depths_m(layers)).cast(rays, np.tile([0.0, 0.0, 2.5], (2000, 1)))
    assert set(hits.triangles) == {0, 1}
    assert hits.distances_m == pytest.approx(30.1, abs=1e-12)  # not less by how deep they are for Embree


def test_faces_side_by_side_or_of_one_look_lie_at_no_depth():
    assert not depths_m(joined(face(30.1, 0.5), face(30.1, 0.5), face(30.1, 0.2, y_m=(5, 15)))).any()
