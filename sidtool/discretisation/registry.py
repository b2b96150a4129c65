"""Discretisations by the `geometry.type` and `discretisation.type` of a model file."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile

from ..elements.finite_element_model import FiniteElementModel
from ..elements.markers import markers_as_nodes
from .body_cuts import add_cuts
from .marker_couplings import add_couplings, add_rigid_couplings

_PATCHES = "sidtool.isogeometric.multipatch_iga"
_SAMPLED = "sidtool.isogeometric.sampled_patch"
#: Modules and functions by geometry and discretisation type; one line adds one. The
#: importers of meshes take as long to import as a small body takes to convert.
DISCRETISERS = {
    ("nurbs", "q4"): (_SAMPLED, "q4_model"),
    ("nurbs", "iga"): (_PATCHES, "iga_model"),
    ("nurbs_volume", "iga"): (_PATCHES, "iga_model"),
    ("nurbs_volume", "hex8"): (_SAMPLED, "sampled_volume_model"),
    ("nurbs_volume", "hex20"): (_SAMPLED, "sampled_volume_model"),
    ("nurbs_volume", "tet4"): (_SAMPLED, "sampled_volume_model"),
    ("nurbs_volume", "tet10"): (_SAMPLED, "sampled_volume_model"),
    ("patches", "iga"): (_PATCHES, "patches_model"),
    ("beam", "beam"): ("sidtool.beams.beam_model", "beam_model"),
    ("frame", "beam"): ("sidtool.discretisation.frame_body", "frame_model"),
    ("mesh", "mesh"): ("sidtool.discretisation.mesh_body", "imported_mesh_model"),
    ("matrices", "matrices"): (
        "sidtool.discretisation.matrices_body",
        "imported_matrices_model",
    ),
}


def finite_element_model(model: ModelFile) -> FiniteElementModel:
    """The discretised body of a model file.

    Raises
    ------
    InputError : the model is not valid; the error names the key.
    """
    module, name = DISCRETISERS[model.geometry.type, model.discretisation.type]
    discretise = getattr(import_module(module), name)
    with refuse_extreme_numbers():
        body = discretise(model)
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
