"""docs/examples/write_carla.py on numbers in CARLA's conventions, made by hand: CARLA itself is not installed here."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bench
from bench.recordings import open_native

FILE = Path(__file__).parents[1] / "docs/examples/write_carla.py"


@pytest.fixture(scope="module")
def example():
    spec = spec_from_file_location("write_carla", FILE)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def vector(x, y, z):
    return SimpleNamespace(x=x, y=y, z=z)


def heading_left(*place):
    return SimpleNamespace(location=vector(*place), rotation=SimpleNamespace(roll=0.0, pitch=0.0, yaw=-90.0))


def tick(index):
    """The ego vehicle drives at yaw -90 and 5 m/s; a car 7 m ahead of its middle and 3 m to the right goes with it."""
    time_s = 0.1 * index
    car = SimpleNamespace(
        id=7,
        type_id="vehicle.audi.tt",
        attributes={"number_of_wheels": "4"},
        transform=heading_left(13.0, 13.0 - 5.0 * time_s, 0.0),
        velocity=vector(0.0, -5.0, 0.0),
        bounding_box=SimpleNamespace(location=vector(0.0, 0.0, 0.7), extent=vector(2.0, 0.9, 0.7)),
    )
    y, z = (part.ravel() for part in np.meshgrid(np.linspace(-0.88, 0.88, 30), np.linspace(0.1, 1.35, 20)))
    # the car's rear, in the lidar's axes of CARLA: y to the right; the lidar sits in the vehicle's middle, 2 m up
    points = np.stack([np.full(y.shape, 5.02), 3.0 + y, z - 2.0, np.ones(y.shape)], axis=1).astype(np.float32)
    image = np.zeros((600, 600, 4), dtype=np.uint8)
    image[:, 300:] = 200  # bright to the right
    ego = heading_left(10.0, 20.0 - 5.0 * time_s, 0.0)
    return SimpleNamespace(time_s=time_s, ego=ego, image=image, points=points, actors=[car])


def test_a_drive_of_carla_is_read_as_it_was(example, tmp_path):
    example.write_drive(tmp_path / "drives/town-01", [tick(index) for index in range(4)])
    recording = open_native(tmp_path / "drives/town-01")
    (track,) = recording.tracks
    state = track.states[0]
    assert state.shape.vehicle_from_object.translation_m == pytest.approx([8.4, -3.0, 0.7])
    assert state.shape.vehicle_from_object.rotation == pytest.approx(np.eye(3), abs=1e-12)
    assert state.shape.size_m == pytest.approx([4.0, 1.8, 1.4])
    assert state.velocity_mps == pytest.approx([5.0, 0.0, 0.0], abs=1e-12)

    card = tmp_path / "carla.yaml"
    card.write_text("name: carla\ntitle: CARLA\nadapter: native\nroot: drives\nlicence: CC-BY-4.0\n")
    frames = list(bench.open_dataset(card).frames())
    assert (len(frames), *frames[0].image[240, [310, 330]]) == (3, 0, 200)
    (seen,) = frames[0].reference.objects
    assert (seen.status, seen.category in ("preceding", "overtaking")) == ("evaluated", True)
    columns = np.nonzero(frames[0].reference.labels)[1]
    assert len(columns) > 100
    assert columns.min() > 320  # to the right
