"""The review page in a browser: keys, clicks and what they store."""

import numpy as np
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from bench.annotation.decisions import applied
from bench.annotation.store import read_review, review_file, write_review
from tests.support.browser import accessibility_faults, opened
from tests.support.reviews import DRIVE


class Page:
    """The review page in a browser, and the review that it changes."""

    def __init__(self, browser, server, file):
        self.browser, self.server, self.file, self.js = browser, server, file, browser.execute_script
        self.may_complain = False

    def open(self, **how):
        opened(self.browser, self.server.url, **how)
        self.until("return D && drawn === i && [...images.values()].some(e => e.bitmap)")

    def open_with(self, *tracks):
        """With other tracks."""
        write_review(self.file, read_review(self.file).model_copy(update={"tracks": tracks}))
        self.open()

    def until(self, script):
        return WebDriverWait(self.browser, 30).until(lambda browser: browser.execute_script(script))

    def press(self, keys):
        ActionChains(self.browser).send_keys(keys).perform()

    def told(self):
        return self.js("return $('told').textContent")

    def complaints(self):
        return [entry for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]

    def decisions(self, count):
        """All that are stored, once there are so many."""
        WebDriverWait(self.browser, 20, 0.05).until(lambda _: len(read_review(self.file).decisions) >= count)
        return read_review(self.file).decisions

    def tracks(self):
        return applied(read_review(self.file))


@pytest.fixture
def closed_page(browser, server, reviews):
    """It must not complain by the end."""
    page = Page(browser, server, review_file(reviews, DRIVE))
    yield page
    assert page.may_complain or page.complaints() == []


@pytest.fixture
def page(request, closed_page):
    """Opened, of the width and in the colours of the test."""
    names = [name for name in ("width", "scheme") if name in request.fixturenames]
    closed_page.open(**{name: request.getfixturevalue(name) for name in names})
    return closed_page


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_shows_the_drive_at_any_width(page, width, scheme):
    assert page.js("return document.documentElement.scrollWidth") <= width
    inks = page.js(
        "const c = $('bird'), p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, s = new Set();"
        "for (let k = 0; k < p.length; k += 4) s.add(p[k] << 16 | p[k + 1] << 8 | p[k + 2]); return s.size"
    )
    assert inks > 5


def sides_of(page, name):
    """Left, top, right, bottom, width and height of an element, px."""
    return page.js(
        "const r = $(arguments[0]).getBoundingClientRect();"
        "return [r.left, r.top, r.right, r.bottom, r.width, r.height]",
        name,
    )


def test_all_views_fit_into_a_small_window(page):
    page.js(
        "tracks.get(chosen).doubts = [...Array(7)].map(() => ({ reason: 'seen through by few', value: .5 }));"
        "report(); paint()"
    )
    page.until("return !frame")
    assert page.js("return $('box').scrollHeight <= $('box').clientHeight")
    for name in ("bird", "image", "top", "flank", "face", "line"):
        left, top, right, bottom, width, height = sides_of(page, name)
        assert left >= 0 <= top and right <= 1280 and bottom <= 900, name  # noqa: PT018
        assert (width, height) > (150, 80), name
    assert sides_of(page, "bird")[4] > 550
    page.js("$('decided').textContent = '188 of 188'; $('seen').textContent = '100 %'")
    assert page.js("return document.querySelector('header').offsetHeight") < 45, "one line"


def test_the_image_is_enlarged_and_back(page):
    small = sides_of(page, "image")[4]
    for enlarge, reduce in ((lambda: page.press("h"), Keys.ESCAPE), (lambda: page.js("$('enlarge').click()"), "h")):
        enlarge()
        page.until("return large")
        assert page.until(f"return $('image').clientWidth > 1.5 * {small}")
        assert sides_of(page, "bird")[4] > 300  # the bird's-eye view is where the image was
        page.press(reduce)
        assert page.until(f"return !large && $('image').clientWidth <= {small}")


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(page, width, scheme):
    page.may_complain = True
    assert accessibility_faults(page.browser) == []
    page.js("$('help').showModal()")
    assert accessibility_faults(page.browser) == []
    page.js("$('help').close(); setLarge(true)")
    assert accessibility_faults(page.browser) == []
    page.js("setLarge(false); decide({ action: 'nonsense' })")
    page.until("return $('told').className === 'bad'")
    for status in ("open", "accepted", "rejected"):
        page.js("for (const t of tracks.values()) t.status = arguments[0]; report(); paint()", status)
        assert accessibility_faults(page.browser) == []


