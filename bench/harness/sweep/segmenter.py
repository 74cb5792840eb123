"""One image segmented for every value of a sweep; what the values have in common is computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.harness.keys import code_digest
from bench.harness.stages import StageClock
from bench.harness.sweep.perturb import NONE, believed, with_noise
from bench.harness.sweep.trial import Trial
from bench.harness.units import Unit
from bench.methods import MethodInput, Segmentation, ask_method
from bench.methods.contract import compute_anew
from bench.methods.spherical.method import Measurement, SphericalMethod
from bench.methods.spherical.visual import SCALE_FREE
from bench.recordings import Recording


class TrialSegmenter:
    """Segments the images of a unit for every trial.

    Trials that differ only in weights and thresholds share the measurement, those that differ in what the method is
    told share the flow. Another method than the spherical one is called once per injection.

    Args:
        trials: what to segment.
        recording: of the unit.
        unit: which images.
        clock: adds up the time of each stage.
    """

    def __init__(self, trials: Sequence[Trial], *, recording: Recording, unit: Unit, clock: StageClock) -> None:
        self._trials, self._recording, self._unit, self._clock = trials, recording, unit, clock
        self._flow_of = numbered([_flow_setting(trial) for trial in trials])
        self._measurement_of = numbered([_measured(trial) for trial in trials])
        self._segmentation_of = numbered([(trial.method, trial.injection) for trial in trials])

    def segment(self, given: MethodInput) -> list[Segmentation]:
        """Segment an image for every trial, in their order.

        Raises:
            DataError: no ego-motion at the times that a trial asks for.
        """
        flows: dict[int, NDArray[np.float32]] = {}
        measured: dict[int, Measurement] = {}
        made: dict[int, Segmentation] = {}
        for index, trial in enumerate(self._trials):
            number = self._segmentation_of[index]
            if number in made:
                continue
            if not isinstance(trial.method, SphericalMethod):
                with self._clock.stage("method"):
                    made[number] = ask_method(trial.method, self._told(self._noisy(given, trial), trial))
                continue
            flow, measurement = self._flow_of[index], self._measurement_of[index]
            if flow not in flows:
                with self._clock.stage("flow"):
                    flows[flow] = trial.method.kept_flow(self._noisy(given, trial), altered=self._noise(given, trial))
            with self._clock.stage("method"):
                if measurement not in measured:
                    told = self._told(self._noisy(given, trial), trial)  # a method may find its motion in the images
                    measured[measurement] = trial.method.measure(told, flows[flow])
                made[number] = trial.method.judge(measured[measurement])
        return [made[number] for number in self._segmentation_of]

    def _noise(self, given: MethodInput, trial: Trial) -> object:
        """What the noise of the images depends on; None where there is none."""
        strength_grey = trial.injection.image_noise_grey
        if strength_grey == 0:
            return None
        return code_digest(("harness/sweep/perturb.py",)), self._name, given.timestamps_ns, strength_grey

    def _noisy(self, given: MethodInput, trial: Trial) -> MethodInput:
        return with_noise(given, name=self._name, strength_grey=trial.injection.image_noise_grey)

    @property
    def _name(self) -> str:
        return f"{self._unit.recording} {self._unit.camera}"

    def _told(self, given: MethodInput, trial: Trial) -> MethodInput:
        mounted, trajectory = self._recording.cameras[self._unit.camera], self._recording.trajectory
        told = believed(given, mounted=mounted, trajectory=trajectory, injection=trial.injection)
        return told if trial.injection == NONE else replace(told, kept=compute_anew)


def numbered(items: Sequence[object]) -> list[int]:
    """Equal items have equal numbers, counted from 0 by first appearance; nothing needs a hash."""
    known: list[object] = []
    numbers = []
    for item in items:
        if item not in known:
            known.append(item)
        numbers.append(known.index(item))
    return numbers


def _flow_setting(trial: Trial) -> object:
    """What decides the flow on cells; None for a method whose flow is its own affair."""
    method = trial.method
    if not isinstance(method, SphericalMethod):
        return None
    parameters = sorted(method.flow_parameters.items())
    return method.flow, parameters, method.cell_size_px, trial.injection.image_noise_grey


def _measured(trial: Trial) -> object:
    """What decides the measurement: all but weights and thresholds."""
    method = trial.method
    if isinstance(method, SphericalMethod):
        method = replace(method, weights=SCALE_FREE, root_sum=False, threshold=1.0, static_threshold=1.0)
    return method, trial.injection
