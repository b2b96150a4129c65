"""Bodies with variables of their models, and the derivatives of their SIDs."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile

from ..model_derivatives.design_variables import design_variable
from ..model_derivatives.sid_derivatives import DifferentiableBody, SidDerivatives
from ..sensitivity.variables import Variable
from ..sweep.design import Designs


def varied_models(
    scene: SceneFile, variables: Sequence[Variable], sids: Mapping[str, Any]
) -> dict[str, ModelFile]:
    """Models of the bodies of which the models have variables.

    Raises
    ------
    InputError : a SID replaces that of such a body.
    """
    names = dict.fromkeys(e.body for v in variables for e in v.entries if e.body)
    for name in names:
        if name in sids:
            raise InputError(
                "replaces a body whose model is varied",
                place=f"sids[{name!r}]",
                expected="variables of other bodies",
            )
    designs = Designs(scene, {}, [])
    return {name: designs.model(name) for name in names}


class VariedBody:
    """A body whose model has variables.

    Attributes
    ----------
    sid : its SID
    """

    def __init__(self, model: ModelFile, keys: Sequence[str]) -> None:
        self._model, self._keys = model, keys
        self._body = DifferentiableBody(model)
        self.sid = self._body.sid

    @cached_property
    def _derivatives(self) -> SidDerivatives:
        variables = [design_variable(self._model, key) for key in self._keys]
        values = {one.name: one.value for one in variables}
        derivatives = {one.name: self._body.derivative(one) for one in variables}
        return SidDerivatives(self.sid, values, derivatives)

    def derivative(self, key: str) -> SID:
        """The derivative of the SID by a number of the model."""
        return self._derivatives[key]

    def neighbour(self, offsets: Mapping[str, float]) -> SID:
        """The SID changed along its derivatives by numbers of the model."""
        return self._derivatives.neighbour(offsets)