def test_keys_decide_and_undo(page):
    chosen = page.js("return chosen")
    page.press("a")
    (accepted,) = page.decisions(1)
    assert (accepted.action, accepted.tracks) == ("accept", (chosen,))
    page.until(f"return tracks.get('{chosen}').status === 'accepted'")
    page.press("z")
    page.decisions(2)
    page.until(f"return tracks.get('{chosen}').status === 'open'")
    page.press("y")
    page.decisions(3)
    page.js(f"choose('{chosen}')")
    page.press("1")
    assert page.decisions(4)[-1].object_class == "pedestrian"
    page.press("u")
    assert page.decisions(5)[-1].unclear
    page.press("?")
    assert page.js("return $('help').open")


def test_undo_takes_back_what_was_just_nudged_and_nothing_else(page):
    """The nudge waits half a second for more; undo stores it first, so that it is what is taken back."""
    first = page.js("return chosen")
    page.press("a")
    page.decisions(1)
    page.js(f"choose('{first}')")
    page.press("jz")
    accepted, nudged, undone = page.decisions(3)
    assert (accepted.action, nudged.action, undone.action) == ("accept", "set_box", "undo")
    page.until("return $('told').textContent")
    assert page.told() == f"Taken back: set box {first}"
    assert page.js(f"return tracks.get('{first}').status") == "accepted"
    page.press("y")
    page.until("return $('told').textContent.startsWith('Done again')")


def test_the_camera_follows_the_selected_track(page):
    """The drive's camera, and the same one looking back, which comes first."""
    page.may_complain = True  # that one has no images
    page.js(
        "const front = D.cameras[0], [x, y, z, w] = front.mounting, back = row => row.map((v, k) => k < 3 ? -v : v);"
        "D.cameras = [{ ...front, name: 'rear', mounting: [back(x), back(y), z, w] }, { ...front, name: 'front' }];"
        "lenses.set(1, lenses.get(0)); cameraTabs(); choose(chosen)"
    )
    page.until("return !frame && camera === 1 && !sight")
    page.press("c")
    page.until("return camera === 0 && $('band').textContent.endsWith('Seen by: front.')")
    page.js("choose(null); choose(ranked()[0].id)")
    page.until("return camera === 1")


def test_a_doubt_is_explained(page):
    page.js("tracks.get(chosen).doubts = [{ reason: 'short', value: .4 }]; report()")
    page.browser.find_element("css selector", "#why button").click()
    assert page.told().startswith("short (0.4): Seconds that it moves.")


def test_what_was_played_and_nothing_else_counts_as_watched(page, drive):
    page.press(Keys.ARROW_RIGHT)
    page.js("seek(D.times.length - 1)")
    assert page.js("return D.times.filter(watched).length") == 0
    page.js("$('speed').value = '4'; seek(0)")
    page.press(" ")
    page.until("return !playing && i === D.times.length - 1 && D.times.every(watched)")
    assert page.told() == f"Played to the end. {len(drive.tracks)} tracks are still undecided."
    assert read_review(page.file).watched_ns == tuple(sweep.timestamp_ns for sweep in drive.sweeps)


def box_of(page):
    """Centre, heading and size of the selected box."""
    return page.js("const s = stateAt(tracks.get(chosen)); return [...s.row.slice(0, 4), ...s.size]")


def drag(page, x, y, *steps):
    """Press at a point of the window, px, move in steps, lift."""
    pointer = (actions := ActionChains(page.browser, duration=20)).w3c_actions.pointer_action
    pointer.move_to_location(round(x), round(y)).pointer_down()
    for dx, dy in steps:
        pointer.move_to_location(round(x) + dx, round(y) + dy)
    pointer.pointer_up()
    actions.perform()


