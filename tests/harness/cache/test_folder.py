"""A cache is right or finds nothing, stays below its limit, and never touches what is not its own."""

import os
from functools import partial

import numpy as np
import pytest

from bench.errors import DataError
from bench.execution import ProcessExecutor
from bench.harness.cache import CacheFolder
from bench.harness.cache import folder as of_cache

ENTRY_BYTES = 8_000


def digest(number: int) -> str:
    return f"{number:064x}"[::-1]


def entry(number: int) -> dict[str, np.ndarray]:
    return {"values": np.full(ENTRY_BYTES // 8, float(number))}


def cache_of(folder, *, entries: int | None = None) -> CacheFolder:
    cache = CacheFolder(folder=folder) if entries is None else CacheFolder(folder=folder, limit_bytes=entries * 9_000)
    cache.prepare()
    return cache


def held(cache: CacheFolder, numbers) -> list[int]:
    return [number for number in numbers if cache.get("step", digest(number)) is not None]


def test_what_is_kept_is_found(tmp_path):
    cache = cache_of(tmp_path)
    cache.put("step", digest(1), entry(1) | {"flags": np.array([True, False]), "none": np.zeros((0, 3), np.float32)})
    found = CacheFolder(folder=tmp_path).get("step", digest(1))
    assert found is not None
    assert {name: (array.dtype.str, array.shape) for name, array in found.items()} == {
        "values": ("<f8", (1000,)), "flags": ("|b1", (2,)), "none": ("<f4", (0, 3)),
    }  # fmt: skip
    assert cache.get("step", digest(2)) is None
    assert cache.get("other", digest(1)) is None
    assert (dict(cache.found), dict(cache.missed)) == ({}, {"step": 1, "other": 1})


def test_the_limit_is_kept_and_what_was_not_used_for_longest_goes_first(tmp_path):
    cache = cache_of(tmp_path, entries=3)
    for number in range(6):
        cache.put("step", digest(number), entry(number))
        os.utime(cache._file("step", digest(number)), ns=(number, number))
    assert cache.get("step", digest(0)) is not None  # and so the last that was used
    use = cache.evict()
    assert held(cache, range(6)) == [0, 4, 5]
    assert (use.files, use.size_bytes <= cache.limit_bytes) == (3, True)
    assert cache.use() == use


def test_room_is_made_while_entries_are_added(tmp_path, monkeypatch):
    monkeypatch.setattr(of_cache, "EVICT_AFTER_BYTES", 5 * ENTRY_BYTES)
    cache = cache_of(tmp_path, entries=3)
    for number in range(50):
        cache.put("step", digest(number), entry(number))
        assert cache.use().size_bytes <= cache.limit_bytes + 6 * 9_000


def test_a_limit_of_nothing_empties_the_folder_but_keeps_it_a_cache(tmp_path):
    cache = cache_of(tmp_path)
    cache.put("step", digest(1), entry(1))
    assert cache.evict(0).files == 0
    cache_of(tmp_path)


def test_half_written_entries_count_and_go(tmp_path):
    cache = cache_of(tmp_path)
    cache.put("step", digest(1), entry(1))
    file = cache._file("step", digest(1))
    left = file.with_name(f".{file.stem}.0123.npz")
    left.write_bytes(file.read_bytes()[:100])
    assert cache.use().files == 2
    cache.evict(0)
    assert not left.exists()


def test_a_folder_with_other_files_is_refused_and_stays_as_it_is(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(DataError, match="expected an empty folder or a cache") as raised:
        cache_of(tmp_path)
    assert "--cache" in str(raised.value)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.tex"]


def test_files_of_others_in_a_cache_stay(tmp_path):
    cache = cache_of(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    cache.put("step", digest(1), entry(1))
    cache.evict(0)
    assert (tmp_path / "notes.txt").exists()


def test_a_place_where_no_folder_can_be_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="expected a folder for the cache") as raised:
        cache_of(tmp_path / "file" / "cache")
    assert "--no-cache" in str(raised.value)


def test_a_place_that_cannot_be_written_keeps_nothing_and_raises_nothing(tmp_path):
    cache = cache_of(tmp_path)
    (tmp_path / "step").write_text("a file where a folder should be")
    cache.put("step", digest(1), entry(1))
    assert cache.get("step", digest(1)) is None


def test_a_folder_that_is_removed_is_made_again(tmp_path):
    cache = cache_of(tmp_path / "cache")
    cache.put("step", digest(1), entry(1))
    (tmp_path / "cache").rename(tmp_path / "gone")
    assert cache.get("step", digest(1)) is None
    cache.put("step", digest(1), entry(1))
    assert held(cache, [1]) == [1]


@pytest.mark.parametrize("cut", [0, 1, 30, 4000, -1, -22, -60])
def test_a_damaged_entry_is_not_found_and_may_be_kept_anew(tmp_path, cut):
    cache = cache_of(tmp_path)
    cache.put("step", digest(1), entry(1))
    file = cache._file("step", digest(1))
    file.write_bytes(file.read_bytes()[:cut])
    assert cache.get("step", digest(1)) is None
    cache.put("step", digest(1), entry(1))
    assert held(cache, [1]) == [1]


def test_a_changed_bit_is_not_taken_for_the_array(tmp_path):
    cache = cache_of(tmp_path)
    cache.put("step", digest(1), entry(1))
    file = cache._file("step", digest(1))
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert cache.get("step", digest(1)) is None


def test_pickles_are_never_loaded(tmp_path):
    cache = cache_of(tmp_path)
    file = cache._file("step", digest(1))
    file.parent.mkdir(parents=True)
    np.savez(file, values=np.array([{"a": 1}], dtype=object))
    assert cache.get("step", digest(1)) is None


def hammer(folder, seed: int) -> int:
    """Put, get and sweep at random; how many entries were found, all of them right."""
    cache, rng, found = cache_of(folder, entries=10), np.random.default_rng(seed), 0
    for number in rng.integers(0, 30, 400).tolist():
        if rng.random() < 0.5:
            cache.put("step", digest(number), entry(number))
        elif rng.random() < 0.1:
            cache.evict()
        else:
            arrays = cache.get("step", digest(number))
            if arrays is not None:
                assert np.array_equal(arrays["values"], entry(number)["values"])
                found += 1
    cache.evict()
    return found


def test_processes_share_a_folder(tmp_path):
    done = dict(ProcessExecutor(workers=2).compute(partial(hammer, tmp_path), [1, 2, 3, 4]))
    assert all(found > 0 for found in done.values())
    assert cache_of(tmp_path, entries=10).evict().files <= 10
    assert not [file for file in tmp_path.rglob(".*") if file.is_file()]
