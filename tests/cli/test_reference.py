"""The reference as data: written, read by other programs and by ours, and scored by, to the count."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bench.harness.reference_files import ReferenceFolder
from pycocotools.coco import COCO

import bench
from bench.errors import DataError
from bench.harness import read_run, read_tables
from bench.recordings.validation import read_json
from bench.reference import ReferenceFrame
from bench.training import training_pairs
from tests.cli.predictions import CAMERA, images_of, write_maps
from tests.support.changed_data import without_scenario
from tests.support.commands import call, error_line
from tests.support.tiny_woodscape import OPTIONS, write_data_set

FORMS, PROTOCOLS = ("png", "coco"), ("paper-v1", "surface-v1")
PIXELS = ("labels", "ignored", "unknown", "valid")


@pytest.fixture(scope="module")
def exports(tiny_card, tmp_path_factory) -> dict[tuple[str, str], Path]:
    """The tiny data set's reference in both forms, by both protocols."""
    root, found = tmp_path_factory.mktemp("references"), {}
    with pytest.MonkeyPatch.context() as monkeypatch:
        for form in FORMS:
            for protocol in PROTOCOLS:
                out = found[form, protocol] = root / f"{form}-{protocol}"
                words = ("--out", out, "--format", form, "--protocol", protocol, "--workers", 1)
                assert call(monkeypatch, "reference", "export", tiny_card, *words) == 0
    return found


@pytest.fixture(scope="module")
def masks(tiny_card, tmp_path_factory) -> Path:
    """Masks of the paper's method."""

    def large(image) -> np.ndarray:
        height, width = image.reference.valid.shape
        return cv2.resize(image.method.astype(np.uint8) * 255, (width, height), interpolation=cv2.INTER_NEAREST)

    return write_maps(tmp_path_factory.mktemp("masks") / "masks", images_of(tiny_card), large)


def built(card: Path, protocol: str) -> list[ReferenceFrame]:
    return [frame.reference for frame in bench.open_dataset(card).frames(protocol=protocol, history=0)]


def told(frame: ReferenceFrame) -> list[str]:
    """All that is known of the objects but their polygons, which only drawings need."""
    names = [name for name in type(frame.objects[0]).__slots__ if name != "polygon"] if frame.objects else []
    return [repr([getattr(item, name) for name in names]) for item in frame.objects]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_what_is_read_back_is_what_was_built(exports, tiny_card, form, protocol):
    read, expected = [*bench.read_reference(exports[form, protocol])], built(tiny_card, protocol)
    assert len(read) == len(expected) > 12
    assert any(frame.unknown.any() for frame in read) == (protocol == "surface-v1")
    for one, other in zip(read, expected, strict=True):
        assert told(one) == told(other)
        for name in ("recording", "camera", "timestamp_ns", "ego_speed_mps", "annotated"):
            assert getattr(one, name) == getattr(other, name)
        for name in PIXELS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_the_score_by_it_is_that_by_the_data_to_the_count(
    exports, tiny_card, masks, tmp_path, monkeypatch, form, protocol
):
    """And it is scored by the files, not by the data."""
    common = ("evaluate", tiny_card, "--predictions", masks, "--protocol", protocol, "--no-pictures", "--no-cache")
    assert call(monkeypatch, *common, "--out", tmp_path / "data") == 0
    monkeypatch.setattr("bench.reference.ReferenceBuilder.build", None)
    export = exports[form, protocol]
    assert call(monkeypatch, *common, "--out", tmp_path / "files", "--reference", export) == 0
    for by_data, by_files in zip(*(read_tables(tmp_path / name) for name in ("data", "files")), strict=True):
        assert [*map(repr, by_data.to_pylist())] == [*map(repr, by_files.to_pylist())]
    assert read_run(tmp_path / "files").manifest.reference == read_run(tmp_path / "data").manifest.reference
    assert f"The reference was read from {export.name}." in read_run(tmp_path / "files").summary.caveats


