"""Cards: what they say, what they may not say, and how they lead to recordings."""

import pickle
import re
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bench import plug_ins
from bench.errors import DataError, UnknownNameError, UsageError
from bench.plug_ins import imported
from bench.recordings import list_cards, load_card, open_dataset, open_native, write_annotations
from bench.recordings.catalogue import ADAPTERS, ENTRY_POINTS
from bench.synthesis import read_scenario
from tests.support import tiny
from tests.support.cards import write_card

REPOSITORY = Path(__file__).parents[2]
card_file = partial(write_card, file="drives.yaml")


@pytest.fixture
def data(tmp_path):
    for name in ("a", "b"):
        tiny.write_recording(tmp_path / "data" / name)
    return tmp_path / "data"


def names(handles):
    return [handle.name for handle in handles]


def test_a_data_set_opens(tmp_path, data):
    card = load_card(card_file(tmp_path))
    handles = open_dataset(card)
    assert names(handles) == ["a", "b"]
    assert [handle.open().name for handle in pickle.loads(pickle.dumps(handles))] == ["a", "b"]
    assert card.splits == ("all",)
    assert card.scenario is None
    (data / "a/egomotion.csv").unlink()
    with pytest.raises(DataError, match="got neither"):
        handles[0].open()
    assert handles[1].open().name == "b"  # one that fails does not stop the others


def test_a_split_is_that_of_the_card_or_recordings_and_of_the_first_images(tmp_path, data):
    card = load_card(card_file(tmp_path, splits={"all": "*", "second": ["b"]}))
    assert names(open_dataset(card, "second")) == ["b"]
    assert names(open_dataset(card, "all")) == ["a", "b"]
    known = "unknown split or recording 'secnd': known are a, all, b, second; .*; did you mean 'second'"
    with pytest.raises(UnknownNameError, match=known):
        open_dataset(card, "secnd")
    assert names(open_dataset(card, "b,a")) == ["b", "a"]
    for split, chosen in [("a[:2]", ["a"]), ("second[:2]", ["b"]), ("[:2]", ["a", "b"])]:
        handles = open_dataset(card, split)
        assert names(handles) == chosen
        images = [handle.open().images["front"] for handle in handles]
        assert [[image.timestamp_ns for image in taken] for taken in images] == [list(tiny.TIMES_NS[:2])] * len(chosen)
    exclusions = [{"recording": "a", "reason": "rain on the lens", "frames": [0, 0]}]
    (handle,) = open_dataset(load_card(card_file(tmp_path, exclusions=exclusions)), "a[:1]")
    assert [image.timestamp_ns for image in handle.open().images["front"]] == [tiny.TIMES_NS[1]]


@pytest.mark.parametrize("split", ["", "a,a", "a,c", "a[:0]", "a[2:]", "a[:-1]", "[:]"])
def test_what_is_neither_a_split_nor_recordings_is_refused(tmp_path, data, split):
    with pytest.raises(UnknownNameError, match="unknown split or recording"):
        open_dataset(load_card(card_file(tmp_path)), split)


def test_exclusions_leave_out_recordings_frames_and_times(tmp_path, data):
    exclusions = [
        {"recording": "a", "reason": "rain on the lens"},
        {"recording": "b", "reason": "labels begin later", "frames": [0, 0]},
        {"recording": "b", "reason": "labels end", "timestamps_ns": [tiny.TIMES_NS[2], None]},
    ]
    (handle,) = open_dataset(load_card(card_file(tmp_path, exclusions=exclusions)))
    images = pickle.loads(pickle.dumps(handle)).open().images["front"]
    assert [image.timestamp_ns for image in images] == [tiny.TIMES_NS[1]]


EMPTY = [
    {"timestamps_ns": [0, 10]},
    {"frames": [100, 200]},
    {"frames": [0, 0], "timestamps_ns": [tiny.TIMES_NS[2], None]},
]


@pytest.mark.parametrize("limits", EMPTY)
def test_an_exclusion_that_leaves_nothing_out_is_refused_on_opening(tmp_path, data, limits):
    excluded = [{"recording": "a", "reason": "rain on the lens"} | limits]
    a, b = open_dataset(load_card(card_file(tmp_path, exclusions=excluded)))
    with pytest.raises(DataError, match=r"exclusions of a: expected images that they leave out, of 3 .* got .*\(rain"):
        a.open()
    assert b.open().name == "b"


def test_a_split_is_never_taken_for_a_recording(tmp_path, data):
    card = load_card(card_file(tmp_path, splits={"a": ["b"]}))
    for split in ("a", "b", None):
        with pytest.raises(DataError, match=r"splits\.a: expected splits with other names than recordings"):
            open_dataset(card, split)
    assert names(open_dataset(load_card(card_file(tmp_path, splits={"a": ["a"]})), "a")) == ["a"]
    for name in ("a,b", "a[:2]", ""):
        with pytest.raises(DataError, match="names of splits without commas and brackets"):
            load_card(card_file(tmp_path, splits={name: ["b"]}))


def test_annotations_that_stand_in_for_nothing_are_refused(tmp_path, data):
    card = load_card(card_file(tmp_path, annotations="labels"))
    with pytest.raises(DataError, match=r"yaml: annotations: expected a folder.*labels, which is missing; the path"):
        open_dataset(card)
    (tmp_path / "labels").mkdir()
    assert names(open_dataset(card)) == ["a", "b"]
    write_annotations(tmp_path / "labels/A.json", ())
    with pytest.raises(DataError, match=r"annotations: expected files called as recordings.*: a, b, got 1, as A\.json"):
        open_dataset(card)
    write_annotations(tmp_path / "labels/b.json", tiny.tracks()[:1])
    (data / "b/annotations.json").unlink()
    tracks = [[track.track_id for track in handle.open().tracks] for handle in open_dataset(card)]
    assert tracks == [["van", "walker"], ["van"]]


