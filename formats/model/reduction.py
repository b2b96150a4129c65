"""Tables of a model file that define shape functions and the body frame."""

from collections.abc import Collection, Iterable, Mapping
from typing import Annotated, Literal

from numpy.typing import ArrayLike

from ..base.stress import FIRST_PEAK_NODE
from ..toml.tables import (
    Field,
    Integer,
    OptionalInteger,
    OptionalTexts,
    Table,
    Takes,
    Texts,
    TwoTexts,
)
from .tables import Count, Names, NonNegative, as_tuple, check_name

Modes = Annotated[int, Field(ge=0, description="the number of modes, 0 or more")]

Vector = tuple[float, ...]


class TangentFrame(Table):
    """A frame that moves and turns with a marker; its axes are the global ones.

    Attributes
    ----------
    marker : where the frame sits
    clamp : edges or node sets that rest in the frame, the marker among them. Without
        them the marker's own displacement and rotation define the frame.
    """

    type: Literal["tangent"] = "tangent"
    marker: str
    clamp: Names = ()

    @property
    def clamped_edges(self) -> tuple[str, ...]:
        """The names of the edges that do not deform in this frame."""
        return as_tuple(self.clamp)

    @property
    def marker_names(self) -> tuple[str, ...]:
        """The markers that define the frame."""
        return (self.marker,)


