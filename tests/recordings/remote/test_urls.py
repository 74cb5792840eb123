"""Addresses: what is one, and that none carries a secret; names of objects that may not become files."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import DataError, UsageError
from bench.recordings import load_card, open_dataset
from bench.recordings.object_storage import RemoteUrl, parse_location, refuse_unsafe, without_secrets
from tests.support.cards import write_card


@pytest.mark.parametrize("text", ["data", "/data/x", "../x", "C:\\data", "runs/s3"])
def test_a_path_is_a_path(text):
    assert parse_location(text) == Path(text)


@pytest.mark.parametrize("text", ["file:///data/x", "file:///data/x/", "local:///data/x"])
def test_a_file_address_is_a_path(text):
    assert parse_location(text) == Path("/data/x")


@pytest.mark.parametrize("text", ["s3://bucket/a/b", "s3://bucket/a/b/", "S3://bucket/a/b"])
def test_an_address_has_a_bucket_and_a_name(text):
    place = parse_location(text)
    assert (place, place.protocol, place.name) == (RemoteUrl("s3://bucket/a/b"), "s3", "b")
    assert parse_location("s3://bucket").name == "bucket"
    assert parse_location("sftp://user@host/x").protocol == "sftp"


@pytest.mark.parametrize(
    "text",
    [
        "s3://key:hidden@bucket/x",
        "https://host/x?token=hidden",
        "s3://key:hidden@bucket/x?y=hidden",
        "s3://key:hid/den@bucket/x?hidden",
        "a::s3://k:hidden@b/x",
    ],
)
def test_an_address_with_a_secret_is_refused_without_telling_it(text):
    with pytest.raises(UsageError, match="expected") as refused:
        parse_location(text)
    assert "hidden" not in str(refused.value)


@pytest.mark.parametrize(
    "text",
    ["s3://", "s3:///x", "s3://b//x", "s3://b/../x", "s3://b/./x", "s3://b/*", "s3://b/[x]", "s3://b/x\n", "s3://b/\0",
     "file://x", "simplecache::s3://b/x", "s3://b\\x"],
)  # fmt: skip
def test_other_addresses_are_refused(text):
    with pytest.raises(UsageError, match="expected"):
        parse_location(text)


def test_texts_lose_their_secrets():
    told = without_secrets('no answer of "https://me:hidden@host:90/a?sig=hidden&x=1", s3://k:hidden@b/c and a?b')
    assert told == 'no answer of "https://host:90/a", s3://b/c and a?b'


def test_a_card_names_an_address_also_through_a_variable(tmp_path, monkeypatch):
    monkeypatch.setenv("PLACE", "s3://bench/y")
    assert load_card(write_card(tmp_path, root="s3://bench/x")).remote_root == RemoteUrl("s3://bench/x")
    assert load_card(write_card(tmp_path, root="${PLACE}/z")).remote_root == RemoteUrl("s3://bench/y/z")
    assert load_card(write_card(tmp_path)).remote_root is None
    assert load_card(write_card(tmp_path, root=f"file://{tmp_path}")).root == tmp_path


def test_a_card_with_a_secret_or_remote_annotations_is_refused(tmp_path):
    with pytest.raises(DataError, match="root: expected a folder or an address") as refused:
        open_dataset(load_card(write_card(tmp_path, root="s3://me:hidden@bench/x")))
    assert "hidden" not in str(refused.value)
    with pytest.raises(DataError, match="annotations: expected a folder or file of this machine"):
        open_dataset(load_card(write_card(tmp_path, root="s3://bench/x", annotations="s3://bench/labels")))


URL = parse_location("s3://bench/x")


@pytest.mark.parametrize(
    "name",
    ["../x", "a/../../x", "/etc/x", "a//b", "a/./b", "..", ".", "", "a/", "a\\b", "C:/x", "a\nb", "a\0b", "x" * 256,
     "\u202egnp.exe"],
)  # fmt: skip
def test_names_that_lead_elsewhere_are_refused(name):
    with pytest.raises(DataError, match="names of objects that can be files"):
        refuse_unsafe(URL, ["fine/1.png", name])


def test_a_file_that_is_also_a_folder_is_refused():
    with pytest.raises(DataError, match="both of 'a/b'"):
        refuse_unsafe(URL, ["a/b", "a/b/c/d"])
    with pytest.raises(DataError, match="both of 'a'"):
        refuse_unsafe(URL, ["a", "a"])


@given(st.lists(st.text(st.characters(codec="ascii") | st.sampled_from("./\\")), max_size=4))
def test_what_is_not_refused_stays_inside(tmp_path_factory, names):
    root = tmp_path_factory.getbasetemp() / "root"
    try:
        refuse_unsafe(URL, names)
    except DataError:
        return
    assert all((root / name).resolve().is_relative_to(root) and (root / name).resolve() != root for name in names)
