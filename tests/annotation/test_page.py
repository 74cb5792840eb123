"""The review page in a browser: keys, clicks and what they store."""

import time

import numpy as np
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from bench.annotation.decisions import applied
from bench.annotation.store import read_review, review_file, write_review
from tests.support.browser import accessibility_faults, opened
from tests.support.reviews import DRIVE


def page(browser, server, **how):
    opened(browser, server.url, **how)
    until(browser, "return D && drawn === i && [...images.values()].some(e => e.bitmap)")
    return browser


def until(browser, script):
    return WebDriverWait(browser, 30).until(lambda b: b.execute_script(script))


def press(browser, keys):
    ActionChains(browser).send_keys(keys).perform()


def stored(reviews):
    return read_review(review_file(reviews, DRIVE))


def wait_for_decisions(reviews, count):
    end = time.monotonic() + 20
    while len(stored(reviews).decisions) < count and time.monotonic() < end:
        time.sleep(0.05)
    return stored(reviews).decisions


def no_complaints(browser):
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_shows_the_drive_at_any_width(browser, server, width, scheme):
    page(browser, server, width=width, scheme=scheme)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    inks = browser.execute_script(
        "const c = $('bird'), p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, s = new Set();"
        "for (let k = 0; k < p.length; k += 4) s.add(p[k] << 16 | p[k + 1] << 8 | p[k + 2]); return s.size"
    )
    assert inks > 5
    no_complaints(browser)


def click(browser, name):
    """A function that clicks a button."""
    return lambda: browser.find_element("id", name).click()


def sides_of(browser, name):
    """Left, top, right, bottom, width and height of an element, px."""
    return browser.execute_script(
        "const r = $(arguments[0]).getBoundingClientRect();"
        "return [r.left, r.top, r.right, r.bottom, r.width, r.height]",
        name,
    )


def test_all_views_fit_into_a_small_window(browser, server):
    page(browser, server, width=1280)
    browser.execute_script(
        "tracks.get(chosen).doubts = [...Array(7)].map(() => ({ reason: 'seen through by few', value: .5 }));"
        "report(); paint()"
    )
    until(browser, "return !frame")
    assert browser.execute_script("return $('box').scrollHeight <= $('box').clientHeight")
    for name in ("bird", "image", "top", "flank", "face", "line"):
        left, top, right, bottom, width, height = sides_of(browser, name)
        assert left >= 0 <= top and right <= 1280 and bottom <= 900, name  # noqa: PT018
        assert (width, height) > (150, 80), name
    assert sides_of(browser, "bird")[4] > 550
    browser.execute_script("$('decided').textContent = '188 of 188'; $('seen').textContent = '100 %'")
    assert browser.execute_script("return document.querySelector('header').offsetHeight") < 45, "one line"


def test_the_image_is_enlarged_and_back(browser, server):
    page(browser, server, width=1280)
    small = sides_of(browser, "image")[4]
    for enlarge, reduce in ((lambda: press(browser, "h"), Keys.ESCAPE), (click(browser, "enlarge"), "h")):
        enlarge()
        until(browser, "return large")
        assert until(browser, f"return $('image').clientWidth > 1.5 * {small}")
        assert sides_of(browser, "bird")[4] > 300  # the bird's-eye view is where the image was
        press(browser, reduce)
        assert until(browser, f"return !large && $('image').clientWidth <= {small}")
    no_complaints(browser)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(browser, server, width, scheme):
    page(browser, server, width=width, scheme=scheme)
    assert accessibility_faults(browser) == []
    browser.execute_script("$('help').showModal()")
    assert accessibility_faults(browser) == []
    browser.execute_script("$('help').close(); setLarge(true)")
    assert accessibility_faults(browser) == []
    browser.execute_script("setLarge(false); decide({ action: 'nonsense' })")
    until(browser, "return $('told').className === 'bad'")
    for status in ("open", "accepted", "rejected"):
        browser.execute_script("for (const t of tracks.values()) t.status = arguments[0]; report(); paint()", status)
        assert accessibility_faults(browser) == []