@pytest.mark.parametrize("form", FORMS)
def test_a_recording_is_parsed_once_whatever_its_length_and_a_changed_image_is_scored_again_alone(
    exports, tiny_card, masks, tmp_path, monkeypatch, form
):
    """One unit an image; what was computed again is the one whose reference is another."""
    parsed: list[str] = []

    def count(model, file):
        parsed.append(file.name)
        return read_json(model, file)

    monkeypatch.setattr("bench.harness.reference_files.read_json", count)
    monkeypatch.setattr("bench.harness.unit.plan_units.__kwdefaults__", {"chunk_images": 1})
    export = shutil.copytree(exports[form, "surface-v1"], tmp_path / "export")
    common = ("evaluate", tiny_card, "--predictions", masks, "--protocol", "surface-v1", "--no-pictures", "--no-cache")
    words = (*common, "--out", tmp_path / "run", "--reference", export)
    assert call(monkeypatch, *words) == 0
    work = read_run(tmp_path / "run").summary.provenance.work
    assert work.units_computed == 12
    assert sorted(parsed) == sorted({*parsed})

    def faster(content):
        content["images"][-1]["objects"][0]["speed_mps"] += 1

    changed_json(export / "crossing.json", faster)
    assert call(monkeypatch, *words) == 0
    work = read_run(tmp_path / "run").summary.provenance.work
    assert (work.units_computed, work.units_reused, work.changed) == (1, 11, {"exported reference": 1})


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_an_image_is_scored_by_it_without_the_data(exports, tiny_card, protocol):
    for one, other in zip(bench.read_reference(exports["png", protocol]), built(tiny_card, protocol), strict=True):
        mask = np.roll(other.labels > 0, 3, axis=1)
        assert repr(bench.score(one, mask).metrics) == repr(bench.score(other, mask).metrics)


def test_other_tools_read_both_forms(exports):
    """Label images by any library, run lengths by COCO's own."""
    png, coco = (exports[form, "surface-v1"] for form in FORMS)
    for file in sorted(coco.glob("*.json")):
        if file.name == "reference.json":
            continue
        read = COCO(str(file))
        names = {number: category["name"] for number, category in read.cats.items()}
        for image in read.loadImgs(read.getImgIds()):
            place = f"{image['camera']}/{image['timestamp_ns']}.png"
            instances, labels = (
                cv2.imread(str(png / file.stem / what / place), cv2.IMREAD_UNCHANGED)
                for what in ("instances", "labels")
            )
            assert (instances.dtype, labels.dtype) == (np.uint16, np.uint8)
            drawn = np.zeros_like(labels)
            for entry in read.loadAnns(read.getAnnIds(imgIds=[image["id"]])):
                pixels = read.annToMask(entry) > 0
                assert pixels.sum() == entry["area"] > 0
                if not entry["iscrowd"]:
                    np.testing.assert_array_equal(pixels, instances == entry["instance_id"])
                    item = image["objects"][entry["instance_id"] - 1]
                    assert (item["object_class"], item["status"]) == (names[entry["category_id"]], "evaluated")
                    assert item["region_px"] == entry["area"]
                    assert item["speed_mps"] > 0
                drawn[pixels] = ["", "unknown band", "ignored area", "outside"].index(names[entry["category_id"]]) + 1 \
                    if entry["iscrowd"] else 1  # fmt: skip
            np.testing.assert_array_equal(drawn, labels)


@pytest.mark.parametrize("form", FORMS)
def test_an_export_does_not_depend_on_the_workers_and_holds_one_recording_where_one_is_named(
    exports, tiny_card, tmp_path, form
):
    split = {"workers": 2, "form": form}
    bench.export_reference(tiny_card, tmp_path / "one", recording="crossing", **split)
    whole, one = (ReferenceFolder.open(folder) for folder in (exports[form, "surface-v1"], tmp_path / "one"))
    assert [*one.head.recordings] == ["crossing"]
    assert set(one.head.recordings) < set(whole.head.recordings)
    for file in (path for path in (tmp_path / "one").rglob("*") if path.is_file() and path.name != "reference.json"):
        assert file.read_bytes() == (whole.folder / file.relative_to(tmp_path / "one")).read_bytes()


def test_a_folder_that_holds_something_is_refused_and_stays_as_it_is(tiny_card, tmp_path, monkeypatch, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    line = error_line(monkeypatch, capsys, "reference", "export", tiny_card, "--out", tmp_path / "mine")
    assert "expected a new or an empty folder, got one that holds something" in line
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "notes.txt"]


