"""The paper's formulas on exact flow and ego-motion: what is left of a rendered data set's errors is the method's own.

    fisheye-bench run CARD --method benchmarks.exact_flow:SphericalOnExactFlow --set scenario=FILE

It casts rays into the scene that the images were rendered from, as the scenario's file says. Nobody else has exact
flow, so its settings say `sees_the_truth`, and the leaderboard marks it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import bench.synthesis
from bench.errors import DataError, UsageError
from bench.methods import MethodInput, Segmentation
from bench.methods.spherical.method import SphericalMethod
from bench.reference.exposure import visible_region
from bench.synthesis import Scenario, read_scenario
from bench.synthesis.ego import mounted_rig
from bench.synthesis.exact_flow import ExactFlowCaster
from bench.synthesis.scene import build_scene


@dataclass(frozen=True, kw_only=True)
class SphericalOnExactFlow(SphericalMethod):
    """The paper's method on exact flow, ego-motion and road of a rendered data set, which no camera shows.

    Attributes:
        scenario: the file that the data set was rendered from.
        sees_the_truth: the mark by which a table tells it from methods.
    """

    name = "exact-flow"
    reads_images = False

    scenario: str
    sees_the_truth: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sees_the_truth is not True:
            raise UsageError(f"exact-flow: it sees the true scene and nothing else, got {self.sees_the_truth!r}")

    @property
    def files(self) -> tuple[Path, ...]:  # type: ignore[override]
        """Files that decide its answer beside the methods' own code: the scenario, this file, the generator."""
        generator = sorted(Path(bench.synthesis.__path__[0]).rglob("*.py"))
        return Path(self.scenario), Path(__file__), *generator

    def segment(self, frame: MethodInput) -> Segmentation:
        """Segment the last image of the pair.

        Raises:
            DataError: the scenario has no such recording or camera.
        """
        caster = _caster(self.scenario, frame.recording, frame.camera_name, self.cell_size_px)
        previous_ns, current_ns = frame.timestamps_ns[-2:]
        flow = caster.flow(current_ns=current_ns, previous_ns=previous_ns).flow.astype(np.float32)
        motion = caster.motion(current_ns=current_ns, previous_ns=previous_ns)
        exact = replace(
            frame,
            road=caster.road(current_ns),
            current_from_previous=(*frame.current_from_previous[:-1], motion),
        )
        return self.segment_flow(exact, flow)


@lru_cache(maxsize=1)
def _scenario(file: str) -> Scenario:
    return read_scenario(Path(file))


@lru_cache(maxsize=1)  # a drive is scored image by image, and a scene takes a second to build
def _caster(file: str, recording: str, camera: str, cell_size_px: int) -> ExactFlowCaster:
    scenario = _scenario(file)
    spec = next((spec for spec in scenario.recordings if spec.name == recording), None)
    cameras = {} if spec is None else mounted_rig(scenario, spec).cameras
    if spec is None or camera not in cameras:
        got = f"none of {recording!r}, camera {camera!r}"
        hint = "name the scenario that the data set was rendered from, with --set scenario=FILE"
        raise DataError(Path(file), expected="the recording and camera of the image", got=got, hint=hint)
    true = cameras[camera]
    return ExactFlowCaster(build_scene(scenario, spec), true, valid=visible_region(true), cell_size_px=cell_size_px)
