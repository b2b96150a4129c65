"""Discretisations by the `geometry.type` and `discretisation.type` of a model file."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile

from ..beams.beam_model import beam_model
from ..elements.finite_element_model import FiniteElementModel
from ..elements.markers import markers_as_nodes
from ..isogeometric.multipatch_iga import iga_model, patches_model
from ..isogeometric.sampled_patch import q4_model, sampled_volume_model
from .body_cuts import add_cuts
from .frame_body import frame_model
from .marker_couplings import add_couplings, add_rigid_couplings
from .matrices_body import imported_matrices_model
from .mesh_body import imported_mesh_model

Discretiser = Callable[[ModelFile], FiniteElementModel]

#: Discretisations by geometry and discretisation type; one line adds one.
DISCRETISERS: dict[tuple[str, str], Discretiser] = {
    ("nurbs", "q4"): q4_model,
    ("nurbs", "iga"): iga_model,
    ("nurbs_volume", "iga"): iga_model,
    ("nurbs_volume", "hex8"): sampled_volume_model,
    ("nurbs_volume", "hex20"): sampled_volume_model,
    ("nurbs_volume", "tet4"): sampled_volume_model,
    ("nurbs_volume", "tet10"): sampled_volume_model,
    ("patches", "iga"): patches_model,
    ("beam", "beam"): beam_model,
    ("frame", "beam"): frame_model,
    ("mesh", "mesh"): imported_mesh_model,
    ("matrices", "matrices"): imported_matrices_model,
}


def finite_element_model(model: ModelFile) -> FiniteElementModel:
    """The discretised body of a model file.

    Raises
    ------
    InputError : the model is not valid; the error names the key.
    """
    with refuse_extreme_numbers():
        body = DISCRETISERS[model.geometry.type, model.discretisation.type](model)
        tied = add_rigid_couplings(add_couplings(body), model)
        return add_cuts(markers_as_nodes(tied, model), model)


@contextmanager
def refuse_extreme_numbers() -> Iterator[None]:
    """Refuse a model whose matrices cannot be computed because of rounding."""
    try:
        yield
    except (np.linalg.LinAlgError, OverflowError) as error:
        raise _extreme_numbers(error) from None
    except (ValueError, RuntimeError) as error:  # of SciPy
        if not any(words in str(error) for words in ("infs or NaNs", "singular")):
            raise
        raise _extreme_numbers(error) from None


def _extreme_numbers(error: Exception) -> InputError:
    return InputError(
        f"a matrix of the body cannot be computed ({error}): numbers of the model "
        "are too large, too small or too far apart",
        expected="lengths, sections and materials in SI units",
    )
