"""Files that appear whole or not at all, or are read as regular ones; folders of one process; paths inside a folder.

All that commands write goes through here; what cannot be written is reported in one line.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from itertools import accumulate
from pathlib import Path, PurePosixPath, PureWindowsPath
from uuid import uuid4

from bench.errors import DataError, OutputError

LINKS = "put the file itself there; links to folders at the top of a data set: option follow_links (docs/your-data.md)"
MOST_LINK_LEVELS = 4  # below the root of a data set
LARGEST_READ_BYTES = 1 << 30  # of a file that is read at once and has no limit of its own


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well.

    The temporary name is hidden and keeps the suffix, since many writers choose the format by it. Parent folders are
    made. When the block raises, `path` stays as it was and the temporary file is removed. A link at `path` is
    replaced, not followed.

    Args:
        path: the file to write.

    Yields:
        The path to write to.

    Raises:
        OutputError: the folder cannot be made, the file not be written, or something else than a file is in its way.
    """
    make_folder(path.parent)
    temporary = path.with_name(temporary_name(path.stem, path.suffix))
    try:
        if path.exists() and not path.is_file():  # as root one could put a file in the place of /dev/null
            raise OutputError(path, got="a folder or device that is there")
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.filename in {None, str(temporary), str(path)}:  # others are of files that the block reads
            raise OutputError.of(error, path) from error
        raise
    finally:
        with suppress(OSError):  # where nothing could be written, nothing is left
            temporary.unlink(missing_ok=True)


TEMPORARY = re.compile(r"\..{1,60}\.[0-9a-f]{32}(\..*)?")


def temporary_name(stem: str, suffix: str = "") -> str:
    """A new name of something half written; hidden, with the suffix of what it becomes."""
    return f".{stem[:60]}.{uuid4().hex}{suffix}"


def is_temporary(name: str) -> bool:
    """True for a name that `temporary_name` made."""
    return TEMPORARY.fullmatch(name) is not None


def write_bytes(path: Path, content: bytes) -> None:
    """Write a whole file.

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, content: str) -> None:
    """Write a whole file, UTF-8, with unchanged line ends; what is not UTF-8 of a file's name becomes `\\udc..`.

    Raises:
        OutputError: it cannot be written.
    """
    write_bytes(path, content.encode(errors="backslashreplace"))


def write_output(path: Path, content: str) -> None:
    """Write a whole file that a user named or that lies in a folder that they named; see `refuse_foreign`.

    Raises:
        OutputError: it cannot be written, or another file is there.
    """
    refuse_foreign(path, content)
    write_text(path, content)


def refuse_foreign(path: Path, content: str = "") -> None:
    """Refuse to replace a file that is no earlier form of what is to be written: whoever made it would lose it.

    Args:
        path: that is to be written.
        content: of it; "" where nothing shows that a file is an earlier form.

    Raises:
        OutputError: another file is there.
    """
    if not path.is_file():
        return
    with path.open(encoding="utf-8", errors="replace") as file:
        there = file.read(LARGEST_OUTPUT_CHARS)
    if not content or _form(there) != _form(content):
        got, hint = "a file that is there and is something else", "move it away, or name another place"
        raise OutputError(path, got=got, hint=hint)


LARGEST_OUTPUT_CHARS = 100_000_000


def _form(text: str) -> object:
    """Common part of all files of a kind: keys of JSON, head of a page, root of XML, first column of CSV."""
    if text.startswith("{"):
        try:
            return sorted(json.loads(text))
        except (ValueError, RecursionError):
            return None
    if text.startswith("<!DOCTYPE"):
        return text.partition("<title>")[0]
    if text.startswith("<?xml"):
        return re.findall(r"<\w+", text[:1000])[:1]
    return re.split(r"[,\n]", text, maxsplit=1)[0]


def open_regular(path: Path) -> BufferedReader:
    """Open a file for reading; unlike `open`, it never waits for a pipe and reads no device, which may have no end.

    Raises:
        OSError: it cannot be opened, or is no regular file.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    kind = os.fstat(handle).st_mode
    if not stat.S_ISREG(kind):
        os.close(handle)
        what = "a folder" if stat.S_ISDIR(kind) else "a pipe or device"
        raise OSError(errno.EINVAL, f"{what}, no regular file", str(path))
    return os.fdopen(handle, "rb")


