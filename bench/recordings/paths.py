"""Paths that data files name, kept inside the data set's root."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

from bench.errors import DataError


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


def refuse_escape(root: Path, path: Path, *, file: Path, field: str | None = None) -> None:
    """Refuse a path that leaves the root once symbolic links are followed.

    Raises:
        DataError: it does.
    """
    if not path.resolve().is_relative_to(root.resolve()):
        raise DataError(file, field=field, expected=f"a path inside {root}", got=f"{path}, a link that leads outside")