def test_dragging_the_box_makes_a_key_frame(page):
    x, y, *_ = box_of(page)
    name, scale = page.js("return [chosen, view.scale]")
    before = page.tracks()[name].motion.centres_m
    drag(page, *at_screen(page, x, y), (10, 0), (24, 0))
    (moved,) = page.decisions(1)
    assert (moved.action, moved.track) == ("set_box", name)
    shift = page.tracks()[name].motion.centres_m - before
    assert abs((shift[:, :2] ** 2).sum(axis=1) ** 0.5 - 24 / scale).max() < 3 / scale


def test_a_side_of_the_box_is_dragged_in_the_view_from_above(page):
    before = box_of(page)
    x, y, metre = page.js(
        "const s = stateAt(tracks.get(chosen)), f = frameOf('top', s.size), r = $('top').getBoundingClientRect();"
        "return [r.left + f.w / 2, r.top + f.h / 2 - s.size[1] / 2 * f.k, f.k]"
    )
    drag(page, x, y, (0, -9))
    (decision,) = page.decisions(1)
    assert decision.size_m[1] - before[5] == pytest.approx(9 / metre, abs=0.3 / metre)
    moved = np.hypot(decision.centre_m[0] - before[0], decision.centre_m[1] - before[1])
    assert moved == pytest.approx(4.5 / metre, abs=0.3 / metre)  # the other side stays


def test_keys_move_turn_and_resize_the_box(page):
    x, y, _, yaw, _, _, height = box_of(page)
    page.press("iiq")
    (decision,) = page.decisions(1)
    forward = np.hypot(decision.centre_m[0] - x, decision.centre_m[1] - y)
    assert forward == pytest.approx(0.1, abs=2e-3)
    assert decision.yaw_rad - yaw == pytest.approx(0.01745, abs=1e-3)
    page.press(".")
    assert page.decisions(2)[-1].size_m[2] - height == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(
    ("key", "alt", "front_m", "rear_m"),
    [
        ("]", False, 0.25, 0.0), ("[", False, -0.25, 0.0), ("}", False, 0.0, -0.25), ("{", False, 0.0, 0.25),
        ("]", True, 0.05, 0.0), ("{", True, 0.0, 0.05),
    ],
)  # fmt: skip
def test_keys_move_one_end_of_the_box(page, key, alt, front_m, rear_m):
    x, y, _, yaw, length, *_ = box_of(page)
    keys = ActionChains(page.browser)
    (keys.key_down(Keys.ALT).send_keys(key).key_up(Keys.ALT) if alt else keys.send_keys(key)).perform()
    (decision,) = page.decisions(1)
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    moved = (np.array(decision.centre_m[:2]) - [x, y]) @ ahead
    grown = decision.size_m[0] - length
    np.testing.assert_allclose([moved + grown / 2, moved - grown / 2], [front_m, rear_m], atol=2e-3)
    assert key in page.js("return $('keys').textContent")


def test_boxes_in_the_image_are_where_the_lens_puts_them(page, drive):
    name, camera = next(iter(drive.cameras.items()))
    image = drive.images[name][1]
    world_from_camera = drive.trajectory.world_from_vehicle(image.timestamp_ns) @ camera.vehicle_from_camera
    points_camera = [[0.0, 0.0, 5.0], [3.0, 0.5, 4.0], [-4.0, 1.0, 2.0], [2.0, -1.0, 0.8], [1.0, 1.0, -5.0]]
    points_world = world_from_camera.apply(np.array(points_camera)).tolist()
    page.until("return !!lens(0)")
    page.js("window.shown1 = fetchImage(0, 1)")
    page.until("return !!shown1.bitmap")
    found = page.js("return arguments[0].map(p => pixel(lens(0), D.cameras[0].limit, shown1.pose, p))", points_world)
    expected, valid = camera.model.project(np.array(points_camera))
    assert valid.any()
    size = np.array([camera.model.width, camera.model.height])
    for part, pixel, seen in zip(found, expected, valid, strict=True):
        assert (part is not None) == bool(seen)
        if seen:
            np.testing.assert_allclose(np.array(part) * size - 0.5, pixel, atol=0.3)


