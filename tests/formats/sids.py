"""Comparing SIDs, for the tests of the files that hold them."""

from __future__ import annotations

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.storage.hdf5_files import named_expansions


def assert_same(found: SID, wanted: SID, digits: float) -> None:
    """Equal texts and structure; numbers equal to `digits` of the largest of a term."""
    assert found.title == wanted.title
    assert found.labels == wanted.labels
    assert found.mass == approximately(wanted.mass, digits)
    assert list(found.extra) == list(wanted.extra)
    assert [node.id for node in found.nodes] == [node.id for node in wanted.nodes]
    assert [node.rframe for node in found.nodes] == [n.rframe for n in wanted.nodes]
    pairs = zip(named_expansions(found), named_expansions(wanted), strict=True)
    for (place, one), (other_place, other) in pairs:
        assert place == other_place
        assert one.order == other.order, place
        for part in ("m0", "m1", "mn"):
            a, b = getattr(one, part), getattr(other, part)
            assert_close(a, b, digits, f"{place}, {part}")


def assert_close(a: Array | None, b: Array | None, digits: float, place: str) -> None:
    """Equal to `digits` of the largest number; a missing term equals zeros."""
    if a is None or b is None:
        rest = a if b is None else b
        assert rest is None or not rest.any(), place
        return
    assert a.shape == b.shape, place
    if digits == 0.0:
        assert a.tobytes() == b.tobytes(), place
    else:
        bound = digits * np.abs(b).max(initial=0.0)
        assert np.abs(a - b).max(initial=0.0) <= bound, place


def approximately(value: float, digits: float) -> object:
    """A number that compares equal within a relative deviation."""
    return pytest.approx(value, rel=digits, abs=0.0)
