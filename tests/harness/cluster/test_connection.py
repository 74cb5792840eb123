"""The address of a scheduler, as a user gives it."""

import json

import pytest

from bench.errors import DataError
from bench.harness.cluster import scheduler_address


def test_an_address_is_itself():
    assert scheduler_address("tcp://10.0.0.1:8786") == "tcp://10.0.0.1:8786"


def test_the_file_that_a_scheduler_writes(tmp_path):
    (tmp_path / "scheduler.json").write_text(json.dumps({"type": "Scheduler", "address": "tls://a:1"}))
    assert scheduler_address(str(tmp_path / "scheduler.json")) == "tls://a:1"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "got No such file or directory; for example tcp://localhost:8786"),
        (b"", "got no JSON"),
        (b"\xff\xfe", "got no JSON"),
        (b"[1, 2]", "address: expected text, got None"),
        (b'{"address": 7}', "address: expected text, got 7"),
        (b"[" * 100_000, "got no JSON"),
    ],
    ids=["missing", "empty", "binary", "list", "number", "deep"],
)
def test_what_is_neither(tmp_path, content, message):
    file = tmp_path / "scheduler.json"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(DataError, match=message):
        scheduler_address(str(file))
