"""References as files in the user's cache: built once for any number of methods, read in a millisecond.

`<cache>/references/<digest>/<camera and images>.pickle` has the references of a task. The digest is of the recording's
content, the protocol's rules for references and the code that builds them, so that nothing there is ever out of date;
the folder may be removed at any time. Like all of the cache it is this user's own, and is trusted.
"""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
from platformdirs import user_cache_path

from bench.atomic import write_bytes
from bench.errors import BenchError, OutputError
from bench.harness.digests import REFERENCE_CODE, code_digest, digest_of, library_versions
from bench.recordings import ImageRef, Recording
from bench.records.reference import ReferenceFrame
from bench.records.rules import ReferenceSettings
from bench.reference.build import ReferenceBuilder

CACHE_VARIABLE = "FISHEYE_BENCH_CACHE"
LIMIT_BYTES = 4 << 30

StoredReference = bytes | str  # packed, a thousandth of its size in memory; or why there is none


def cache_folder() -> Path:
    """The user's cache folder, or the one that the environment names."""
    named = os.environ.get(CACHE_VARIABLE)
    return Path(named).absolute() if named else user_cache_path("fisheye-bench")


def message_without_root(error: BaseException, recording: Recording) -> str:
    """The message of an error, the same wherever the data lie."""
    return str(error).replace(str(recording.root), recording.name)


def find_references(
    recording: Recording, images: Sequence[ImageRef], *, settings: Sequence[ReferenceSettings], digest: str
) -> list[list[StoredReference]]:
    """The references of the images of a task, from the cache where they are there, else built and put there.

    Args:
        recording: the drive.
        images: of one camera, at least one.
        settings: of each protocol.
        digest: of the recording's content.

    Returns:
        For each of `settings`, the reference of each image, which `reference_of` unpacks.
    """
    camera, key = images[0].camera, [images[0].timestamp_ns, images[-1].timestamp_ns, len(images)]
    code = digest_of(code_digest(REFERENCE_CODE), library_versions())
    builder: ReferenceBuilder | None = None
    references = []
    for rules in settings:
        folder = cache_folder() / "references" / digest_of(code, digest, rules)[:32]
        file = folder / f"{digest_of(camera, key)[:32]}.pickle"
        stored = _read(file)
        if stored is None:
            builder = ReferenceBuilder(recording, camera, rules, beside=builder)
            stored = [_built(builder, image) for image in images]
            if not any(isinstance(reference, str) for reference in stored):
                with suppress(OutputError):
                    write_bytes(file, pickle.dumps(stored))
        references.append(stored)
    return references


def reference_of(stored: StoredReference, recording: str) -> ReferenceFrame:
    """Unpack a reference, equal in every value to that which was built.

    Args:
        stored: of the image.
        recording: name; one of another name may have the same content.

    Raises:
        BenchError: there is none.
    """
    if isinstance(stored, str):
        raise BenchError(stored)
    with pa.input_stream(pa.py_buffer(stored), compression="zstd") as content:
        frame: ReferenceFrame = pickle.loads(content.read())
    return replace(frame, recording=recording)


def pack_reference(frame: ReferenceFrame) -> bytes:
    """Pack a reference; areas of equal pixels, of which it is made, take next to nothing."""
    return bytes(pa.compress(pickle.dumps(frame), codec="zstd", asbytes=True))


def evict_cache() -> None:
    """Remove the references that were used longest ago until the rest takes no more than `LIMIT_BYTES`."""
    with suppress(FileNotFoundError):  # another process does the same
        folders = [folder for folder in (cache_folder() / "references").glob("*") if folder.is_dir()]
        sizes = {folder: sum(file.stat().st_size for file in folder.iterdir()) for folder in folders}
        total = sum(sizes.values())
        for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime):
            if total <= LIMIT_BYTES:
                break
            shutil.rmtree(folder, ignore_errors=True)
            total -= sizes[folder]


def _read(file: Path) -> list[StoredReference] | None:
    """What a file of the cache holds; None where there is none that can be read."""
    try:
        stored: list[StoredReference] = pickle.loads(file.read_bytes())
    except (OSError, EOFError, pickle.UnpicklingError):
        return None
    with suppress(OSError):
        os.utime(file.parent)  # it was used
    return stored


def _built(builder: ReferenceBuilder, image: ImageRef) -> StoredReference:
    try:
        return pack_reference(builder.build(image))
    except BenchError as error:
        return message_without_root(error, builder.recording)