def test_an_export_that_breaks_off_leaves_nothing(tiny_card, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bench.exchange.reference_export.write_text", full)
    assert call(monkeypatch, "reference", "export", tiny_card, "--out", tmp_path / "out", "--workers", 1) == 2
    assert [*tmp_path.iterdir()] == []


def test_an_image_without_a_reference_is_told_and_fails_as_it_does_by_the_data(tiny_card, tmp_path, monkeypatch, masks):
    """A sweep that cannot be read: in the export, and where it is scored by."""
    card = shutil.copytree(tiny_card.parent, tmp_path / "copied") / tiny_card.name
    without_scenario(card)
    sweep = sorted((card.parent / "data" / "tiny" / "crossing").rglob("lidar/*.npz"))[2]
    sweep.write_bytes(b"damaged")
    out = tmp_path / "export"
    words = ("--protocol", "paper-v1", "--out", out, "--workers", 1)
    assert call(monkeypatch, "reference", "export", card, *words) == 2
    problems = [image["problem"] for image in json.loads((out / "crossing.json").read_text())["images"]]
    (problem, *_) = [one for one in problems if one]
    assert sweep.name in problem
    common = ("evaluate", card, "--predictions", masks, "--no-pictures", "--no-cache")
    for name, more in (("data", ()), ("files", ("--reference", out))):
        assert call(monkeypatch, *common, "--out", tmp_path / name, *more) == 2
    tables = [read_tables(tmp_path / name) for name in ("data", "files")]
    for by_data, by_files in zip(*tables, strict=True):
        assert [*map(repr, by_data.to_pylist())] == [*map(repr, by_files.to_pylist())]


@pytest.mark.parametrize("form", FORMS)
def test_masks_of_which_no_speed_is_known_and_drives_that_nobody_annotated(tiny_card, tmp_path, form):
    write_data_set(tmp_path / "masks")
    shutil.copytree(tiny_card.parent / "data" / "tiny" / "crossing", tmp_path / "drives" / "crossing")
    (tmp_path / "drives" / "crossing" / "annotations.json").unlink()
    for name, adapter, protocol, options in (
        ("masks", "woodscape", "masks-v1", OPTIONS),
        ("drives", "native", "surface-v1", {}),
    ):
        card = tmp_path / f"{name}.yaml"
        keys = {"name": name, "title": name, "adapter": adapter, "root": name, "licence": "none", "options": options}
        card.write_text(yaml.safe_dump(keys))
        bench.export_reference(card, tmp_path / "out" / name, form=form, protocol=protocol)
        read, expected = [*bench.read_reference(tmp_path / "out" / name)], built(card, protocol)
        assert read
        scored = {(one.recording, one.timestamp_ns) for one in read}
        expected = [one for one in expected if (one.recording, one.timestamp_ns) in scored]
        assert [*map(told, read)] == [*map(told, expected)]
        assert [one.annotated for one in read] == [one.annotated for one in expected] == [name == "masks"] * len(read)
        for one, other in zip(read, expected, strict=True):
            for pixels in PIXELS:
                np.testing.assert_array_equal(getattr(one, pixels), getattr(other, pixels))


def changed_json(file: Path, change) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def changed_png(file: Path, change) -> None:
    values = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert cv2.imwrite(str(file), change(values))


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])


def _first(folder: Path, what: str) -> Path:
    return sorted((folder / "crossing" / what / CAMERA).iterdir())[-1]