def test_keys_decide_and_undo(browser, server, reviews):
    page(browser, server)
    chosen = browser.execute_script("return chosen")
    press(browser, "a")
    (accepted,) = wait_for_decisions(reviews, 1)
    assert (accepted.action, accepted.tracks) == ("accept", (chosen,))
    until(browser, f"return tracks.get('{chosen}').status === 'accepted'")
    press(browser, "z")
    wait_for_decisions(reviews, 2)
    until(browser, f"return tracks.get('{chosen}').status === 'open'")
    press(browser, "y")
    wait_for_decisions(reviews, 3)
    browser.execute_script(f"choose('{chosen}')")
    press(browser, "1")
    assert wait_for_decisions(reviews, 4)[-1].object_class == "pedestrian"
    press(browser, "u")
    assert wait_for_decisions(reviews, 5)[-1].unclear
    press(browser, "?")
    assert browser.execute_script("return $('help').open")
    no_complaints(browser)


def told(browser):
    return browser.execute_script("return $('told').textContent")


def test_undo_takes_back_what_was_just_nudged_and_nothing_else(browser, server, reviews):
    """The nudge waits half a second for more; undo stores it first, so that it is what is taken back."""
    page(browser, server)
    first = browser.execute_script("return chosen")
    press(browser, "a")
    wait_for_decisions(reviews, 1)
    browser.execute_script(f"choose('{first}')")
    press(browser, "jz")
    accepted, nudged, undone = wait_for_decisions(reviews, 3)
    assert (accepted.action, nudged.action, undone.action) == ("accept", "set_box", "undo")
    until(browser, "return $('told').textContent")
    assert told(browser) == f"Taken back: set box {first}"
    assert browser.execute_script(f"return tracks.get('{first}').status") == "accepted"
    press(browser, "y")
    until(browser, "return $('told').textContent.startsWith('Done again')")
    no_complaints(browser)


def test_the_camera_follows_the_selected_track(browser, server):
    """The drive's camera, and the same one looking back, which comes first."""
    page(browser, server)
    browser.execute_script(
        "const front = D.cameras[0], [x, y, z, w] = front.mounting, back = row => row.map((v, k) => k < 3 ? -v : v);"
        "D.cameras = [{ ...front, name: 'rear', mounting: [back(x), back(y), z, w] }, { ...front, name: 'front' }];"
        "lenses.set(1, lenses.get(0)); cameraTabs(); choose(chosen)"
    )
    until(browser, "return !frame && camera === 1 && !sight")
    press(browser, "c")
    until(browser, "return camera === 0 && $('band').textContent.endsWith('Seen by: front.')")
    browser.execute_script("choose(null); choose(ranked()[0].id)")
    until(browser, "return camera === 1")


def test_a_doubt_is_explained(browser, server):
    page(browser, server)
    browser.execute_script("tracks.get(chosen).doubts = [{ reason: 'short', value: .4 }]; report()")
    browser.find_element("css selector", "#why button").click()
    assert told(browser).startswith("short (0.4): Seconds that it moves.")


def test_what_was_played_and_nothing_else_counts_as_watched(browser, server, reviews, drive):
    page(browser, server)
    press(browser, Keys.ARROW_RIGHT)
    browser.execute_script("seek(D.times.length - 1)")
    assert browser.execute_script("return D.times.filter(watched).length") == 0
    browser.execute_script("$('speed').value = '4'; seek(0)")
    press(browser, " ")
    until(browser, "return !playing && i === D.times.length - 1 && D.times.every(watched)")
    assert told(browser) == f"Played to the end. {len(drive.tracks)} tracks are still undecided."
    assert stored(reviews).watched_ns == tuple(sweep.timestamp_ns for sweep in drive.sweeps)


def box_of(browser):
    """Centre, heading and size of the selected box."""
    return browser.execute_script("const s = stateAt(tracks.get(chosen)); return [...s.row.slice(0, 4), ...s.size]")


def drag(browser, x, y, *steps):
    """Press at a point of the window, px, move in steps, lift."""
    pointer = (actions := ActionChains(browser, duration=20)).w3c_actions.pointer_action
    pointer.move_to_location(round(x), round(y)).pointer_down()
    for dx, dy in steps:
        pointer.move_to_location(round(x) + dx, round(y) + dy)
    pointer.pointer_up()
    actions.perform()


def test_dragging_the_box_makes_a_key_frame(browser, server, reviews):
    page(browser, server)
    x, y, *_ = box_of(browser)
    name, scale = browser.execute_script("return [chosen, view.scale]")
    before = applied(stored(reviews))[name].motion.centres_m
    drag(browser, *at_screen(browser, x, y), (10, 0), (24, 0))
    (moved,) = wait_for_decisions(reviews, 1)
    assert (moved.action, moved.track) == ("set_box", name)
    shift = applied(stored(reviews))[name].motion.centres_m - before
    assert abs((shift[:, :2] ** 2).sum(axis=1) ** 0.5 - 24 / scale).max() < 3 / scale
    no_complaints(browser)


