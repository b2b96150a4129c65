"""The shapes a model file can describe: patches, volumes, beams, frames, meshes.

Every geometry knows the names of its edges or faces (`edge_names`); those of a file are
known only when it is read, so that every name is accepted here.

Cross-sections at which a simulation evaluates section forces.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from numpy.typing import ArrayLike
from pydantic import model_validator

from ..base.errors import InputError
from ..toml.tables import Entries, Field, OptionalTexts, Table, Takes, Texts
from .beams import BeamGeometry
from .frames import FrameGeometry
from .tables import (
    Count,
    Fraction,
    NonNegative,
    Point3,
    Positive,
    check_grid,
    check_knots,
)

Point2 = tuple[float, float]

Knots = tuple[float, ...]
#: The four sides of a patch with parameters (u, v) in [0, 1]: direction, end.
SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}
#: The six faces of a volume with parameters (u, v, w).
FACES = SIDES | {"back": (2, 0), "front": (2, 1)}


class PlaneCut(Table):
    """A plane through a solid body, and the part beyond it.

    Attributes
    ----------
    point : of the plane, [x, y] or [x, y, z] in m
    normal : of the plane, towards the part beyond; the x axis of the section
    y_axis : direction of the section's y axis in space, made perpendicular to the
        normal; by default y, or -x for a normal along y
    nearest : where the plane meets the body in several places, whether the section is
        the one nearest to the point, and the part beyond what is connected with it
    markers : names of the markers beyond; by default those that lie there
    """

    point: Takes[Point2 | Point3, ArrayLike]
    normal: Takes[Point2 | Point3, ArrayLike]
    y_axis: Takes[Point3 | None, ArrayLike | None] = Field(default=None)
    nearest: bool = False
    markers: OptionalTexts = Field(default=None)


class SectionForces(Table):
    """Cross-sections at which a simulation evaluates section forces.

    Attributes
    ----------
    stations : of beams: a number of equal steps' ends from start to end, called s1, s2,
        ..., or fractions of the length, called so too, or name = fraction
    members : of a frame, whose sections are called MEMBER.s1 and so on; by default all
    cuts : of solid bodies: planes by the names of their sections
    """

    stations: (
        Annotated[int, Field(ge=2, le=1000)]
        | Annotated[tuple[Fraction, ...], Field(min_length=1)]
        | Annotated[dict[str, Fraction], Field(min_length=1)]
        | None
    ) = None
    members: OptionalTexts = Field(default=None, min_length=1)
    cuts: Takes[dict[str, PlaneCut], Mapping[str, PlaneCut | Entries]] = Field(
        default_factory=dict
    )

    @property
    def fractions(self) -> dict[str, float]:
        """Name of every section of a beam -> fraction of the length."""
        if isinstance(self.stations, dict):
            return self.stations
        values = self.stations or ()
        if isinstance(values, int):
            values = tuple(k / (values - 1) for k in range(values))
        return {f"s{k}": value for k, value in enumerate(values, 1)}


class NamesOfFile(Mapping[str, Any]):
    """The names in a file that has not been read yet: any name may be among them."""

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str)

    def __getitem__(self, name: str) -> Any:
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


class NurbsGeometry(Table):
    """A plane NURBS patch of constant thickness.

    The patch maps (u, v) to (x, y). Its sides are called left (u = 0), right (u = 1),
    bottom (v = 0) and top (v = 1), whatever the range of the knots; `edges` gives them
    further names. Sides with the same control points are joined, so that a full ring
    may be one patch, and a side may shrink to a point, as the centre of a disk.

    Attributes
    ----------
    degrees : of the two parametric directions
    knots : per direction; open, i.e. the end knots appear degree + 1 times
    control_points : [i][j] -> [x, y] in m; i runs along u, j along v
    weights : [i][j], all 1 by default
    thickness : [m]
    edges : further name -> side
    """

    type: Literal["nurbs"] = "nurbs"
    degrees: tuple[Count, Count]
    knots: tuple[Knots, Knots]
    control_points: tuple[tuple[Point2, ...], ...] = Field(min_length=2)
    weights: tuple[tuple[Positive, ...], ...] | None = None
    thickness: Takes[Positive, float | str] = Field(description="the thickness in m")
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
    def _edge_names_are_distinct(self) -> Self:
        _check_new_names(self.edges, SIDES)
        return self

    @property
    def edge_names(self) -> dict[str, tuple[int, int]]:
        """Every name of a side as (parametric direction, end)."""
        return SIDES | {name: SIDES[side] for name, side in self.edges.items()}


class VolumeGeometry(Table):
    """A NURBS volume that maps (u, v, w) to (x, y, z).

    Its faces are called left (u = 0), right (u = 1), bottom (v = 0), top (v = 1),
    back (w = 0) and front (w = 1); `edges` gives them further names. Faces with the
    same control points are joined (tubes), and faces or edges may shrink to lines or
    points (the axis of a cylinder, the poles of a ball).

    Attributes
    ----------
    degrees, knots : of the three parametric directions; knots as of `NurbsGeometry`
    control_points : [i][j][k] -> [x, y, z] in m; i runs along u, j along v, k along w
    weights : [i][j][k], all 1 by default
    edges : further name -> face
    """

    type: Literal["nurbs_volume"] = "nurbs_volume"
    degrees: tuple[Count, Count, Count]
    knots: tuple[Knots, Knots, Knots]
    control_points: tuple[tuple[tuple[Point3, ...], ...], ...] = Field(min_length=2)
    weights: tuple[tuple[tuple[Positive, ...], ...], ...] | None = None
    edges: dict[str, Literal["left", "right", "bottom", "top", "back", "front"]] = {}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        points = self.control_points
        counts = (len(points), len(points[0]), len(points[0][0] if points[0] else ()))
        for name in ("control_points", "weights"):
            grid = getattr(self, name)
            if grid is not None:
                _check_box(grid, counts, f"geometry.{name}")
        for i in range(3):
            place = f"geometry.knots[{i}]"
            check_knots(self.knots[i], self.degrees[i], counts[i], place)
        _check_new_names(self.edges, FACES)
        return self

    @property
    def edge_names(self) -> dict[str, tuple[int, int]]:
        """Every name of a face as (parametric direction, end)."""
        return FACES | {name: FACES[face] for name, face in self.edges.items()}


class PatchesGeometry(Table):
    """Several NURBS patches of one file, joined along matching sides.

    Sides match if they have the same control points, weights, degrees and knots. A side
    that lies wholly on another, or on a part of it, is tied weakly (mortar method),
    which `convert` says, so that patches may have other knots and degrees. Sides that
    touch otherwise and patches that overlap are refused.

    The file is a patch file of ours, a geomdl JSON file or a G+Smo XML file; see
    `sidtool.importers`. The sides of patch NAME are called NAME.left and so
    on; `edges` gives names to one or several of them.

    Attributes
    ----------
    file : relative to the model file
    thickness : of plane patches [m]
    edges : name -> sides of patches, such as ["web.left", "flange.top"]
    tolerance : control points of two sides closer than this, relative to the size of
        the part, are the same; the gap is closed in its middle
    """

    type: Literal["patches"] = "patches"
    file: str
    thickness: Takes[Positive | None, float | str | None] = Field(default=None)
    edges: dict[str, tuple[str, ...]] = {}
    tolerance: Takes[Positive, float | str] = Field(default=1e-9)

    @property
    def edge_names(self) -> Mapping[str, Any]:
        """Those of the file, which is not read here."""
        return NamesOfFile()


class Morph(Table):
    """A change of the shape of a mesh: each node moves by `amount` times its direction.

    Attributes
    ----------
    file : the same elements with their nodes at other places, relative to the model
        file; the direction of a node is the displacement to its place there
    moves : node set -> its direction, a vector [m]; those of all other nodes satisfy
        Laplace's equation between the sets, with no flux through free surfaces
    amount : 0 is the shape of the mesh file, 1 that of `file`
    """

    file: str | None = None
    moves: Takes[dict[str, Point2 | Point3], Mapping[str, ArrayLike]] = Field(
        default_factory=dict
    )
    amount: float = 0.0

    @model_validator(mode="after")
    def _has_one_direction(self) -> Self:
        if (self.file is None) == (not self.moves):
            raise ValueError(
                "either `file`, the mesh with moved nodes, or `moves`, vectors by the "
                "names of node sets"
            )
        return self


class MeshGeometry(Table):
    """A mesh of another program: .inp, .msh, .bdf or .cdb, told by its ending.

    Attributes
    ----------
    file : relative to the model file
    unit : length of one unit of the mesh [m], or the name of a unit system such as
        mm-kg-ms. Materials of the file are in the same system, with newton and second
        if only a length is given: MPa and t/mm^3 with 0.001
    thickness : of plane elements, instead of that in the file [m]
    ignore : keywords, cards or commands of the file that are left out on purpose
    engine : "calculix": CalculiX (ccx, which must be installed) discretises an .inp
        with all elements that it knows (shells, beams, composites), or shells of a .bdf
    density : of materials of the file that have none [kg/m^3]; E and nu stay. 0 is for
        bars whose mass is in CONM2
    order : of the elements that CalculiX takes: 2 puts nodes in the middle of the edges
        of linear ones, 1 leaves them as they are; without it shells of a .bdf have 2
    part : of an .inp, the instance or the set of elements that is the body, of a .bdf
        the number of a property, of a .cdb a component of elements; without it
        everything, which ties have to join
    morphs : changes of the shape by name, which add up
    """

    type: Literal["mesh"] = "mesh"
    file: str
    unit: Positive | str = 1.0
    thickness: Takes[Positive | None, float | str | None] = Field(default=None)
    ignore: Texts = Field(default=())
    engine: Literal["calculix"] | None = None
    density: Takes[NonNegative | None, float | str | None] = Field(default=None)
    order: Literal[1, 2] | None = None
    part: str | None = None
    morphs: Takes[dict[str, Morph], Mapping[str, Morph | Entries]] = Field(
        default_factory=dict
    )

    @property
    def edge_names(self) -> Mapping[str, Any]:
        """Those of the file, which is not read here."""
        return NamesOfFile()


class MatricesGeometry(Table):
    """Mass and stiffness matrices of another program with a table of nodes.

    Attributes
    ----------
    stiffness, mass : CalculiX .sti/.mas, Abaqus .mtx, MatrixMarket .mtx
    nodes : the nodes: a mesh file, or a table of lines `number x y z`
    dofs : CalculiX .dof, which names the rows; not needed where rows name themselves
    file : instead of all these, an .npz or .h5 file with the arrays stiffness, mass,
        nodes and dofs, and `set.NAME` with the node numbers of a node set
    expected_mass : [kg], checked against the matrix
    """

    type: Literal["matrices"] = "matrices"
    stiffness: str | None = None
    mass: str | None = None
    nodes: str | None = None
    dofs: str | None = None
    file: str | None = None
    expected_mass: Takes[Positive | None, float | str | None] = Field(default=None)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        parts = (self.stiffness, self.mass, self.nodes)
        given = [part is not None for part in parts]
        if self.file is None and all(given):
            return self
        if self.file is not None and not any(given) and self.dofs is None:
            return self
        raise InputError(
            "the files do not make a set",
            place="geometry",
            expected="either file, or stiffness, mass and nodes",
        )

    @property
    def edge_names(self) -> Mapping[str, Any]:
        """Those of the file, which is not read here."""
        return NamesOfFile()


Geometry = Annotated[
    NurbsGeometry
    | VolumeGeometry
    | PatchesGeometry
    | BeamGeometry
    | FrameGeometry
    | MeshGeometry
    | MatricesGeometry,
    Field(discriminator="type"),
]


def _check_new_names(names: Iterable[str], taken: Mapping[str, object]) -> None:
    for name in names:
        if name in taken:
            raise InputError(
                "is the name of a side already",
                place=f"geometry.edges.{name}",
                expected=f"a name other than {', '.join(taken)}",
            )


def _check_box(
    grid: tuple[tuple[tuple[Any, ...], ...], ...],
    counts: tuple[int, int, int],
    place: str,
) -> None:
    if len(grid) != counts[0]:
        raise InputError(
            f"has {len(grid)} layers", place=place, expected=f"{counts[0]} layers"
        )
    check_grid(grid, counts[1], place)
    for i, layer in enumerate(grid):
        check_grid(layer, counts[2], f"{place}[{i}]")
