"""The frontends by the `geometry.type` and `discretisation.type` of a model file."""

from __future__ import annotations

from collections.abc import Callable

from sidtool.formats.model import ModelFile

from ..conversion.coupled import coupled
from ..conversion.interfaces import tied
from .beams.model import beam_model
from .finite_element_model import FiniteElementModel
from .held_nodes import as_their_nodes
from .imported.matrices import imported_matrices_model
from .imported.mesh import imported_mesh_model
from .patches.joined import iga_model, patches_model
from .q4 import q4_model
from .sampled_volume import sampled_volume_model

Frontend = Callable[[ModelFile], FiniteElementModel]

#: One line adds a frontend.
FRONTENDS: dict[tuple[str, str], Frontend] = {
    ("nurbs", "q4"): q4_model,
    ("nurbs", "iga"): iga_model,
    ("nurbs_volume", "iga"): iga_model,
    ("nurbs_volume", "hex8"): sampled_volume_model,
    ("nurbs_volume", "hex20"): sampled_volume_model,
    ("nurbs_volume", "tet4"): sampled_volume_model,
    ("nurbs_volume", "tet10"): sampled_volume_model,
    ("patches", "iga"): patches_model,
    ("beam", "beam"): beam_model,
    ("mesh", "mesh"): imported_mesh_model,
    ("matrices", "matrices"): imported_matrices_model,
}


def finite_element_model(model: ModelFile) -> FiniteElementModel:
    """The discretised body of a model file.

    Raises
    ------
    InputError : names the key that is wrong.
    """
    body = FRONTENDS[model.geometry.type, model.discretisation.type](model)
    return as_their_nodes(tied(coupled(body), model), model)
