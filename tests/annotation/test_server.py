"""The review page's server: what it answers to the page, and to nobody else."""

import http.client
import json
import socket
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

from bench.annotation.decisions import applied, to_tracks
from bench.annotation.store import read_review, review_file
from bench.evaluation.protocol import load_protocol
from bench.reference.build import ReferenceBuilder
from tests.support.reviews import DRIVE

ACCEPT = {"action": "accept", "tracks": ["p000"]}


def ask(server, path, *, body=None, method=None, **headers):
    """Status, headers and content of an answer; a header of None is not sent."""
    given = {"Host": f"127.0.0.1:{server.server_port}", "X-Review-Token": server.token}
    if body is not None:
        body = body if isinstance(body, bytes) else json.dumps(body).encode()
        given |= {"Content-Type": "application/json", "Content-Length": str(len(body))}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    connection.putrequest(method or ("GET" if body is None else "POST"), path, skip_host=True)
    for name, value in given.items():
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.headers, content


def asked(server, path, **how):
    """The values of an answer."""
    status, _, content = ask(server, path, **how)
    assert status == 200, content
    return json.loads(content)


@pytest.fixture
def file(reviews):
    return review_file(reviews, DRIVE)


@pytest.fixture
def unchanged(file):
    """The review must be by the end what it was."""
    before = file.read_bytes()
    yield
    assert file.read_bytes() == before


def test_the_page_comes_alone_and_may_load_nothing(server):
    assert server.server_address[0] == "127.0.0.1"
    status, headers, content = ask(server, "/", X_Review_Token=None)
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    nonce = policy.split("script-src 'nonce-")[1].split("'")[0]
    assert f'<script nonce="{nonce}">'.encode() in content
    assert b"http://" not in content
    assert b"https://" not in content
    assert server.token.encode() not in content
    assert nonce not in ask(server, "/")[1]["Content-Security-Policy"]


def test_a_drive_its_sweeps_images_and_lenses_are_answered(server, drive):
    told = asked(server, "/drives/0")
    assert (told["name"], len(told["times"])) == (DRIVE, len(drive.sweeps))
    assert [track["id"] for track in told["tracks"]] == [f"p{i:03d}" for i in range(len(drive.tracks))]
    _, _, sweep = ask(server, "/drives/0/sweep/1")
    count, road = struct.unpack("<ii", sweep[:8])
    assert 0 < road < count <= 36_000
    assert len(sweep) == 32 + 7 * count
    _, headers, image = ask(server, "/drives/0/image/0/1")
    assert image[:2] == b"\xff\xd8"
    np.testing.assert_allclose(json.loads(headers["X-Pose"])["camera_from_world"][3], [0, 0, 0, 1])
    assert len(ask(server, "/drives/0/lens/0")[2]) == 129 * 129 * 2 * 4


def test_decisions_and_what_was_played_are_on_disk_when_they_are_answered(server, file, drive):
    assert asked(server, "/drives/0/decide", body=ACCEPT)["tracks"][0]["status"] == "accepted"
    (decision,) = read_review(file).decisions
    assert (decision.tracks, decision.reviewer) == (("p000",), "R.")
    undone = asked(server, "/drives/0/decide", body={"action": "undo"})
    assert {track["status"] for track in undone["tracks"]} == {"open"}
    assert (undone["decisions"], undone["undone"]) == (0, 1)
    times_ns = [sweep.timestamp_ns for sweep in drive.sweeps]
    played = asked(server, "/drives/0/watched", body={"first": 1, "last": 2})
    assert played["watched"] == [time_ns - times_ns[0] for time_ns in times_ns[1:3]]
    assert read_review(file).watched_ns == tuple(times_ns[1:3])


def box_in_image(server, drive):
    """Number of an image, and the key frame that leaves the first track as it is at the image's time."""
    told = asked(server, "/drives/0")
    track, (camera, *_) = told["tracks"][0], told["cameras"]
    row = len(track["times"]) // 2
    image = min(range(len(camera["times"])), key=lambda i: abs(camera["times"][i] - track["times"][row]))
    x, y, z, yaw, *_ = track["rows"][row]
    box = {"action": "set_box", "track": track["id"], "timestamp_ns": track["times"][row]}
    return image, box | {"centre_m": [x, y, z], "yaw_rad": yaw, "size_m": track["size"]}