def test_a_side_of_the_box_is_dragged_in_the_view_from_above(browser, server, reviews):
    page(browser, server)
    before = box_of(browser)
    x, y, metre = browser.execute_script(
        "const s = stateAt(tracks.get(chosen)), f = frameOf('top', s.size), r = $('top').getBoundingClientRect();"
        "return [r.left + f.w / 2, r.top + f.h / 2 - s.size[1] / 2 * f.k, f.k]"
    )
    drag(browser, x, y, (0, -9))
    (decision,) = wait_for_decisions(reviews, 1)
    assert decision.size_m[1] - before[5] == pytest.approx(9 / metre, abs=0.3 / metre)
    moved = np.hypot(decision.centre_m[0] - before[0], decision.centre_m[1] - before[1])
    assert moved == pytest.approx(4.5 / metre, abs=0.3 / metre)  # the other side stays


def test_keys_move_turn_and_resize_the_box(browser, server, reviews):
    page(browser, server)
    x, y, _, yaw, _, _, height = box_of(browser)
    press(browser, "iiq")
    (decision,) = wait_for_decisions(reviews, 1)
    forward = np.hypot(decision.centre_m[0] - x, decision.centre_m[1] - y)
    assert forward == pytest.approx(0.1, abs=2e-3)
    assert decision.yaw_rad - yaw == pytest.approx(0.01745, abs=1e-3)
    press(browser, ".")
    assert wait_for_decisions(reviews, 2)[-1].size_m[2] - height == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(
    ("key", "alt", "front_m", "rear_m"),
    [
        ("]", False, 0.25, 0.0), ("[", False, -0.25, 0.0), ("}", False, 0.0, -0.25), ("{", False, 0.0, 0.25),
        ("]", True, 0.05, 0.0), ("{", True, 0.0, 0.05),
    ],
)  # fmt: skip
def test_keys_move_one_end_of_the_box(browser, server, reviews, key, alt, front_m, rear_m):
    page(browser, server)
    x, y, _, yaw, length, *_ = box_of(browser)
    keys = ActionChains(browser)
    (keys.key_down(Keys.ALT).send_keys(key).key_up(Keys.ALT) if alt else keys.send_keys(key)).perform()
    (decision,) = wait_for_decisions(reviews, 1)
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    moved = (np.array(decision.centre_m[:2]) - [x, y]) @ ahead
    grown = decision.size_m[0] - length
    np.testing.assert_allclose([moved + grown / 2, moved - grown / 2], [front_m, rear_m], atol=2e-3)
    assert key in browser.execute_script("return $('keys').textContent")


def test_boxes_in_the_image_are_where_the_lens_puts_them(browser, server, drive):
    page(browser, server)
    name, camera = next(iter(drive.cameras.items()))
    image = drive.images[name][1]
    world_from_camera = drive.trajectory.world_from_vehicle(image.timestamp_ns) @ camera.vehicle_from_camera
    points_camera = [[0.0, 0.0, 5.0], [3.0, 0.5, 4.0], [-4.0, 1.0, 2.0], [2.0, -1.0, 0.8], [1.0, 1.0, -5.0]]
    points_world = world_from_camera.apply(np.array(points_camera)).tolist()
    until(browser, "return !!lens(0)")
    browser.execute_script("window.shown1 = fetchImage(0, 1)")
    until(browser, "return !!shown1.bitmap")
    found = browser.execute_script(
        "return arguments[0].map(p => pixel(lens(0), D.cameras[0].limit, shown1.pose, p))", points_world
    )
    expected, valid = camera.model.project(np.array(points_camera))
    assert valid.any()
    size = np.array([camera.model.width, camera.model.height])
    for part, pixel, seen in zip(found, expected, valid, strict=True):
        assert (part is not None) == bool(seen)
        if seen:
            np.testing.assert_allclose(np.array(part) * size - 0.5, pixel, atol=0.3)


def at_screen(browser, x, y):
    """Where a point of the world is in the window, px."""
    return browser.execute_script(
        "const r = $('bird').getBoundingClientRect(), p = toScreen(arguments[0], arguments[1], r.width, r.height);"
        "return [Math.round(r.left + p[0]), Math.round(r.top + p[1])]",
        float(x), float(y),
    )  # fmt: skip