class ChordFrame(Table):
    """A frame on the first marker whose direction to the second one stays fixed.

    In space it does not turn about that direction relative to the first marker.

    Attributes
    ----------
    markers : where the frame sits, and where its direction points to
    """

    type: Literal["chord"] = "chord"
    markers: TwoTexts

    @property
    def clamped_edges(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def marker_names(self) -> tuple[str, ...]:
        """The markers that define the frame."""
        return self.markers


class BuckensFrame(Table):
    """Mean axes (Buckens, Tisserand): deforming carries no momentum relative to them.

    Attributes
    ----------
    marker : the frame's origin is where this marker is in the undeformed body; the
        centre of mass by default
    """

    type: Literal["buckens"] = "buckens"
    marker: str | None = None

    @property
    def clamped_edges(self) -> tuple[str, ...]:
        """None."""
        return ()

    @property
    def marker_names(self) -> tuple[str, ...]:
        """The markers that define the frame."""
        return () if self.marker is None else (self.marker,)


FrameSettings = Annotated[
    TangentFrame | ChordFrame | BuckensFrame, Field(discriminator="type")
]


class ReductionPart(Table):
    """What all reduction methods have in common.

    Attributes
    ----------
    fix : edges, node sets or markers that do not move while shape functions are
        computed, besides those that the frame clamps
    """

    fix: Names = ()

    @property
    def fixed_names(self) -> tuple[str, ...]:
        """The names in `fix`."""
        return as_tuple(self.fix)

    @property
    def interface_names(self) -> tuple[str, ...]:
        """The markers that the method loads or moves."""
        return ()


class ModalReduction(ReductionPart):
    """The lowest modes of the body as its frame (and `fix`) hold it, or free."""

    method: Literal["modal"] = "modal"
    modes: Count = Field(description="the number of modes to keep")


class InterfaceReduction(ReductionPart):
    """A method with static shape functions for markers.

    Attributes
    ----------
    interfaces : the markers that joints and forces will use
    modes : normal modes in addition
    rotations : whether the rotations of the markers are interface coordinates too
    """

    interfaces: Texts = Field(min_length=1)
    modes: Modes = 0
    rotations: bool = True

    @property
    def interface_names(self) -> tuple[str, ...]:
        """The markers that the method loads or moves."""
        return self.interfaces


class CraigBamptonReduction(InterfaceReduction):
    """Constraint modes of the interfaces and modes with fixed interfaces."""

    method: Literal["craig_bampton"] = "craig_bampton"


class AttachmentReduction(InterfaceReduction):
    """Static answers to unit loads at markers, inertia-relief and normal modes.

    Attributes
    ----------
    inertia_relief : whether to add the static answers to uniform accelerations, which
        only a body that is held somewhere has
    centrifugal : whether to add the static answers to the centrifugal loads of its own
        rotation, which stretch it
    """

    method: Literal["attachment"] = "attachment"
    inertia_relief: bool = True
    centrifugal: bool = False


class HertingReduction(InterfaceReduction):
    """Constraint modes, inertia-relief modes and modes with free interfaces."""

    method: Literal["herting"] = "herting"


class KrylovReduction(ReductionPart):
    """Answers to loads at markers around given frequencies, and their derivatives.

    Attributes
    ----------
    interfaces : the markers whose transfer functions are matched
    frequencies : expansion points [Hz]
    moments : vectors per load and expansion point
    rotations : whether moments at the markers are loads too
    """

    method: Literal["krylov"] = "krylov"
    interfaces: Texts = Field(min_length=1)
    frequencies: tuple[NonNegative, ...] = Field(min_length=1)
    moments: Count = 1
    rotations: bool = True

    @property
    def interface_names(self) -> tuple[str, ...]:
        """The markers that the method loads or moves."""
        return self.interfaces


class UserReduction(ReductionPart):
    """Shape functions from a file, one per column, one row per degree of freedom.

    Attributes
    ----------
    file : .npy, .npz, .mtx, .h5 or .hdf5; relative to the model file
    name : of the array in an .npz or HDF5 file with several
    """

    method: Literal["user"] = "user"
    file: str
    name: str | None = None


ReductionSettings = Annotated[
    ModalReduction
    | CraigBamptonReduction
    | AttachmentReduction
    | HertingReduction
    | KrylovReduction
    | UserReduction,
    Field(discriminator="method"),
]


class Tie(Table):
    """A marker that follows many nodes instead of the material at one point.

    The nodes weigh by the area (in the plane, and of nodes along a line, the length)
    that they hold: a force spreads as a uniform traction. Nodes that span no face and
    no edge of an element weigh alike.

    Attributes
    ----------
    type : "rigid" makes the nodes one rigid piece (RBE2); "distributing" takes their
        mean motion and spreads loads over them (RBE3)
    to : edges or node sets
    """

    type: Literal["rigid", "distributing"]
    to: str | Annotated[tuple[str, ...], Field(min_length=1)]

    @property
    def names(self) -> tuple[str, ...]:
        """The names in `to`."""
        return as_tuple(self.to)


class Prestress(Table):
    """A stress state of the undeformed body.

    The body rests undeformed when a scene applies the loads of its prestress: forces
    and moments as given here, what holds them, and what holds a uniform stress. They
    stiffen it as all loads at its markers do (phi m1, psi m1). Ke holds the rest: the
    stiffness of the stress that the unloaded body keeps, and of loads at markers that
    do not stiffen.

    Attributes
    ----------
    stress : uniform stress (xx, yy, xy), in space (xx, yy, zz, xy, yz, xz) [Pa]
    forces : marker -> constant force, which a scene applies as well [N]
    moments : marker -> constant moment: about z, in space about x, y, z [N m]
    support : the marker that a joint holds while these loads act, whose reactions
        belong to the prestress; in a tangent frame what defines the frame by default.
        In other frames loads that are in balance by themselves need none.
    """

    stress: Takes[Vector | None, ArrayLike | None] = Field(default=None)
    forces: Mapping[str, Vector] = {}
    moments: Mapping[str, Vector] = {}
    support: str | None = None

    @property
    def marker_names(self) -> tuple[str, ...]:
        """The loaded markers, and the one that holds them."""
        clamped = () if self.support is None else (self.support,)
        return (*self.forces, *self.moments, *clamped)


class Stiffening(Table):
    """Geometric stiffening: which loads change the stiffness of the body.

    Attributes
    ----------
    acceleration : of the frame, and gravity (Ct m1)
    angular_acceleration : of the frame (Cr m1)
    centrifugal : rotation of the frame (Oe m1)
    markers : at which forces and moments stiffen (phi m1, psi m1); all by default
    prestress : stress of the undeformed body (ksigma, Ke)
    """

    acceleration: bool = True
    angular_acceleration: bool = True
    centrifugal: bool = True
    markers: OptionalTexts = Field(default=None)
    prestress: Prestress | None = None

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Every marker that is named here."""
        loaded = () if self.prestress is None else self.prestress.marker_names
        return (*(self.markers or ()), *loaded)


class StressRecovery(Table):
    """Where a simulation can evaluate the stress.

    Attributes
    ----------
    markers : that carry sigma rows; all by default
    peak_points : further nodes where the stress can be largest, on the surface and
        inside, for the peak over the body; by default as many as find 99 % of it in
        all states that are tried. With 0 the peak is that of the markers
    first_node : number of the first of them
    """

    markers: OptionalTexts = Field(default=None)
    peak_points: OptionalInteger = Field(default=None, ge=0)
    first_node: Integer = Field(default=FIRST_PEAK_NODE, ge=1, le=99999)


def check_reduction(
    reduction: ReductionPart, markers: Iterable[str], sets: Collection[str]
) -> None:
    """Whether a reduction names markers and sets that there are.

    Raises
    ------
    InputError : it does not.
    """
    known = tuple(markers)
    for name in reduction.interface_names:
        check_name(name, known, "marker", "reduction.interfaces")
    for name in reduction.fixed_names:
        if name not in sets:
            check_name(
                name, (*sets, *known), "edge, node set or marker", "reduction.fix"
            )
