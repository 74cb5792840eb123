"""What images are called, and which of them need a prediction."""

from dataclasses import replace
from pathlib import Path

import pytest

from bench.methods.predictions.images import camera_images
from bench.recordings import Exclusion, ImageRef, RecordingHandle, load_card, open_dataset

STEP_NS = 66_666_667


@pytest.fixture
def recording(tiny_card):
    return open_dataset(load_card(str(tiny_card)))[0].open()


def handle_of(recording, refs, exclusions=()) -> RecordingHandle:
    images = {"front": tuple(ImageRef(camera="front", timestamp_ns=t, path=Path(f"{s}.png")) for t, s in refs)}
    opened = replace(recording, images=images)
    return RecordingHandle(name=recording.name, opener=lambda: opened, exclusions=exclusions)


def listed(handle, **options) -> list[tuple[int, str, bool]]:
    (camera,) = camera_images(handle, **options)
    return [(image.frame, image.file.removesuffix(".png"), image.scored) for image in camera.images]


def test_numbers_that_name_files_are_frame_numbers_unless_they_are_times(recording):
    times = [k * STEP_NS for k in range(3)]
    for stems, expected in (
        (("0000000250", "0000000251", "0000000253"), [250, 251, 253]),
        (("00000_FV", "00001_FV", "00002_FV"), [0, 1, 2]),
        (map(str, times), [0, 1, 2]),
        (("1", "01", "2"), [0, 1, 2]),
    ):
        handle = handle_of(recording, zip(times, stems, strict=True))
        assert [frame for frame, _, _ in listed(handle, history=1)] == expected


def test_images_without_their_history_are_not_scored(recording):
    steps = (0, 1, 2, 4, 5, 6)  # one is missing
    refs = [(k * STEP_NS, f"x{k}") for k in steps]
    for history, expected in ((1, [1, 2, 5, 6]), (2, [2, 6])):
        found = listed(handle_of(recording, refs), history=history)
        assert [k for k, image in zip(steps, found, strict=True) if image[2]] == expected


def test_excluded_images_are_there_under_their_numbers_but_not_scored(recording):
    refs = [(k * STEP_NS, f"x{k}") for k in range(6)]
    start = Exclusion(recording=recording.name, reason="late", frames=(None, 1))
    scored = [(frame, is_scored) for frame, _, is_scored in listed(handle_of(recording, refs, (start,)), history=1)]
    assert scored == [(0, False), (1, False), (2, False), (3, True), (4, True), (5, True)]


def test_sizes_are_those_evaluated_and_stored(recording):
    camera = recording.cameras["front"]
    smaller = replace(camera, model=camera.model.scaled(160, 120))
    refs = {"front": recording.images["front"]}
    opened = replace(recording, cameras={"front": smaller}, images=refs)
    (found,) = camera_images(RecordingHandle(name=recording.name, opener=lambda: opened), history=1)
    assert (found.sizes.evaluated_px, found.sizes.stored_px) == ((160, 120), (320, 240))
