"""Numbers that callables of a program return."""

from typing import Any

import numpy as np


def real_number(value: Any) -> float:
    """The value as a float; texts and truth values, which `float` takes, are none.

    Raises
    ------
    TypeError, ValueError
        It is no real number, or an array of several.
    """
    if type(value) is float:
        return value
    kind = np.asarray(value).dtype.kind
    if kind not in "iufO" or isinstance(value, str | bytes):
        raise TypeError(f"{value!r} is no real number")
    return float(value)
