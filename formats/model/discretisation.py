"""Discretisations of a model file: from a geometry to degrees of freedom."""

from typing import Annotated, Literal, Self

from pydantic import model_validator

from ..base.errors import InputError
from ..toml.tables import Field, Table
from .tables import Count

Formulation = Literal["full_integration", "incompatible_modes"]
Counts = tuple[Count, Count] | tuple[Count, Count, Count]

#: Which discretisations a geometry has.
FITTING: dict[str, tuple[str, ...]] = {
    "nurbs": ("q4", "iga"),
    "nurbs_volume": ("iga", "hex8", "hex20", "tet4", "tet10"),
    "patches": ("iga",),
    "beam": ("beam",),
    "frame": ("beam",),
    "mesh": ("mesh",),
    "matrices": ("matrices",),
}


class Q4Discretisation(Table):
    """Bilinear quadrilaterals that sample the geometry at equal parameter steps.

    `incompatible_modes` adds four internal modes (Taylor, Beresford & Wilson 1976;
    Wilson & Ibrahimbegovic 1990) to 2 x 2 Gauss points, which remove the shear locking
    in bending; `full_integration` does without them.

    Attributes
    ----------
    elements : along u and v
    state : of a plane body
    formulation : of the elements
    """

    type: Literal["q4"] = "q4"
    elements: tuple[Count, Count]
    state: Literal["plane_stress", "plane_strain"] = "plane_stress"
    formulation: Formulation = "incompatible_modes"


class IgaDiscretisation(Table):
    """The patches themselves as the basis, refined without changing the geometry.

    Exactly one of `functions`, `elements` and `knots` sets the refinement of each.
    With the first two, the degree is raised, which keeps the continuity at each inner
    knot of the geometry, and each knot span is divided equally (k-refinement).

    Attributes
    ----------
    degrees : of the refined patch, two of a plane patch and three of a volume
    functions : basis functions per direction; where the geometry has inner knots, at
        least as many
    elements : knot spans per direction, none longer than 1 / elements of the whole
        range; more than requested where the geometry has inner knots that do not fit
    knots : the knot vectors themselves, with the inner knots of the geometry
    state : of a plane body
    """

    type: Literal["iga"] = "iga"
    degrees: Counts
    functions: Counts | None = None
    elements: Counts | None = None
    knots: tuple[tuple[float, ...], ...] | None = None
    state: Literal["plane_stress", "plane_strain"] = "plane_stress"

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        targets = ("functions", "elements", "knots")
        given = [name for name in targets if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f"gives {' and '.join(given) or 'none of ' + ', '.join(targets)}",
                place="discretisation",
                expected="exactly one of functions, elements, knots",
            )
        count = len(getattr(self, given[0]))
        if count != len(self.degrees):
            raise InputError(
                f"has {count} directions, degrees has {len(self.degrees)}",
                place=f"discretisation.{given[0]}",
                expected="as many entries as degrees",
            )
        return self


class SolidDiscretisation(Table):
    """Solid elements that sample a volume at equal parameter steps.

    Attributes
    ----------
    elements : boxes along u, v and w; tetrahedra are six to a box
    formulation : of hex8, which alone has incompatible modes
    """

    type: Literal["hex8", "hex20", "tet4", "tet10"]
    elements: tuple[Count, Count, Count]
    formulation: Formulation = "incompatible_modes"


class BeamDiscretisation(Table):
    """Two-node beam elements whose shapes are the static solution of the beam between
    them, curved, twisted and tapered as it is.

    Attributes
    ----------
    elements : along the beam, of equal length between places at which elements end:
        stations of its section or twist, markers, lumped masses and section forces. Of
        a frame: along each member
    theory : without or with deformation by shear; by default with it where sections
        state their shear stiffness (GA_y and GA_z, matrices, shear_y and shear_z)
    mass : consistent (that of the displacement field and the turning cross-sections) or
        lumped (half of an element as a rigid piece that each of its nodes carries, with
        its own centre and inertia)
    """

    type: Literal["beam"] = "beam"
    elements: Annotated[int, Field(ge=1, le=100_000)]
    theory: Literal["euler_bernoulli", "timoshenko"] | None = None
    mass: Literal["consistent", "lumped"] = "consistent"


class MeshDiscretisation(Table):
    """The elements of a mesh as they are."""

    type: Literal["mesh"] = "mesh"
    state: Literal["plane_stress", "plane_strain"] | None = Field(
        default=None, description="of plane elements that do not say it themselves"
    )
    formulation: Formulation | None = Field(
        default=None,
        description="of hex8 and quad4, instead of what the file says; by default "
        "incompatible modes where the file does not say it",
    )


class MatricesDiscretisation(Table):
    """The matrices of a file as they are."""

    type: Literal["matrices"] = "matrices"


Discretisation = Annotated[
    Q4Discretisation
    | IgaDiscretisation
    | SolidDiscretisation
    | BeamDiscretisation
    | MeshDiscretisation
    | MatricesDiscretisation,
    Field(discriminator="type"),
]