def test_a_variable_in_the_root(tmp_path, data, monkeypatch):
    card = load_card(card_file(tmp_path, root="${DRIVES_HOME}/data", how_to_get="ask Ada"))
    monkeypatch.delenv("DRIVES_HOME", raising=False)
    told = r"drives\.yaml: root: expected a folder, got the variable DRIVES_HOME.*export DRIVES.*; ask Ada"
    with pytest.raises(DataError, match=told):
        open_dataset(card)
    monkeypatch.setenv("DRIVES_HOME", str(tmp_path))
    assert names(open_dataset(card)) == ["a", "b"]


def test_data_that_is_not_there_says_how_to_get_it(tmp_path):
    with pytest.raises(DataError, match=r"root: expected a folder with the data, got .*, which is missing; ask Ada"):
        open_dataset(load_card(card_file(tmp_path, how_to_get="ask Ada")))
    (tmp_path / "data").mkdir()
    with pytest.raises(DataError, match="expected recordings of the adapter 'native', got none"):
        open_dataset(load_card(card_file(tmp_path)))


FAULTS = [
    ({"colour": "red"}, "colour: expected no such key, got 'red'"),
    ({"name": "my drives"}, "name: "),
    ({"splits": {}}, "expected at least one split"),
    ({"splits": {"all": ["a", "b", "a"]}}, "expected each recording once in the split 'all'"),
    ({"exclusions": [{"recording": "a"}]}, "exclusions.0.reason: expected a value, got nothing"),
    ({"exclusions": [{"recording": "a", "reason": "x", "frames": [5, 3]}]}, "expected first and last in order"),
]


@pytest.mark.parametrize(("content", "message"), FAULTS)
def test_faults_of_a_card_name_file_and_field(tmp_path, content, message):
    with pytest.raises(DataError) as caught:
        load_card(card_file(tmp_path, **content))
    assert "drives.yaml: " in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize("value", ["no_such_module_of_anybody:listing", "bench.recordings:no_such_name", "bench"])
def test_a_package_whose_adapter_cannot_be_imported_is_one_clear_line(tmp_path, data, monkeypatch, value):
    point = EntryPoint(name="mine", value=value, group=ENTRY_POINTS)
    monkeypatch.setattr(plug_ins, "installed_points", lambda group: [point] if group == point.group else [])
    with pytest.raises(UsageError, match="adapter 'mine': expected a function "):
        open_dataset(load_card(card_file(tmp_path, adapter="mine")))


def test_what_a_card_names_must_exist(tmp_path, data):
    with pytest.raises(UnknownNameError, match=r"unknown adapter 'nativ': known are .*did you mean 'native'"):
        open_dataset(load_card(card_file(tmp_path, adapter="nativ")))
    with pytest.raises(DataError, match=r"splits\.all: expected recordings of .*data: a, b, got 'c'"):
        open_dataset(load_card(card_file(tmp_path, splits={"all": ["c"]})), "all")
    with pytest.raises(DataError, match=r"exclusions: expected recordings"):
        open_dataset(load_card(card_file(tmp_path, exclusions=[{"recording": "c", "reason": "x"}])))


def test_cards_are_found_by_name(tmp_path):
    card_file(tmp_path, name="drives", title="Two drives")
    (tmp_path / "demo.scenario.yaml").write_text("seed: 1\n")
    assert [card.name for card in list_cards(tmp_path)] == ["drives"]
    assert load_card("drives", folder=tmp_path).content.title == "Two drives"
    with pytest.raises(UnknownNameError, match="unknown data set 'drive'"):
        load_card("drive", folder=tmp_path)
    with pytest.raises(DataError, match=r"none\.yaml: expected a readable card"):
        load_card(tmp_path / "none.yaml")
    for text in ("[1, 2", "- a\n- b\n", "!!python/object/apply:os.getcwd []"):
        (tmp_path / "drives.yaml").write_text(text)
        with pytest.raises(DataError, match=r"drives\.yaml: expected"):
            load_card(tmp_path / "drives.yaml")


@pytest.mark.parametrize("card", list_cards(REPOSITORY / "datasets"), ids=lambda card: card.name)
def test_the_committed_cards_say_what_their_adapter_knows(card, tmp_path):
    assert card.name == card.file.stem
    adapter = imported(ADAPTERS[card.content.adapter], expected="an adapter")

    def refused_file(**more):
        try:
            adapter(tmp_path, options=card.content.options | more, card=card.file, annotations=None)
        except DataError as error:
            return error.file
        return None

    assert refused_file() != str(card.file)  # the data lack, the card is right
    assert refused_file(unknown=1) == str(card.file)


def test_the_examples_of_the_documentation_are_valid(tmp_path, root):
    text = (REPOSITORY / "docs/your-data.md").read_text("utf-8")
    card, annotated, series = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "example.yaml").write_text(card + annotated)
    assert len(load_card(tmp_path / "example.yaml").content.exclusions) == 3
    head = (REPOSITORY / "datasets/demo.scenario.yaml").read_text().split("\nrecordings:")[0]
    (tmp_path / "example.scenario.yaml").write_text(f"{head}\n{series}")
    names = [recording.name for recording in read_scenario(tmp_path / "example.scenario.yaml").recordings]
    assert names == [f"turning-{k:02}" for k in range(1, 10)]
    (head,) = re.findall(r"```json\n(.*?)```", text, re.DOTALL)
    (root / "recording.json").write_text(head)
    front = open_native(root.rename(tmp_path / "drive-01")).cameras["front"].vehicle_from_camera
    assert front.rotation == pytest.approx(tiny.FRONT.rotation, abs=1e-15)