def at_screen(page, x, y):
    """Where a point of the world is in the window, px."""
    return page.js(
        "const r = $('bird').getBoundingClientRect(), p = toScreen(arguments[0], arguments[1], r.width, r.height);"
        "return [Math.round(r.left + p[0]), Math.round(r.top + p[1])]",
        float(x), float(y),
    )  # fmt: skip


def stroke(page, points):
    """Press at the first point of the world, move through the others, lift."""
    (x, y), *others = [at_screen(page, *point) for point in points]
    drag(page, x, y, *((u - x, v - y) for u, v in others))


def test_the_reference_follows_the_box(page):
    page.until("return reference && reference.id === chosen && reference.core.length && $('band').className === ''")
    before, height = page.js("return [JSON.stringify(reference.core), $('camera').offsetHeight]")
    page.press("jjjjjjjj")  # 40 cm to the left, some of the returns are not in the box any more
    page.until(f"return !outlining && reference.id === chosen && JSON.stringify(reference.core) !== {before!r}")
    page.js("seek(0); chosen = null; paint()")
    page.until("return $('band').className === 'unseen'")
    assert page.js("return $('camera').offsetHeight") == height  # nothing below it jumps
    name = page.js("choose(order[0]); return chosen")
    page.press("r")
    page.until(f"return tracks.get('{name}').status === 'rejected'")
    page.js(f"choose('{name}')")
    page.until(f"return chosen === '{name}' && $('band').className === 'unseen'")  # a rejected box has no reference


def test_a_track_is_split_at_a_time_and_merged_again(page):
    name = page.js("const t = tracks.get(chosen); seek(nearest(D.times, t.times[t.times.length >> 1])); return chosen")
    before = len(page.tracks())
    page.press("t")
    page.decisions(1)
    page.until(f"return chosen === '{name}.1' && !!stateAt(tracks.get(chosen))")  # the later part, which is there
    assert "is selected" in page.told()
    page.press("z")
    page.until(f"return chosen === '{name}' && !tracks.has('{name}.1')")  # what was cut is selected again
    page.press("y")
    page.until(f"return tracks.has('{name}.1')")
    assert len(page.tracks()) == before + 1
    page.js(f"choose('{name}'); mark('{name}.1')")
    page.press("m")
    decision = page.decisions(4)[-1]
    assert (decision.action, set(decision.tracks)) == ("merge", {name, f"{name}.1"})
    assert len(page.tracks()) == before


def test_a_line_across_a_box_splits_it(page):
    page.js("view.scale = 40; paint()")
    x, y, _, yaw, length, width, _ = box_of(page)
    centre, across = np.array([x, y]), np.array([-np.sin(yaw), np.cos(yaw)]) * (width / 2 + 1.0)
    page.press("p")
    stroke(page, [centre + across, centre - across])
    (decision,) = page.decisions(1)
    assert decision.action == "split_space"
    page.until(f"return chosen === '{decision.track}.1'")
    halves = [track for name, track in page.tracks().items() if name.startswith(decision.track)]
    assert sum(track.size_m[0] for track in halves) == pytest.approx(length, abs=0.01)


