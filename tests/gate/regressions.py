"""Mistakes that a change of code could bring in, each as a method: the paper's, given a wrong input."""

from dataclasses import dataclass, replace

from bench.geometry import RigidTransform
from bench.methods import MethodInput, Segmentation
from bench.methods.spherical.method import SphericalMethod


@dataclass(frozen=True, kw_only=True)
class YawSignFlipped(SphericalMethod):
    """The ego-motion's rotation is inverted and the translation kept, as a wrong sign of the yaw rate does."""

    def segment(self, frame: MethodInput) -> Segmentation:
        motions = tuple(RigidTransform(m.rotation.T, m.translation_m) for m in frame.current_from_previous)
        return super().segment(replace(frame, current_from_previous=motions))


@dataclass(frozen=True, kw_only=True)
class CalibrationShifted(SphericalMethod):
    """The principal point is 5 px to the right."""

    def segment(self, frame: MethodInput) -> Segmentation:
        u, v = frame.camera.principal_point
        return super().segment(replace(frame, camera=replace(frame.camera, principal_point=(u + 5.0, v))))
