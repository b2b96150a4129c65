"""The model file: one flexible body, from its geometry to the reduction.

SI units, angles in radians. See ``examples/slider_crank/rod_q4.toml``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .errors import InputError
from .model_base import Count, Fraction, NonNegative, Part, Positive
from .model_checks import check_grid, check_knots, check_name, check_node_numbers
from .model_reduction import (
    BuckensFrame,
    ChordFrame,
    FrameSettings,
    ModalReduction,
    ReductionSettings,
    Stiffening,
    StressRecovery,
    TangentFrame,
    Tie,
    check_reduction,
)
from .toml_files import load

__all__ = [
    "BuckensFrame",
    "ChordFrame",
    "IgaDiscretisation",
    "Marker",
    "Material",
    "ModalReduction",
    "ModelFile",
    "NurbsGeometry",
    "Q4Discretisation",
    "RayleighDamping",
    "Stiffening",
    "StressRecovery",
    "TangentFrame",
    "Tie",
    "read_model",
]

Point2 = tuple[float, float]

#: The four sides of a patch with parameters (u, v) in [0, 1]: direction, end.
SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}


class Material(Part):
    """Linear elastic and isotropic."""

    youngs_modulus: Positive = Field(description="Young's modulus in Pa")
    poissons_ratio: float = Field(gt=-1, lt=0.5, description="a number below 0.5")
    density: Positive = Field(description="the density in kg/m^3")


class NurbsGeometry(Part):
    """A plane NURBS patch of constant thickness.

    The patch maps (u, v) to (x, y). Its sides are called left (u = 0), right (u = 1),
    bottom (v = 0) and top (v = 1), whatever the range of the knots; `edges` gives them
    further names.

    Attributes
    ----------
    degrees : of the two parametric directions
    knots : per direction; open, i.e. the end knots appear degree + 1 times
    control_points : [i][j] -> [x, y] in m; i runs along u, j along v
    weights : [i][j], all 1 by default
    thickness : [m]
    edges : further name -> side
    """

    type: Literal["nurbs"]
    degrees: tuple[Count, Count]
    knots: tuple[tuple[float, ...], tuple[float, ...]]
    control_points: tuple[tuple[Point2, ...], ...] = Field(min_length=2)
    weights: tuple[tuple[Positive, ...], ...] | None = None
    thickness: Positive = Field(description="the thickness in m")
    edges: dict[str, Literal["left", "right", "bottom", "top"]] = {}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        columns = len(self.control_points[0])
        check_grid(self.control_points, columns, "geometry.control_points")
        if self.weights is not None:
            rows = len(self.control_points)
            if len(self.weights) != rows:
                raise InputError(
                    f"has {len(self.weights)} rows",
                    place="geometry.weights",
                    expected=f"{rows} rows, as control_points has",
                )
            check_grid(self.weights, columns, "geometry.weights")
        counts = (len(self.control_points), columns)
        for i in range(2):
            place = f"geometry.knots[{i}]"
            check_knots(self.knots[i], self.degrees[i], counts[i], place)
        return self

    @model_validator(mode="after")
    def _sides_keep_their_names(self) -> Self:
        for name in self.edges:
            if name in SIDES:
                raise InputError(
                    "is the name of a side already",
                    place=f"geometry.edges.{name}",
                    expected=f"a name other than {', '.join(SIDES)}",
                )
        return self

    @property
    def edge_names(self) -> dict[str, tuple[int, int]]:
        """Every name of a side as (parametric direction, end)."""
        return SIDES | {name: SIDES[side] for name, side in self.edges.items()}


class Q4Discretisation(Part):
    """Bilinear quadrilaterals that sample the geometry at equal parameter steps.

    `full_integration` uses 2 x 2 Gauss points; `incompatible_modes` adds the four
    internal modes of QM6 (Taylor, Beresford & Wilson 1976), which remove the shear
    locking in bending.
    """

    type: Literal["q4"]
    elements: tuple[Count, Count]
    state: Literal["plane_stress", "plane_strain"] = "plane_stress"
    formulation: Literal["full_integration", "incompatible_modes"] = "full_integration"


class IgaDiscretisation(Part):
    """The patch itself as the basis, refined without changing the geometry.

    Exactly one of these says how far it is refined; `degrees` are those of the
    refined patch:

    functions : basis functions per direction, on open uniform knots
    elements : equal knot spans per direction
    knots : the knot vectors themselves
    """

    type: Literal["iga"]
    degrees: tuple[Count, Count]
    functions: tuple[Count, Count] | None = None
    elements: tuple[Count, Count] | None = None
    knots: tuple[tuple[float, ...], tuple[float, ...]] | None = None
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
        return self


class Marker(Part):
    """A named point that joints and forces can use.

    Exactly one of `edge` (with `at`, the fraction of its parameter range),
    `parameters` (u, v in [0, 1]) and `position` (x, y in m) says where it is; a tied
    marker may leave it to the centre of what it is tied to.
    """

    node: int = Field(ge=1, le=99999, description="its node number in the SID")
    edge: str | None = None
    at: Fraction | None = None
    parameters: tuple[Fraction, Fraction] | None = None
    position: Point2 | None = None
    tie: Tie | None = None


class RayleighDamping(Part):
    """De = alpha Me + beta Ke."""

    type: Literal["rayleigh"]
    alpha: NonNegative = Field(0.0, description="in 1/s")
    beta: NonNegative = Field(0.0, description="in s")


Discretisation = Annotated[
    Q4Discretisation | IgaDiscretisation, Field(discriminator="type")
]


class ModelFile(Part):
    """A model file: geometry, material, discretisation, frame, markers, reduction."""

    format: Literal["sidtool model"]
    version: Literal[1]
    title: str = ""
    material: Material
    geometry: NurbsGeometry
    discretisation: Discretisation
    frame: FrameSettings
    markers: dict[str, Marker] = Field(min_length=1)
    reduction: ReductionSettings
    damping: RayleighDamping | None = None
    stiffening: Stiffening | None = None
    stress: StressRecovery | None = None

    @model_validator(mode="after")
    def _references(self) -> Self:
        edges = self.geometry.edge_names
        for name in self.frame.clamped_edges:
            check_name(name, edges, "edge", "frame.clamp")
        for name in self.frame.marker_names:
            check_name(name, self.markers, "marker", "frame.marker")
        check_reduction(self.reduction, self.markers, edges)
        for name in self.stiffening.marker_names if self.stiffening else ():
            check_name(name, self.markers, "marker", "stiffening")
        for name in (self.stress and self.stress.markers) or ():
            check_name(name, self.markers, "marker", "stress.markers")
        for name, marker in self.markers.items():
            place = f"markers.{name}"
            _check_place(marker, place)
            if marker.edge is not None:
                check_name(marker.edge, edges, "edge", f"{place}.edge")
            for tied in marker.tie.names if marker.tie else ():
                check_name(tied, edges, "edge", f"{place}.tie.to")
        check_node_numbers({name: m.node for name, m in self.markers.items()})
        return self


def read_model(path: str | Path) -> ModelFile:
    """Read a model file (TOML, or JSON by its ending).

    Raises
    ------
    InputError : names the file, the key, what was found and what was expected.
    """
    return load(path, ModelFile)


def _check_place(marker: Marker, place: str) -> None:
    ways = ("edge", "parameters", "position")
    given = [way for way in ways if getattr(marker, way) is not None]
    if len(given) != 1 and (given or marker.tie is None):
        raise InputError(
            f"gives {' and '.join(given) or 'no place'}",
            place=place,
            expected="exactly one of edge (with at), parameters, position",
        )
    if (marker.edge is None) != (marker.at is None):
        raise InputError(
            "edge and at do not come together",
            place=place,
            expected='for example edge = "left", at = 0.5',
        )
