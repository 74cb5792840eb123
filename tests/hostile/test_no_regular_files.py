"""Pipes, devices and folders in the place of files: each is an error that names it, and nothing waits for it."""

import os

import pytest

from bench.errors import DataError
from bench.recordings import load_card, open_dataset, read_image
from tests.support import tiny
from tests.support.cards import write_card
from tests.support.commands import called_here
from tests.support.limits import at_most

DRIVE, FIRST = "data/drive", tiny.TIMES_NS[0]
FILES = (
    "x.yaml",
    *(f"{DRIVE}/{name}" for name in ("recording.json", "annotations.json", "egomotion.csv", "ego_body/front.png")),
    *(f"{DRIVE}/images/front/{FIRST}.png", f"{DRIVE}/lidar/{tiny.TIMES_NS[1]}.npz"),
)
KINDS = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": lambda path: path.mkdir(),
}


@pytest.fixture(autouse=True)
def _never_waits():
    with at_most(60):
        yield


@pytest.fixture
def folder(tmp_path):
    tiny.write_recording(tmp_path / DRIVE)
    write_card(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FILES)
def test_files_of_a_data_set(folder, kind, name):
    (folder / name).unlink()
    KINDS[kind](folder / name)
    with pytest.raises(DataError) as caught:  # noqa: PT012 - which step finds it depends on the file
        for handle in open_dataset(load_card(folder / "x.yaml")):
            recording = handle.open()
            for image in recording.images["front"]:
                read_image(image, recording.cameras["front"])
            for sweep in recording.sweeps:
                sweep.read()
    assert (folder / name).stem in str(caught.value)


def test_a_pipe_among_the_predictions(folder):
    place = folder / "masks" / "front"
    place.mkdir(parents=True)
    os.mkfifo(place / f"{FIRST + 66_666_667}.png")
    done = called_here("evaluate", folder / "x.yaml", "--predictions", folder / "masks", folder=folder)
    assert done.returncode == 2
    assert "1 unusable" in done.stderr