def stroke(browser, points):
    """Press at the first point of the world, move through the others, lift."""
    (x, y), *others = [at_screen(browser, *point) for point in points]
    drag(browser, x, y, *((u - x, v - y) for u, v in others))


def test_the_reference_follows_the_box(browser, server, reviews):
    page(browser, server)
    until(browser, "return reference && reference.id === chosen && reference.core.length && $('band').className === ''")
    before, height = browser.execute_script("return [JSON.stringify(reference.core), $('camera').offsetHeight]")
    press(browser, "jjjjjjjj")  # 40 cm to the left, some of the returns are not in the box any more
    until(browser, f"return !outlining && reference.id === chosen && JSON.stringify(reference.core) !== {before!r}")
    browser.execute_script("seek(0); chosen = null; paint()")
    until(browser, "return $('band').className === 'unseen'")
    assert browser.execute_script("return $('camera').offsetHeight") == height  # nothing below it jumps
    name = browser.execute_script("choose(order[0]); return chosen")
    press(browser, "r")
    until(browser, f"return tracks.get('{name}').status === 'rejected'")
    browser.execute_script(f"choose('{name}')")
    until(browser, f"return chosen === '{name}' && $('band').className === 'unseen'")  # a rejected box has no reference
    no_complaints(browser)


def test_a_track_is_split_at_a_time_and_merged_again(browser, server, reviews):
    page(browser, server)
    name = browser.execute_script(
        "const t = tracks.get(chosen); seek(nearest(D.times, t.times[t.times.length >> 1])); return chosen"
    )
    before = len(applied(stored(reviews)))
    press(browser, "t")
    wait_for_decisions(reviews, 1)
    until(browser, f"return chosen === '{name}.1' && !!stateAt(tracks.get(chosen))")  # the later part, which is there
    assert "is selected" in browser.execute_script("return $('told').textContent")
    press(browser, "z")
    until(browser, f"return chosen === '{name}' && !tracks.has('{name}.1')")  # what was cut is selected again
    press(browser, "y")
    until(browser, f"return tracks.has('{name}.1')")
    assert len(applied(stored(reviews))) == before + 1
    browser.execute_script(f"choose('{name}'); mark('{name}.1')")
    press(browser, "m")
    decision = wait_for_decisions(reviews, 4)[-1]
    assert (decision.action, set(decision.tracks)) == ("merge", {name, f"{name}.1"})
    assert len(applied(stored(reviews))) == before
    no_complaints(browser)


def test_a_line_across_a_box_splits_it(browser, server, reviews):
    page(browser, server)
    browser.execute_script("view.scale = 40; paint()")
    x, y, _, yaw, length, width, _ = box_of(browser)
    centre, across = np.array([x, y]), np.array([-np.sin(yaw), np.cos(yaw)]) * (width / 2 + 1.0)
    press(browser, "p")
    stroke(browser, [centre + across, centre - across])
    (decision,) = wait_for_decisions(reviews, 1)
    assert decision.action == "split_space"
    until(browser, f"return chosen === '{decision.track}.1'")
    halves = [track for name, track in applied(stored(reviews)).items() if name.startswith(decision.track)]
    assert sum(track.size_m[0] for track in halves) == pytest.approx(length, abs=0.01)


