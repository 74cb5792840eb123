"""Files of data sets: folders listed by number, texts never read without a limit, large ones part by part."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from os import scandir
from pathlib import Path
from typing import IO
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import iterparse

from bench.atomic import LARGEST_READ_BYTES, open_regular, read_regular, refuse_escape
from bench.errors import DataError
from bench.records.recording import Content

LARGEST_BYTES = 100_000_000  # a million rows of poses
LARGEST_NUMBER = 1e12  # nothing that is measured comes near, and squares of it stay finite
READ_BYTES = 65_536


def numbered_files(root: Path, folder: Path, number_of: Callable[[Path], int | None], *, each: str) -> dict[int, Path]:
    """The files of a folder by their number, in order; none where the folder does not exist.

    Args:
        root: folder of the data set, which no file may leave.
        folder: below it.
        number_of: of a file, by its name; None for one to pass over.
        each: what has one file, for messages.

    Raises:
        DataError: a name that `number_of` refuses, a file or folder that leads outside of `root`, or a number that two
            files have.
    """
    if not folder.is_dir():
        return {}
    refuse_escape(root, folder, file=folder)
    files: dict[int, Path] = {}
    for entry in sorted(scandir(folder), key=lambda entry: entry.name):
        path = folder / entry.name
        number = number_of(path)
        if number is None:
            continue
        if entry.is_symlink():
            refuse_escape(root, path, file=path)
        if number in files:
            raise DataError(path, expected=f"one file for each {each}", got=f"also {files[number].name}")
        files[number] = path
    return dict(sorted(files.items()))


def file_contents(
    root: Path, folder: Path, read: Iterable[Path], read_as: str, *, suffixes: Sequence[str] = ()
) -> Iterator[Content]:
    """What a folder holds: files that are read, and others by their suffix; nothing where it does not exist.

    Args:
        root: of the recording, from which the folder is named.
        folder: below it.
        read: its files that are read.
        read_as: what they become.
        suffixes: those that files of the folder should have; none where others are usual beside them.
    """
    if not folder.is_dir():
        return
    names = {path.name for path in read}
    groups: dict[tuple[str, bool], list[str]] = defaultdict(list)
    for entry in scandir(folder):
        if not entry.name.startswith("."):
            pattern = f"{entry.name}/" if entry.is_dir() else f"*{Path(entry.name).suffix}"
            groups[pattern, entry.name in names].append(pattern if entry.is_dir() else entry.name)
    place = "" if folder == root else f"{folder.relative_to(root).as_posix()}/"
    why = f"no {' or '.join(suffixes)}" if suffixes else "not asked for"
    for (pattern, is_read), entries in sorted(groups.items()):
        yield Content(
            what=f"{place}{pattern if len(entries) > 1 else entries[0]}",
            count=len(entries),
            read_as=read_as if is_read else "",
            why="" if is_read else why,
            suspect=bool(suffixes) and not is_read,
        )


def framed_files(root: Path, folder: Path, pattern: str) -> dict[int, Path]:
    """The files of a folder whose whole name fits a pattern, by the frame number in its first group, in order."""
    named = re.compile(pattern)

    def number_of(path: Path) -> int | None:
        match = named.fullmatch(path.name)
        return None if match is None else int(match[1])

    return numbered_files(root, folder, number_of, each="frame")


def read_whole(file: Path, *, expected: str = "a readable file", largest_bytes: int = LARGEST_READ_BYTES) -> bytes:
    """Read a whole file.

    Args:
        file: a regular file.
        expected: what it is, for messages.
        largest_bytes: a larger file is refused before it is read.

    Raises:
        DataError: it is missing, no regular file, too large, or cannot be read.
    """
    try:
        return read_regular(file, largest_bytes=largest_bytes)
    except OSError as error:
        raise DataError(file, expected=expected, got=error.strerror or str(error)) from error


def read_text(file: Path, *, largest_bytes: int = LARGEST_BYTES, expected: str = "a readable text file") -> str:
    """Read a text file.

    Args:
        file: UTF-8 text.
        largest_bytes: a larger file is refused before it is read.
        expected: what the file is, for messages.

    Raises:
        DataError: missing, too large, empty, or not UTF-8.
    """
    try:
        text = read_whole(file, expected=expected, largest_bytes=largest_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(
            file, expected="UTF-8 text", got=f"byte {error.object[error.start]:#04x} at {error.start}"
        ) from None
    if not text.strip():
        raise DataError(file, expected="text", got="an empty file")
    return text


def numbers(words: list[str], count: int, *, file: Path, field: str) -> list[float]:
    """Turn words into finite numbers, at most `LARGEST_NUMBER`.

    Args:
        words: from the file.
        count: how many there must be.
        file: where they come from.
        field: where in the file.

    Raises:
        DataError: more or fewer, or something that is not a finite number.
    """
    if len(words) != count:
        raise DataError(file, field=field, expected=f"{count} numbers", got=str(len(words)))
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not abs(value) <= LARGEST_NUMBER:
            expected = f"numbers up to {LARGEST_NUMBER:g}" if np.isfinite(value) else "finite numbers"
            raise DataError(file, field=field, expected=expected, got=repr(word[:40]))
        values.append(value)
    return values


DECLARED = re.compile(rb"""\A(\s{0,9}<\?xml[^>]{0,200}standalone\s*=\s*)(["'])true\2""")


class _MeteredFile:
    """A file that stops with an error where one part of it is too long.

    It says `standalone="yes"` where some tools write "true", which XML does not know.
    """

    def __init__(self, raw: IO[bytes], file: Path, *, parts: str, largest_bytes: int) -> None:
        self._raw, self._file, self._parts, self._largest = raw, file, parts, largest_bytes
        self._since, self._begun = 0, False

    def read(self, _size: int = READ_BYTES) -> bytes:
        content = self._raw.read(READ_BYTES)
        self._since += len(content)
        if self._since > self._largest:
            expected = f"{self._parts} of at most {self._largest} bytes"
            raise DataError(self._file, expected=expected, got="a longer one")
        first, self._begun = not self._begun, True
        return DECLARED.sub(rb"\1\2yes\2", content) if first else content

    def restart(self) -> None:
        """A new part begins."""
        self._since = 0


def xml_parts(
    file: Path, *, level: int, parts: str, largest_bytes: int, deepest: int, outer: tuple[str, ...] = ()
) -> Iterator[Element]:
    """The elements of a level of an XML file, one by one; each is gone when the next one is read.

    Args:
        file: XML.
        level: how many elements are around each; 1 for the children of the root.
        parts: what they are, for messages.
        largest_bytes: of XML without the end of such an element.
        deepest: levels of elements that the file may have.
        outer: names that the outermost elements must have.

    Raises:
        DataError: missing, cut short, not XML, with entities, nested too deeply, with other outer elements, or with an
            element that is too long.
    """
    try:
        with open_regular(file) as raw:
            source = _MeteredFile(raw, file, parts=parts, largest_bytes=largest_bytes)
            opened: list[Element] = []
            for event, element in iterparse(source, events=("start", "end")):
                if event == "start":
                    opened.append(element)
                    if len(opened) <= len(outer) and element.tag != outer[len(opened) - 1]:
                        got = " with ".join(around.tag for around in opened)[:80]
                        raise DataError(file, expected=" with ".join(outer), got=got)
                    if len(opened) > deepest:
                        raise DataError(file, expected=f"at most {deepest} levels of elements", got="more")
                    continue
                opened.pop()
                if len(opened) == level:
                    yield element
                    opened[-1].clear()
                    source.restart()
    except OSError as error:
        raise DataError(file, expected=f"a file of {parts}", got=error.strerror or str(error)) from error
    except DefusedXmlException as error:
        raise DataError(file, expected="XML without entities", got=str(error)) from None
    except (ParseError, ValueError) as error:
        raise DataError(file, expected="well-formed XML", got=f"{error}; the file may be cut short") from None