def filled(lines, camera):
    """(height, width) bool, inside of outlines, which run through the middles of their pixels."""
    covered = np.zeros((camera.height, camera.width), dtype=np.uint8)
    for line in lines:
        pixels = np.array(line) * [camera.width, camera.height] - 0.5
        cv2.fillPoly(covered, [np.rint(pixels).astype(np.int32)], 1)
    return covered.astype(bool)


@pytest.mark.usefixtures("unchanged")
def test_the_reference_of_a_box_is_outlined_and_nothing_is_stored(server, file, drive):
    image, box = box_in_image(server, drive)
    name, camera = next(iter(drive.cameras.items()))
    outline = f"/drives/0/outline/0/{image}"
    tracks = to_tracks(read_review(file), drive, unreviewed=True)
    builder = ReferenceBuilder(replace(drive, tracks=tracks), name, load_protocol("surface-v1").reference)
    region = builder.region(box["track"], drive.images[name][image])
    for part, lines in asked(server, outline, body=box).items():
        expected = np.zeros((camera.model.height, camera.model.width), dtype=bool)
        expected[region.window] = getattr(region, part)
        shown = filled(lines, camera.model)
        assert (shown & expected).sum() > 0.95 * (shown | expected).sum() > 0
    x, y, z = box["centre_m"]
    for changed in (box | {"centre_m": [x, y, z + 50.0]}, box | {"track": "merged"}):
        assert asked(server, outline, body=changed) == {"core": [], "possible": []}
    assert ask(server, outline, body=ACCEPT)[0] == 400
    for path in ("/drives/0/outline/0/99999", "/drives/0/outline/9/0", "/drives/0/outline"):
        assert ask(server, path, body=box)[0] == 404


HOSTILE = {
    "no token": (403, {"X_Review_Token": None}),
    "a wrong token": (403, {"X_Review_Token": "x" * 43}),
    "a token that is no text": (403, {"X_Review_Token": "\xff\xfe"}),
    "a foreign host": (403, {"Host": "evil.example"}),
    "another port": (403, {"Host": "127.0.0.1:1"}),
    "no host": (403, {"Host": None}),
    "a foreign origin": (403, {"Origin": "https://evil.example"}),
    "no origin at all": (403, {"Origin": "null"}),
    "a form": (415, {"Content_Type": "text/plain"}),
    "no length": (411, {"Content_Length": None}),
    "a length that is none": (411, {"Content_Length": "-5"}),
    "chunks": (411, {"Transfer_Encoding": "chunked"}),
    "200 MB": (413, {"Content_Length": "200000000"}),  # the answer comes before they are sent
}


@pytest.mark.parametrize("name", HOSTILE)
def test_strangers_are_refused_and_nothing_changes(server, file, name):
    before, (expected, headers) = file.read_bytes(), HOSTILE[name]
    assert ask(server, "/drives/0/decide", body=ACCEPT, **headers)[0] == expected
    assert file.read_bytes() == before
    assert ask(server, "/drives/0/decide", body=ACCEPT)[0] == 200


BOX = {
    "action": "set_box", "track": "p000", "timestamp_ns": 0, "centre_m": [0.0, 0, 0], "yaw_rad": 0, "size_m": [1, 1, 1]
}  # fmt: skip
WRONG = [
    *(("decide", body) for body in (
        b"", b"no JSON", b"[" * 100_000, b"null", b"[]", b'"accept"', b"{}", b"\xff\xfe",
        {"action": "run", "tracks": ["p000"]}, {"action": "accept"}, {"action": "accept", "tracks": []},
        {"action": "accept", "tracks": ["nobody"]}, {"action": "accept", "tracks": ["../../etc/passwd"]},
        {"action": "accept", "tracks": [1]}, {"action": "accept", "tracks": ["p000"], "file": "/etc/passwd"},
        ACCEPT | {"reviewer": "somebody else"}, {"action": "set_class", "tracks": ["p000"], "object_class": "ufo"},
        BOX | {"centre_m": [1e99, 0, 0]}, BOX | {"size_m": [0, 1, 1]}, BOX | {"yaw_rad": "0"},
        json.dumps(BOX | {"yaw_rad": float("nan")}).encode(), json.dumps(BOX).replace("0.0", "1e999").encode(),
        {"action": "split_time", "track": "p000", "timestamp_ns": 10**30}, {"action": "undo"}, {"action": "redo"},
        {"action": "merge", "tracks": ["p000"]}, {"action": "draw", "drawn": {}},
    )),
    *(("watched", {"first": first, "last": last}) for first, last in ((0, 10**6), (2, 1), (-1, 1), ("0", 1))),
    ("draw", {"sweep": 10**6, "outline_m": [[0, 0], [1, 0], [1, 1]]}),
    ("draw", {"sweep": 0, "outline_m": [[0, 0]]}),
    ("draw", {"sweep": 0, "outline_m": [[900, 0], [901, 0], [901, 1]]}),
]  # fmt: skip