@pytest.mark.parametrize("way", ["lasso", "click"])
def test_a_missing_object_is_drawn_from_its_points(browser, server, reviews, way):
    page(browser, server)
    x, y, *_, length, width, _ = box_of(browser)
    press(browser, "r")
    wait_for_decisions(reviews, 1)
    seen = browser.execute_script(
        "const [x, y, reach] = arguments, s = sweeps.get(i); let best = null, least = reach;"
        "for (let j = 0; j < s.n - s.road; j++) { const p = [s.o[0] + s.points[3*j]/100, s.o[1] + s.points[3*j+1]/100],"
        " d = Math.hypot(p[0] - x, p[1] - y); if (d < least) [best, least] = [p, d]; } return best",
        x, y, max(length, width),
    )  # fmt: skip
    assert seen is not None
    press(browser, "d")
    reach = max(length, width) / 2 + 0.4
    corners = [(x + a * reach, y + b * reach) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    stroke(browser, corners if way == "lasso" else [seen])
    decision = wait_for_decisions(reviews, 2)[-1]
    assert decision.action == "draw"
    until(browser, f"return chosen === '{decision.drawn.id}'")
    no_complaints(browser)


def test_a_page_whose_command_has_ended_shows_what_is_stored(browser, server, reviews):
    page(browser, server)
    ended = {"offline": True, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
    browser.execute_cdp_cmd("Network.enable", {})
    browser.execute_cdp_cmd("Network.emulateNetworkConditions", ended)
    press(browser, "a")
    until(browser, "return over")
    browser.execute_async_script("open_(0).catch(() => 0).then(() => arguments[0]())")
    assert browser.execute_script("return D !== null"), "the drive stays on the page"
    browser.execute_cdp_cmd("Network.emulateNetworkConditions", ended | {"offline": False})
    assert browser.execute_script("return [...tracks.values()].every(t => t.status === 'open')")
    press(browser, " ")
    assert not browser.execute_script("return playing")
    assert "the command has ended" in browser.execute_script("return $('told').textContent")
    assert stored(reviews).decisions == ()


def test_what_cannot_be_stored_is_said(browser, server, reviews):
    page(browser, server)
    file = review_file(reviews, DRIVE)
    file.write_bytes(file.read_bytes() + b"\n")
    chosen = browser.execute_script("return chosen")
    press(browser, "a")
    assert until(browser, "return $('told').textContent").startswith("Not stored: ")
    until(browser, f"return tracks.get('{chosen}').status === 'open'")


def rewrite(reviews, change):
    """Store the review with its first track changed."""
    review = stored(reviews)
    first, *others = review.tracks
    write_review(review_file(reviews, DRIVE), review.model_copy(update={"tracks": (change(first), *others)}))


def test_a_hole_is_seen_in_the_list_and_in_the_timeline_and_filled_by_a_key_frame(browser, server, reviews):
    rewrite(reviews, lambda track: track.model_copy(update={"states": (*track.states[:3], *track.states[4:])}))
    page(browser, server)
    browser.execute_script("choose('p000'); seek(3)")
    assert "hole of 1 sweep" in browser.execute_script("return document.querySelector('#why').textContent")
    assert "hole" in browser.execute_script("return document.querySelector('#tracks [aria-pressed=true]').textContent")
    until(browser, "return $('size').textContent.startsWith('A hole')")
    whole, hole = browser.execute_script(
        "const b = bars.find(b => b.t.id === 'p000'), g = $('rows').getContext('2d'), { x } = scale();"
        "return [1.5, 3].map(n => g.getImageData(x(n * step), b.y + 4, 1, 1).data.join())"
    )
    assert whole != hole
    press(browser, Keys.ENTER)
    assert wait_for_decisions(reviews, 1)[0].action == "set_box"
    until(browser, "return bars.find(b => b.t.id === 'p000').runs.length === 1 && !tracks.get('p000').doubts.length")
    no_complaints(browser)


def test_the_timeline_has_the_rows_of_the_list(browser, server):
    page(browser, server)
    rows, listed = browser.execute_script("return [bars.map(b => b.t.id), ranked().map(t => t.id)]")
    assert rows == listed
    left, top, *_ = sides_of(browser, "rows")
    drag(browser, left + 8, top + browser.execute_script("return bars.at(-1).y") + 4)
    assert browser.execute_script("return chosen") == rows[-1]
    browser.execute_script(
        "for (let n = 0; n < 10; n++) tracks.set(`x${n}`, { ...tracks.get(chosen), id: `x${n}` });"
        "order = [...tracks.keys()].slice(-10); report(); paint()"
    )
    until(browser, "return bars.length === 10 && $('lanes').scrollHeight <= $('lanes').clientHeight")  # ten at once


def test_labels_do_not_overlap_and_the_selected_one_is_always_there(browser, server, reviews):
    """Nine tracks at one place: some labels are beside, above and below, the others are left out."""
    review = stored(reviews)
    copies = [review.tracks[0].model_copy(update={"id": f"c{i}"}) for i in range(8)]
    write_review(review_file(reviews, DRIVE), review.model_copy(update={"tracks": (*review.tracks, *copies)}))
    page(browser, server)
    browser.execute_script("choose('c5'); seek(nearest(D.times, tracks.get('c5').times[1]))")
    until(browser, "return drawn === i && placed.some(p => p.name === 'c5')")
    labels = browser.execute_script("return placed")
    of_copies = [label for label in labels if label["name"] in {"p000", *(f"c{i}" for i in range(8))}]
    assert 2 <= len(of_copies) <= 4
    for n, a in enumerate(labels):
        for b in labels[:n]:
            apart = a["right"] < b["left"] or a["left"] > b["right"] or a["bottom"] < b["top"] or a["top"] > b["bottom"]
            assert apart, (a, b)
