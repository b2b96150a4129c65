"""Drives: a joint's coordinate as a function of time."""

from __future__ import annotations

from pydantic import Field

from .base import Table
from .functions import Function


class Drive(Table):
    """Prescribes the coordinate of a revolute or prismatic joint."""

    joint: str = Field(description="name of a revolute or prismatic joint")
    function: Function
