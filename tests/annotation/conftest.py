"""Reviews of a rendered drive whose proposals are its true tracks, and a browser."""

import shutil
import threading
from dataclasses import replace

import pytest

from bench.annotation.proposals import propose
from bench.annotation.server import ReviewServer
from bench.annotation.session import Session
from bench.annotation.store import review_file, write_review
from bench.recordings import load_card, open_dataset
from bench.records.recording import NOT_ANNOTATED
from tests.annotation.street import COARSE, street
from tests.support.browser import headless_chromium
from tests.support.cards import write_card
from tests.support.reviews import DRIVE, proposed_from


@pytest.fixture(scope="session")
def drive(tiny_card):
    """The rendered drive."""
    return next(handle for handle in open_dataset(load_card(tiny_card)) if handle.name == DRIVE).open()


@pytest.fixture
def card(tiny_card, tmp_path):
    """A card of one rendered drive without its annotations."""
    shutil.copytree(tiny_card.parent / "data" / "tiny" / DRIVE, tmp_path / "data" / DRIVE)
    (tmp_path / "data" / DRIVE / "annotations.json").unlink()
    return write_card(tmp_path, file="drives.yaml", name="drives", annotations="annotations")


@pytest.fixture(scope="session")
def recording(tmp_path_factory):
    """The synthetic street."""
    return street(tmp_path_factory.mktemp("street") / "street")


@pytest.fixture(scope="session")
def proposals(recording):
    """What is proposed there without annotations."""
    return propose(replace(recording, tracks=(), annotated=NOT_ANNOTATED), settings=COARSE)


@pytest.fixture
def reviews(drive, tmp_path):
    """A folder with the drive's review, in which nothing was decided yet."""
    write_review(review_file(tmp_path / "reviews", DRIVE), proposed_from(drive))
    return tmp_path / "reviews"


@pytest.fixture
def server(drive, reviews):
    """A server of one drive that answers until the test ends."""

    def open_session(_):
        return Session(drive, dataset="tiny", folder=reviews, reviewer="R.")

    with ReviewServer([DRIVE], open_session) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    opened = headless_chromium(tmp_path_factory.mktemp("chromium"))
    yield opened
    opened.quit()
