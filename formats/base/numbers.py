"""Decimal numbers in the text of files and on the command line.

`int` and `float` convert more than files mean: `1_0` to 10, digits of other scripts,
`nan` and `infinity`. Here all of these are no numbers.
"""

from math import isfinite

#: Digits of numbers that fit into 64 bits.
_MAX_DIGITS = 18


def is_plain(text: str) -> bool:
    """Whether `int` and `float` convert words of a text, or none of them, as decimal
    numbers; `nan` and `inf` are left to a check for finite values.
    """
    return text.isascii() and "_" not in text


def real_of_text(text: str) -> float:
    """The finite number of a text such as 1, -1.5, .5 or 1e-3.

    Raises
    ------
    ValueError : it is none.
    """
    value = float(text)
    if not (is_plain(text) and isfinite(value)):
        raise ValueError(f"{text!r} is no finite decimal number")
    return value


def integer_of_text(text: str) -> int:
    """The integer of a text such as 12 or -3.

    Raises
    ------
    ValueError : it is none.
    """
    if not is_plain(text):
        raise ValueError(f"{text!r} is no integer")
    return int(text)


def is_label(text: str) -> bool:
    """Whether a text is the number of a node or an element: digits, at most 18."""
    return text.isascii() and text.isdecimal() and len(text) <= _MAX_DIGITS
