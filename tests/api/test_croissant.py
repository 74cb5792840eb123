"""Croissant: the description of a rendered data set is valid, and its library reads images and objects by it."""

import hashlib
import json
import shutil

import numpy as np
import pytest
from PIL import Image

from bench.recordings import load_card, open_dataset
from tests.support.commands import called_here


@pytest.fixture(scope="module")
def described(tiny_card, tmp_path_factory):
    """A rendered data set with its description, as it is published."""
    folder = tmp_path_factory.mktemp("published") / "datasets"
    shutil.copytree(tiny_card.parent, folder)
    card = load_card(folder / "tiny.yaml")
    more = ("url=https://example.org/tiny", "datePublished=2026-11-02", 'creator={"@type": sc:Organization, name: Us}')
    done = called_here("croissant", card.file, *(word for one in more for word in ("--add", one)))
    assert (done.returncode, done.stdout) == (0, f"{card.root / 'croissant.json'}\n"), done.stderr
    assert [one.name for one in open_dataset(card)] == [one.name for one in open_dataset(load_card(tiny_card))]
    return card


@pytest.fixture(scope="module")
def loaded(described):
    import mlcroissant

    return mlcroissant.Dataset(described.root / "croissant.json")


def test_the_description_is_valid_and_says_what_the_card_says(described, loaded):
    metadata = loaded.metadata
    assert not metadata.ctx.issues.errors
    assert (metadata.name, metadata.license) == (described.name, [described.content.licence])
    assert described.content.title in metadata.description
    assert (metadata.date_published.year, metadata.creators[0].name, metadata.url[-4:]) == (2026, "Us", "tiny")


def test_images_are_read_as_they_are(described, loaded):
    found = {
        (row["images/recording"].decode(), row["images/camera"].decode(), row["images/timestamp_ns"]): row
        for row in loaded.records("images_records")
    }
    paths = {
        (handle.name, ref.camera, ref.timestamp_ns): ref.path
        for handle in open_dataset(described)
        for refs in handle.open().images.values()
        for ref in refs
    }
    assert found.keys() == paths.keys()
    for key, path in paths.items():
        np.testing.assert_array_equal(found[key]["images/image"], Image.open(path).convert("RGB"))


def test_objects_are_those_that_are_annotated(described, loaded):
    found = {
        (row["objects/recording"].decode(), row["objects/id"].decode(), row["objects/object_class"].decode(),
         row["objects/instance_id"])
        for row in loaded.records("objects_records")
    }  # fmt: skip
    assert found == {
        (handle.name, track.track_id, track.object_class, track.instance_id)
        for handle in open_dataset(described)
        for track in handle.open().tracks
    }


def test_digests_are_of_the_files_and_lead_to_all_others(described):
    content = json.loads((described.root / "croissant.json").read_text("utf-8"))
    digests = {one["contentUrl"]: one["sha256"] for one in content["distribution"] if "sha256" in one}
    names = {handle.name for handle in open_dataset(described)}
    assert digests.keys() == {f"{name}/{file}" for name in names for file in ("recording.json", "synthesis.json")}
    for name, digest in digests.items():
        assert hashlib.sha256((described.root / name).read_bytes()).hexdigest() == digest


def test_it_says_what_catalogues_also_ask_for(described, tmp_path):
    done = called_here("croissant", described.file, "--out", tmp_path / "own.json")
    assert "catalogues also ask for url, creator, datePublished" in done.stdout


def test_other_formats_are_refused(tmp_path):
    card = tmp_path / "card.yaml"
    card.write_text(f"{{name: a, title: a, adapter: kitti360, root: {tmp_path}, licence: a}}")
    assert "expected a data set in the native format" in called_here("croissant", card).stderr
