"""Text files, and messages about files that cannot be read, the same on all systems."""

import os
import re
from pathlib import Path

from ..base.errors import InputError
from .operating_system import length_problem

#: Control characters that a backslash and a letter make in TOML and JSON.
_ESCAPED = {"\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r"}
#: How to write a path of Windows in TOML.
QUOTES = "paths with backslashes in 'single quotes', or with slashes"


def failure_reason(error: OSError) -> str:
    """Why the system, or a library that has no error number, could not do something."""
    return error.strerror or str(error) or type(error).__name__


def unreadable_error(
    path: str | os.PathLike[str],
    expected: str | None = None,
    error: OSError | None = None,
) -> InputError:
    """The error of a file that is not there, is a folder, or cannot be opened.

    Windows calls the opening of a folder a lack of permission, and finds no file whose
    path is too long or holds what a backslash in TOML has made of a letter.
    """
    path = Path(path)
    if match := re.search(f"[{''.join(_ESCAPED)}]", str(path)):
        pair, text = _ESCAPED[match[0]], str(path)
        for character, written in _ESCAPED.items():
            text = text.replace(character, written)
        problem = f"there is no such file, as {pair} in double quotes is one character"
        return InputError(problem, source=text, expected=QUOTES)
    if path.is_dir():
        return InputError("is a folder", source=path, expected=expected)
    if error is None or isinstance(error, FileNotFoundError):
        problem = length_problem(path) or "there is no such file"
    else:
        problem = f"cannot be read ({failure_reason(error)})"
    return InputError(problem, source=path, expected=expected)


def read_text(path: str | os.PathLike[str], expected: str) -> str:
    """Return the content of a UTF-8 text file, with or without a byte order mark.

    expected : what the file was to be

    Raises
    ------
    InputError : it cannot be read, or is not text.
    """
    try:
        return Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"byte {error.start} is not text", source=path, expected="a UTF-8 text file"
        ) from None
    except OSError as error:
        raise unreadable_error(path, expected, error) from None