@pytest.mark.usefixtures("unchanged")
@pytest.mark.parametrize(("what", "body"), WRONG, ids=range(len(WRONG)))
def test_wrong_words_are_refused_and_nothing_changes(server, what, body):
    status, _, content = ask(server, f"/drives/0/{what}", body=body)
    assert status == 400
    assert json.loads(content)["error"]


@pytest.mark.parametrize(
    "path",
    [
        "/etc/passwd", "/../../etc/passwd", "/drives/../0", "/drives/0/sweep/../../x", "/drives/0/sweep/99999",
        "/drives/7", "/drives/-1", "/drives/0/sweep/-1", "/drives/0/image/0/99999", "/drives/0/image/9/0",
        "/drives/0/lens/9", "/drives/0/sweep/%2e%2e", "/drives/0/decide", "/drives/0/sweep", "/drives/0?x=1",
        "/review.html", "/drives/0/",
    ],
)  # fmt: skip
def test_paths_that_are_no_questions_are_not_found(server, path):
    assert ask(server, path)[0] == 404


def test_other_methods_and_long_addresses_are_refused(server):
    assert ask(server, "/drives", method="DELETE")[0] == 501
    assert ask(server, "/" + "x" * 5000)[0] == 414


@pytest.mark.parametrize("sent", [0, 0.5, 1.0], ids=["nothing", "half", "all"])
def test_a_connection_that_is_killed_loses_its_own_edit_at_most(server, file, sent):
    """As when a browser dies: no farewell, a reset. What was answered before stays, and what follows is answered."""
    ask(server, "/drives/0/decide", body=ACCEPT)
    body = json.dumps({"action": "reject", "tracks": ["p001"]}).encode()
    head = f"POST /drives/0/decide HTTP/1.1\r\nHost: 127.0.0.1:{server.server_port}\r\n"
    head += f"X-Review-Token: {server.token}\r\nContent-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    killed = socket.create_connection(("127.0.0.1", server.server_port), timeout=20)
    killed.sendall(head.encode() + body[: round(sent * len(body))])
    killed.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    killed.close()
    assert ask(server, "/drives/0/decide", body={"action": "reopen", "tracks": ["p000"]})[0] == 200
    first, *rest = [decision.action for decision in read_review(file).decisions]
    assert first == "accept"
    assert "reopen" in rest
    assert set(rest) <= {"reopen", "reject"}
    assert len(rest) <= 1 + (sent == 1.0)


def test_a_file_that_another_program_wrote_is_not_overwritten(server, file):
    ask(server, "/drives/0")
    changed = file.read_bytes() + b"\n"
    file.write_bytes(changed)
    assert ask(server, "/drives/0/decide", body=ACCEPT)[0] == 409
    assert file.read_bytes() == changed


def test_a_damaged_review_is_told_and_kept(server, file):
    damaged = b'{"schema_version": 1, "tracks": "all"'
    file.write_bytes(damaged)
    status, _, content = ask(server, "/drives/0")
    assert status == 404
    assert file.name in json.loads(content)["error"]
    assert ask(server, "/drives/0/decide", body=ACCEPT)[0] == 400
    assert file.read_bytes() == damaged


def test_an_object_that_was_missed_is_drawn_and_followed(server, file):
    told = asked(server, "/drives/0")
    truth = max(told["tracks"], key=lambda track: len(track["times"]))
    middle = len(told["times"]) // 2
    row = truth["rows"][min(range(len(truth["times"])), key=lambda k: abs(truth["times"][k] - told["times"][middle]))]
    reach = max(truth["size"][:2]) / 2 + 0.3
    outline = [[row[0] + a * reach, row[1] + b * reach] for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    (drawn,) = asked(server, "/drives/0/draw", body={"sweep": middle, "outline_m": outline})["tracks"]
    assert (drawn["id"], drawn["status"]) == ("d001", "accepted")
    assert len(drawn["times"]) >= len(told["times"]) // 2
    own = drawn["rows"][drawn["times"].index(told["times"][middle])]
    assert np.hypot(own[0] - row[0], own[1] - row[1]) < 1.0
    assert applied(read_review(file)).keys() >= {"p000", "d001"}
