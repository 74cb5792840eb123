"""Motion of a camera that is bolted to a moving vehicle."""

from __future__ import annotations

from bench.geometry import RigidTransform


def camera_motion(
    *,
    world_from_vehicle_previous: RigidTransform,
    world_from_vehicle_current: RigidTransform,
    vehicle_from_camera: RigidTransform,
) -> RigidTransform:
    """`current_from_previous` of the camera, lever arm included.

    A camera away from the vehicle's origin translates when the vehicle turns; the chain of frames takes care of it:
    camera <- vehicle (current) <- world <- vehicle (previous) <- camera.

    Source:
        Mariotti and Eising 2020, section III: R and t = C - C', expressed in the current camera frame.
    """
    vehicle_current_from_previous = world_from_vehicle_current.inverse() @ world_from_vehicle_previous
    return vehicle_from_camera.inverse() @ vehicle_current_from_previous @ vehicle_from_camera