@pytest.mark.parametrize("way", ["lasso", "click"])
def test_a_missing_object_is_drawn_from_its_points(page, way):
    x, y, *_, length, width, _ = box_of(page)
    page.press("r")
    page.decisions(1)
    seen = page.js(
        "const [x, y, reach] = arguments, s = sweeps.get(i); let best = null, least = reach;"
        "for (let j = 0; j < s.n - s.road; j++) { const p = [s.o[0] + s.points[3*j]/100, s.o[1] + s.points[3*j+1]/100],"
        " d = Math.hypot(p[0] - x, p[1] - y); if (d < least) [best, least] = [p, d]; } return best",
        x, y, max(length, width),
    )  # fmt: skip
    assert seen is not None
    page.press("d")
    reach = max(length, width) / 2 + 0.4
    corners = [(x + a * reach, y + b * reach) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    stroke(page, corners if way == "lasso" else [seen])
    decision = page.decisions(2)[-1]
    assert decision.action == "draw"
    page.until(f"return chosen === '{decision.drawn.id}'")


def test_a_page_whose_command_has_ended_shows_what_is_stored(page):
    page.may_complain = True
    ended = {"offline": True, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
    page.browser.execute_cdp_cmd("Network.enable", {})
    page.browser.execute_cdp_cmd("Network.emulateNetworkConditions", ended)
    page.press("a")
    page.until("return over")
    page.browser.execute_async_script("open_(0).catch(() => 0).then(() => arguments[0]())")
    assert page.js("return D !== null"), "the drive stays on the page"
    page.browser.execute_cdp_cmd("Network.emulateNetworkConditions", ended | {"offline": False})
    assert page.js("return [...tracks.values()].every(t => t.status === 'open')")
    page.press(" ")
    assert not page.js("return playing")
    assert "the command has ended" in page.told()
    assert read_review(page.file).decisions == ()


def test_what_cannot_be_stored_is_said(page):
    page.may_complain = True
    page.file.write_bytes(page.file.read_bytes() + b"\n")
    chosen = page.js("return chosen")
    page.press("a")
    assert page.until("return $('told').textContent").startswith("Not stored: ")
    page.until(f"return tracks.get('{chosen}').status === 'open'")


def test_a_hole_is_seen_in_the_list_and_in_the_timeline_and_filled_by_a_key_frame(closed_page):
    page = closed_page
    first, *others = read_review(page.file).tracks
    page.open_with(first.model_copy(update={"states": (*first.states[:3], *first.states[4:])}), *others)
    page.js("choose('p000'); seek(3)")
    assert "hole of 1 sweep" in page.js("return document.querySelector('#why').textContent")
    assert "hole" in page.js("return document.querySelector('#tracks [aria-pressed=true]').textContent")
    page.until("return $('size').textContent.startsWith('A hole')")
    whole, hole = page.js(
        "const b = bars.find(b => b.t.id === 'p000'), g = $('rows').getContext('2d'), { x } = scale();"
        "return [1.5, 3].map(n => g.getImageData(x(n * step), b.y + 4, 1, 1).data.join())"
    )
    assert whole != hole
    page.press(Keys.ENTER)
    assert page.decisions(1)[0].action == "set_box"
    page.until("return bars.find(b => b.t.id === 'p000').runs.length === 1 && !tracks.get('p000').doubts.length")


def test_the_timeline_has_the_rows_of_the_list(page):
    rows, listed = page.js("return [bars.map(b => b.t.id), ranked().map(t => t.id)]")
    assert rows == listed
    left, top, *_ = sides_of(page, "rows")
    drag(page, left + 8, top + page.js("return bars.at(-1).y") + 4)
    assert page.js("return chosen") == rows[-1]
    page.js(
        "for (let n = 0; n < 10; n++) tracks.set(`x${n}`, { ...tracks.get(chosen), id: `x${n}` });"
        "order = [...tracks.keys()].slice(-10); report(); paint()"
    )
    page.until("return bars.length === 10 && $('lanes').scrollHeight <= $('lanes').clientHeight")  # ten at once


def test_labels_do_not_overlap_and_the_selected_one_is_always_there(closed_page):
    """Nine tracks at one place: some labels are beside, above and below, the others are left out."""
    page = closed_page
    first, *others = read_review(page.file).tracks
    page.open_with(first, *others, *(first.model_copy(update={"id": f"c{i}"}) for i in range(8)))
    page.js("choose('c5'); seek(nearest(D.times, tracks.get('c5').times[1]))")
    page.until("return drawn === i && placed.some(p => p.name === 'c5')")
    labels = page.js("return placed")
    of_copies = [label for label in labels if label["name"] in {"p000", *(f"c{i}" for i in range(8))}]
    assert 2 <= len(of_copies) <= 4
    for n, a in enumerate(labels):
        for b in labels[:n]:
            apart = a["right"] < b["left"] or a["left"] > b["right"] or a["bottom"] < b["top"] or a["top"] > b["bottom"]
            assert apart, (a, b)
