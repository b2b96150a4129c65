"""The frontends by the `discretisation.type` of a model file."""

from __future__ import annotations

from collections.abc import Callable

from formats.model import ModelFile

from .finite_element_model import FiniteElementModel
from .iga import iga_model
from .q4 import q4_model

Frontend = Callable[[ModelFile], FiniteElementModel]

#: One line adds a frontend.
FRONTENDS: dict[str, Frontend] = {"q4": q4_model, "iga": iga_model}


def finite_element_model(model: ModelFile) -> FiniteElementModel:
    """The discretised body of a model file.

    Raises
    ------
    InputError : names the key that is wrong.
    """
    return FRONTENDS[model.discretisation.type](model)
