"""Visual odometry on a real fisheye camera: a straight motorway at night, passed vehicles in view."""

import numpy as np

from bench.egomotion import VisualOdometry, camera_motion
from bench.flow import LucasKanadeTracker
from bench.recordings import load_card, open_dataset, read_image
from tests.support.real import needs_real


@needs_real
def test_direction_and_turn_of_a_car_that_drives_straight_on():
    recording = open_dataset(load_card("datasets/aimotive-sample.yaml"))[0].open()
    camera, images = recording.cameras["M_FISHEYE_R"], recording.images["M_FISHEYE_R"]
    turns_deg, off_deg = [], []
    for previous, current in zip(images[0:-1:6], images[1::6], strict=False):
        pair = [read_image(image, camera, colour=False) for image in (current, previous)]
        tracks = LucasKanadeTracker()(pair, valid=None if camera.ego_body is None else ~camera.ego_body)
        rays = [camera.model.unproject(pixels[tracks.followed[1]])[0] for pixels in tracks.pixels]
        found = VisualOdometry()(rays[1], rays[0])
        poses = [recording.trajectory.world_from_vehicle(image.timestamp_ns) for image in (previous, current)]
        driven = camera_motion(
            world_from_vehicle_previous=poses[0],
            world_from_vehicle_current=poses[1],
            vehicle_from_camera=camera.vehicle_from_camera,
        ).translation_m
        turns_deg.append(np.degrees(np.arccos(np.clip((np.trace(found.rotation) - 1) / 2, -1, 1))))
        off_deg.append(np.degrees(np.arccos(np.clip(found.direction @ driven / np.linalg.norm(driven), -1, 1))))
    assert len(off_deg) >= 8
    assert np.median(off_deg) < 2  # single images, filled by a passing van, may take its motion for the camera's
    assert np.median(turns_deg) < 0.2
