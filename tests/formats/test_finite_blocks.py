"""A body whose blocks are not finite is not written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.plausibility import check_body
from tests.steel_bars import steel_bar


def test_blocks_that_are_no_numbers_are_refused() -> None:
    sid = steel_bar()
    check_body(sid)
    broken = replace(sid, Ke=replace(sid.Ke, m0=np.full_like(sid.Ke.m0, np.nan)))
    with pytest.raises(InputError, match="Ke"):
        check_body(broken)
