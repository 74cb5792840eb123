"""The library 123D, where only its own programs find it."""

import fcntl

import pytest

from tests.support import log123d


@pytest.fixture(scope="session")
def library(tmp_path_factory, worker_id):
    """One for all processes that run tests."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "py123d"
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return folder if folder.exists() else log123d.install_library(folder)