def read_regular(path: Path, *, largest_bytes: int = LARGEST_READ_BYTES) -> bytes:
    """Read a whole file, as `open_regular` opens it.

    Raises:
        OSError: as `open_regular`, or it is larger.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > largest_bytes:
            raise OSError(errno.EINVAL, f"{size} bytes, over the limit of {largest_bytes}", str(path))
        return file.read()


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, where they are not there.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError.of(error, folder) from error


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder that takes the place of `out`, new or empty, when the block ends well; else nothing of it stays.

    Raises:
        DataError: `out` holds something.
        OutputError: it cannot be made.
    """
    refuse_filled(out)
    place = out.absolute()
    new = place.with_name(temporary_name(place.name))
    make_folder(new)
    try:
        yield new
        if place.exists():
            place.rmdir()
        new.rename(place)
    except OSError as error:
        raise OutputError.of(error, out) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)


def refuse_filled(out: Path) -> None:
    """Refuse a folder that is neither new nor empty.

    Raises:
        DataError: it holds something, or is a file.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        got, hint = "one that holds something" if out.is_dir() else "a file", "name another folder with --out"
        raise DataError(out, expected="a new or an empty folder", got=got, hint=hint)


@contextmanager
def folder_lock(folder: Path, *, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Lock a folder that exists.

    Args:
        folder: to be locked.
        shared: share the lock with others that do so as well.
        wait: until it is free, instead of raising.

    Raises:
        DataError: another process holds the lock, and `wait` is False.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
        except BlockingIOError as error:
            got, hint = "one in use by another run", "wait until that run ends, or choose another folder with --out"
            raise DataError(folder, expected="a folder that no other run uses", got=got, hint=hint) from error
        yield
    finally:
        os.close(handle)


def path_inside(root: Path, relative: str, *, file: Path, field: str | None = None) -> Path:
    """A path named by a data file.

    Args:
        root: folder that the path must not leave.
        relative: the path as it stands in the file, relative to `root`.
        file: the file that names it, for the message.
        field: where in the file.

    Returns:
        The path below `root`; it need not exist.

    Raises:
        DataError: an absolute path, one with "..", or one that leads outside through a symbolic link.
    """
    parts = PurePosixPath(relative).parts
    absolute = PurePosixPath(relative).is_absolute() or PureWindowsPath(relative).is_absolute()
    if not parts or absolute or ".." in parts or "\\" in relative or "\0" in relative:
        raise DataError(file, field=field, expected="a relative path without '..'", got=repr(relative))
    path = root.joinpath(*parts)
    refuse_escape(root, path, file=file, field=field)
    return path


def linked_folder(root: Path, path: Path, *, levels: int) -> Path:
    """The folder that a path must not leave, where links at the top of a data set are followed.

    Parts of a data set are often on other disks, so that a user has links to them in its root. What is below such a
    folder may come from elsewhere, and links in it are not followed.

    Args:
        root: folder of the data set.
        path: below it, or one that is to be refused.
        levels: how many levels below the root links to folders are followed: 1 for those in the root itself.

    Returns:
        The deepest link to a folder among these levels of `path`; `root` where there is none.
    """
    below = path.relative_to(root).parts[:levels] if path.is_relative_to(root) else ()
    tops = list(accumulate(below, Path.joinpath, initial=root))[1:]
    return next((top for top in reversed(tops) if top.is_symlink() and top.is_dir()), root)


def refuse_escape(root: Path, path: Path, *, file: Path, field: str | None = None) -> None:
    """Refuse a path that leaves the root once symbolic links are followed.

    Args:
        root: the folder.
        path: below it.
        file: for the message.
        field: the same.

    Raises:
        DataError: it does.
    """
    if not path.resolve().is_relative_to(root.resolve()):
        raise DataError(
            file, field=field, expected=f"a path inside {root}", got=f"{path}, a link that leads outside", hint=LINKS
        )
