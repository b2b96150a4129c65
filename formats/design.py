"""Design files: what is to be the best, which numbers vary, and within which limits.

TOML or JSON::

    format = "sidtool design"
    version = 1
    scene = "slider_crank.toml"
    changes = { "rod.model" = "rod_q4.toml" }

    [variables.thickness]
    key = "rod.model.geometry.thickness"
    min = 0.005
    max = 0.02

    [objective]
    minimise = "mass(rod)"

    [[limits]]
    of = "max_abs(rod.q1)"
    max = 8e-4
"""

from __future__ import annotations

import os
from typing import Annotated, Any, ClassVar, Literal

from pydantic import model_validator

from .toml.files import File
from .toml.tables import Field, Integer, OptionalNumber, Table, Takes

#: Functional of a motion, see `sidtool sensitivity --help`.
_FUNCTIONAL = "a functional such as max_abs(rod.q1)"
Value = Annotated[float | int | bool | str | list[Any], Field()]


class VariableRange(Table):
    """A number that varies, or several that change together."""

    key: str | None = Field(
        default=None, description="key of the scene, or of a model: rod.model.KEY"
    )
    keys: Takes[dict[str, float] | None, Any] = Field(
        default=None,
        description="several keys with factors: the variable times its factor is "
        "added to each number",
    )
    start: OptionalNumber = Field(
        default=None, description="first value; default that of the scene, 0 with keys"
    )
    min: OptionalNumber = Field(default=None, description="least value")
    max: OptionalNumber = Field(default=None, description="largest value")

    @model_validator(mode="after")
    def _fits(self) -> VariableRange:
        if (self.key is None) == (self.keys is None):
            raise ValueError("one of key and keys")
        low, high = self.min, self.max
        if low is not None and high is not None and not low < high:
            raise ValueError("min below max")
        return self


class Objective(Table):
    """What is to be as small, or as large, as possible."""

    minimise: str | None = Field(default=None, description=_FUNCTIONAL)
    maximise: str | None = Field(default=None, description=_FUNCTIONAL)

    @model_validator(mode="after")
    def _fits(self) -> Objective:
        if (self.minimise is None) == (self.maximise is None):
            raise ValueError("one of minimise and maximise")
        return self

    @property
    def of(self) -> str:
        """The functional."""
        return self.minimise or self.maximise or ""


class Limit(Table):
    """What a functional may be at least or at most."""

    of: str = Field(description=_FUNCTIONAL)
    min: OptionalNumber = Field(default=None, description="least value")
    max: OptionalNumber = Field(default=None, description="largest value")

    @model_validator(mode="after")
    def _fits(self) -> Limit:
        if self.min is None and self.max is None:
            raise ValueError("min, max or both")
        return self


class Method(Table):
    """How the optimum is sought."""

    name: Literal["slsqp", "trust-constr"] = Field(
        default="slsqp", description="optimiser of SciPy"
    )
    tolerance: float = Field(
        default=1e-6,
        gt=0,
        description="change of the objective, relative to its start, at which it ends",
    )
    iterations: Integer = Field(default=50, ge=1, description="at most")


class DesignFile(File):
    """A design: variables of a scene with ranges, an objective and limits."""

    named: ClassVar[tuple[str, ...]] = ("variables",)
    paths: ClassVar[tuple[tuple[str, ...], ...]] = (("scene",),)

    format: Literal["sidtool design"] = Field(default="sidtool design")
    version: Literal[1] = Field(default=1)
    title: str = Field(default="", description="a text")
    scene: str = Field(description="scene file, relative to this file")
    changes: dict[str, Value] = Field(
        default_factory=dict, description="other values of the scene, by its keys"
    )
    variables: Takes[dict[str, VariableRange], Any] = Field(
        min_length=1, description="numbers that vary, by names of your own"
    )
    objective: Takes[Objective, Any] = Field(description="what is to be the best")
    limits: Takes[tuple[Limit, ...], Any] = Field(
        default=(), description="limits of other functionals"
    )
    method: Takes[Method, Any] = Field(
        default=Method(), description="how the optimum is sought"
    )


def read_design(path: str | os.PathLike[str]) -> DesignFile:
    """Read a design file (TOML, or JSON by its ending).

    Raises
    ------
    InputError : names the file, the key, what was found and what was expected.
    """
    return DesignFile.load(path)
