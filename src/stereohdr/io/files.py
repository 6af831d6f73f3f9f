"""Writing files so that nobody ever sees half of one, and saying early where that cannot work."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stereohdr.errors import FileFormatError, OutputError

_NOT_PERMITTED = frozenset((errno.EACCES, errno.EPERM, errno.EROFS))
_NO_ROOM = frozenset((errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)))


def check_output(path: str | Path) -> None:
    """Check that a file can be written, before the work that it is to hold is done.

    Raises
    ------
    FileFormatError
        The folder does not exist, or `path` is a folder or no valid name.
    OutputError
        The folder cannot be written to.
    """
    target = Path(path)
    try:
        folder_exists, is_folder = target.parent.is_dir(), target.is_dir()
        with suppress(FileNotFoundError, NotADirectoryError):
            target.stat()  # fails for names that the file system does not take
    except (OSError, ValueError) as error:
        kind = OutputError if _is_of_the_environment(error) else FileFormatError
        raise kind(f"{target}: cannot be written ({_reason(error)}); choose another name or folder") from error
    if not folder_exists:
        raise FileFormatError(f"{target}: the folder {target.parent} does not exist; create it first")
    if is_folder:
        raise FileFormatError(f"{target}: is a folder; give the name of a file")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{target}: the folder {target.parent} cannot be written to; choose another")


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path` that replaces it on success and vanishes on failure.

    The temporary name keeps the suffix, so that writers which choose a format by suffix work.

    Raises
    ------
    FileFormatError
        `path` is no name for a file, see `check_output`.
    OutputError
        Writing failed: the disk is full, or writing is not permitted.
    """
    target = Path(path)
    check_output(target)
    temporary = target.with_name(f".stereohdr-{secrets.token_hex(4)}{target.suffix}")
    try:
        yield temporary
        temporary.replace(target)
    except (OSError, UnicodeError) as error:
        raise OutputError(
            f"{target}: cannot be written ({_reason(error)}); make room, or choose another name or folder"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def make_folder(path: str | Path) -> Path:
    """Create a folder, and those above it, unless it exists.

    Raises
    ------
    FileFormatError
        Its name is that of a file, or no valid name.
    OutputError
        The disk is full, or writing is not permitted.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise FileFormatError(f"{folder}: is a file; give the name of a folder") from error
    except (OSError, ValueError) as error:
        kind = OutputError if _is_of_the_environment(error) else FileFormatError
        raise kind(f"{folder}: the folder cannot be created ({_reason(error)}); choose another") from error
    if not os.access(folder, os.W_OK):
        raise OutputError(f"{folder}: the folder cannot be written to; choose another")
    return folder


@contextmanager
def new_folder(path: str | Path) -> Iterator[Path]:
    """Create a folder like `make_folder`; if what follows fails, remove it again unless something is in it."""
    folder = Path(path)
    created = []
    with suppress(OSError, ValueError):  # `make_folder` says what is wrong
        created = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        yield make_folder(folder)
    except BaseException:
        with suppress(OSError):
            for one in created:
                one.rmdir()
        raise


def _is_of_the_environment(error: Exception) -> bool:
    """Return whether the name is fine, and something else is in the way."""
    return isinstance(error, OSError) and error.errno in _NOT_PERMITTED | _NO_ROOM


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