DAMAGE = {
    "cut png": ("png", lambda f: cut(_first(f, "labels")), "expected a whole PNG"),
    "missing png": ("png", lambda f: _first(f, "instances").unlink(), "a grey PNG of 16 bits, .*No such file"),
    "other size": ("png", lambda f: changed_png(_first(f, "labels"), lambda v: v[:-1]), "a grey PNG of 8 bits"),
    "other depth": (
        "png", lambda f: changed_png(_first(f, "instances"), lambda v: v.astype(np.uint8)), "of 16 bits, .* got uint8",
    ),
    "unknown id": (
        "png",
        lambda f: changed_png(_first(f, "instances"), lambda v: np.where(v > 0, 77, v).astype(np.uint16)),
        "expected instances 1 to 2, the objects of crossing.json, got 77",
    ),
    "pixels gone": (
        "png", lambda f: changed_png(_first(f, "instances"), np.zeros_like), r"expected \d+ pixels of instance \d",
    ),
    "unknown label": ("png", lambda f: changed_png(_first(f, "labels"), lambda v: v + np.uint8(4)), "labels 0 to 4"),
    "labels of another image": (
        "png", lambda f: changed_png(_first(f, "labels"), np.zeros_like), "expected label 1 where an instance is",
    ),
    "missing recording": ("png", lambda f: (f / "crossing.json").unlink(), "crossing.json: .*No such file"),
    "missing field": (
        "coco", lambda f: changed_json(f / "crossing.json", lambda c: c["images"][1].pop("camera")), "images.1.camera",
    ),
    "image of another file": (
        "coco",
        lambda f: changed_json(f / "crossing.json", lambda c: c["annotations"][0].update(image_id=999)),
        r"annotations\[0\].image_id: expected an image of this file, got 999",
    ),
    "object of another image": (
        "coco",
        lambda f: changed_json(f / "crossing.json", lambda c: c["annotations"][0].update(instance_id=99)),
        r"annotations\[0\].instance_id: expected at most \d, an object of its image, got 99",
    ),
    "unknown category": (
        "coco",
        lambda f: changed_json(
            f / "crossing.json", lambda c: [a.update(category_id=1) for a in c["annotations"] if a["iscrowd"]]
        ),
        r"category_id: expected that of one of unknown band, ignored area, outside, got 1",
    ),
    "size of run lengths": (
        "coco",
        lambda f: changed_json(
            f / "crossing.json", lambda c: c["annotations"][0]["segmentation"].update(size=[10, 10])
        ),
        r"annotations\[0\].segmentation.size: expected .* \(height, width\), got 10 x 10",
    ),
    "run lengths": (
        "coco",
        lambda f: changed_json(f / "crossing.json", lambda c: c["annotations"][0]["segmentation"].update(counts="0")),
        r"annotations\[0\].segmentation: expected run lengths that add up",
    ),
    "objects out of order": (
        "coco", lambda f: changed_json(f / "crossing.json", lambda c: c["images"][-1]["objects"].reverse()),
        r"images\[\d\].objects: expected objects that are numbered from 1",
    ),
    "head": ("png", lambda f: changed_json(f / "reference.json", lambda c: c.update(form="coco")), "or was edited"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_told_with_file_and_field(exports, tmp_path, name):
    form, damage, message = DAMAGE[name]
    folder = shutil.copytree(exports[form, "surface-v1"], tmp_path / "damaged")
    damage(folder)
    with pytest.raises(DataError, match=message) as error:
        [*bench.read_reference(folder)]
    assert error.value.file.startswith(str(folder))


def test_another_protocol_and_an_export_of_other_data_are_refused(
    exports, tiny_card, masks, tmp_path, monkeypatch, capsys
):
    common = ("evaluate", tiny_card, "--predictions", masks, "--no-pictures", "--no-cache", "--out", tmp_path / "run")
    line = error_line(monkeypatch, capsys, *common, "--reference", exports["png", "surface-v1"])
    assert "expected a reference by paper-v1, got one by surface-v1; say --protocol surface-v1" in line
    bench.export_reference(tiny_card, tmp_path / "one", protocol="paper-v1", recording="crossing")
    assert call(monkeypatch, *common, "--reference", tmp_path / "one") == 2
    failures = read_run(tmp_path / "run").summary.failures
    assert failures
    assert all("recordings: expected recording" in line for line in failures)


def test_training_reads_it_on_data_without_exact_masks(exports, tiny_card, monkeypatch):
    """Targets and what to leave out come from the files, each with its pair of images."""
    monkeypatch.setattr("bench.reference.ReferenceBuilder.build", None)
    pairs = [*training_pairs(tiny_card, part="all", reference=exports["png", "surface-v1"])]
    by_image = {(one.recording, one.timestamp_ns): one for one in bench.read_reference(exports["png", "surface-v1"])}
    assert len(pairs) == 12
    for pair in pairs:
        assert (len(pair.input.images), pair.exact) == (2, None)
        target = by_image[pair.recording, pair.timestamp_ns]
        for name in PIXELS:
            np.testing.assert_array_equal(getattr(pair.reference, name), getattr(target, name))
