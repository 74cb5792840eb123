"""What goes wrong at the other end is told in one line, soon, and without secrets."""

import socket
import sys
import threading

import pytest
import requests

from bench.errors import DataError
from bench.recordings import object_storage
from bench.recordings.object_storage import download, list_entries, list_objects, local_copy, parse_location

pytestmark = pytest.mark.slow

SECRETS = ("secret-of-tests", "key-of-tests")


def refused(action, expected: str) -> None:
    with pytest.raises(DataError, match=expected) as error:
        action()
    assert not any(secret in str(error.value) for secret in SECRETS)


def actions(place: str, tmp_path):
    url = parse_location(place)
    return {
        "entries": lambda: list_entries(url),
        "objects": lambda: list_objects(url),
        "download": lambda: download(url, {"x": tmp_path / "x"}),
    }


@pytest.mark.parametrize("action", ["entries", "download"])
def test_a_missing_bucket_is_told(bucket, tmp_path, action):
    refused(actions("s3://nobody/x", tmp_path)[action], "s3://nobody/x: expected .*FileNotFoundError.*check bucket")


def test_what_is_there_is_listed_and_comes_back(bucket, tmp_path):
    url = parse_location("s3://bench/here/x")
    names = [f"deep/{number}" for number in range(40)]
    for name in names:
        bucket.put(f"here/x/{name}", name.encode())
    assert {name: told.size_bytes for name, told in list_objects(url).items()} == {n: len(n) for n in names}
    download(url, {"deep/1": tmp_path / "back"})
    assert (tmp_path / "back").read_text() == "deep/1"
    assert (list_entries(url), list_entries(url, "deep/")) == (["deep/"], sorted(names))


@pytest.mark.parametrize("action", ["entries", "download"])
def test_an_endpoint_that_is_not_there_is_told_soon(bucket, tmp_path, monkeypatch, action):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free.getsockname()[1]}")
    refused(actions("s3://bench/x", tmp_path)[action], "EndpointConnectionError.*check endpoint")


def test_an_endpoint_that_never_answers_is_given_up(bucket, tmp_path, monkeypatch):
    quick = {"connect_timeout": 1, "read_timeout": 1, "retries": {"mode": "standard", "total_max_attempts": 2}}
    monkeypatch.setattr(object_storage, "S3_CONFIGURATION", quick)
    with socket.create_server(("127.0.0.1", 0)) as server:
        held: list[socket.socket] = []
        threading.Thread(target=lambda: held.extend(server.accept()[0] for _ in range(99)), daemon=True).start()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.getsockname()[1]}")
        refused(actions("s3://bench/x", tmp_path)["entries"], "check endpoint")


def test_missing_credentials_are_told(bucket, tmp_path, monkeypatch):
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    refused(actions("s3://bench/x", tmp_path)["entries"], "NoCredentialsError.*set credentials")


@pytest.fixture
def guarded(bucket):
    """The server lets nobody in from now on."""
    requests.post(f"{bucket.endpoint}/moto-api/reset-auth", data=b"0", timeout=10)
    yield
    requests.post(f"{bucket.endpoint}/moto-api/reset-auth", data=b"inf", timeout=10)


@pytest.mark.parametrize("action", ["entries", "download"])
def test_credentials_that_may_not_are_told(guarded, tmp_path, action):
    refused(actions("s3://bench/x", tmp_path)[action], "PermissionError.*use credentials that may do this")


def test_an_unknown_protocol_and_a_missing_library_are_told(tmp_path, monkeypatch):
    refused(lambda: local_copy(parse_location("s4://bench/x")), "Protocol not known: s4")
    monkeypatch.setitem(sys.modules, "s3fs", None)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    refused(lambda: local_copy(parse_location("s3://bench/y")), r"pip install 'fisheye-bench\[remote\]'")


def test_own_configuration_of_fsspec_goes_before(bucket, tmp_path, monkeypatch):
    import fsspec

    monkeypatch.setitem(fsspec.config.conf, "s3", {"config_kwargs": {"connect_timeout": 2, "read_timeout": 3}})
    settings = object_storage._connect(parse_location("s3://bench/own"))[0].config_kwargs
    assert (settings["connect_timeout"], settings["read_timeout"], settings["retries"]["mode"]) == (2, 3, "standard")
