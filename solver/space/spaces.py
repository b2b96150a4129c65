"""Plane and space, as kernels see them: records with vectors, and what is by space."""

from __future__ import annotations

from typing import Any

from numba import float64, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, typeof_impl

from ..compiler.inner import Inner, InnerType
from ..compiler.records import RecordType, RowsType
from ..compiler.values import Symmetric, Turn, ValueType, Vector
from .layout import TOLD, WORK

PLANE, SPACE = "plane", "space"


def _rows(name: str, **fields: Any) -> RowsType:
    return RowsType(RecordType(name, **fields))


ROW = _rows("Row", value=float64, rate=float64, gamma=float64)
_V2, _V1, _V3 = ValueType(Vector, 2), ValueType(Vector, 1), ValueType(Vector, 3)
_COSINE_SINE, _MATRIX = ValueType(Turn, 2), ValueType(Turn, 9)
#: Rotation from one marker to another, and the inertial torque that works on it.
TURNED = _rows("Turned", value=float64, rate=float64, axis=_V3)
#: State of body frames: position, orientation, velocity, angular velocity and the
#: accelerations at zero z_II', resolved in the frame; and of markers: position,
#: velocity, acceleration, orientation, angular velocity and acceleration, inertial;
#: body-resolved position and relative velocity.
FRAMES = {
    PLANE: _rows(
        "Planar frame",
        x=_V2, R=_COSINE_SINE, angle=float64, v=_V2, w=_V1, a=_V2, al=_V1,
    ),
    SPACE: _rows(
        "Spatial frame",
        x=_V3, R=_MATRIX, v=_V3, w=_V3, a=_V3, al=_V3, p=ValueType(Vector, 4),
    ),
}  # fmt: skip
_KINDS = {
    PLANE: {"move": _V2, "turn": _V1, "pair": ValueType(Symmetric, 1)},
    SPACE: {"move": _V3, "turn": _V3, "pair": ValueType(Symmetric, 6)},
}


def _by_space(name: str, **fields: str) -> dict[str, RowsType]:
    """Records behind each other, for both spaces, of kinds of fields."""
    return {
        space: RowsType(
            RecordType(
                f"{name} in {space}",
                **{
                    field: kinds.get(kind, float64)
                    for kind, listed in fields.items()
                    for field in listed.split()
                },
            ),
            1,
        )
        for space, kinds in _KINDS.items()
    }


#: Of an elastic coordinate: Ct, Cr and the derivative of J at q, Cr of the gyroscopic
#: term, Oe Omega and the row sum Ge q' w.
MODES = _by_space("Mode", move="ct", turn="cr turned", pair="j1", number="oe ge")
#: Of a stiffened body: mdCM; Ct^T q'; acceleration of the centre of mass relative to
#: the frame; what q adds to mdCM, the part of first order, and its rate; Ct^T q''; sum
#: over rates of `bend`. Tilt of the mean axes and its rate; their angular velocity and
#: its rate; momentum H u and its rate; u and its rate; H^-1 coupling q'; sum of tilt
#: times accelerations. H, its rate and its inverse, its terms of second order and
#: their rate.
TURNING = _by_space(
    "Turning",
    move="md flow sway mu m1 m1_rate pull bent",
    turn="theta theta_rate turn turn_rate momentum momentum_rate u u_rate lag "
    "lean_rate",
    pair="H H_rate H_inverse H_bow H_bow_rate",
)
#: Of its elastic coordinates: Ct, at q = 0, too, and sums of its derivatives times
#: rates and times accelerations. Row of the coupling and its rate, sums of its column
#: times rates and times accelerations; tilt, and what it does to the turn of the frame;
#: dH u, dH lag. Derivative of H and its rate, and the share of terms of second order.
STIFFENED = _by_space(
    "Stiffened",
    move="ct ct0 bend trail",
    turn="row row_rate column follow tilt lean heave drag",
    pair="growth growth_rate bow bow_rate",
)
POINTS = {
    PLANE: _rows(
        "Planar point",
        x=_V2, v=_V2, a=_V2, angle=float64, w=_V1, al=_V1, d=_V2, u=_V2,
    ),
    SPACE: _rows(
        "Spatial point",
        x=_V3, v=_V3, a=_V3, d=_V3, u=_V3, R=_MATRIX, w=_V3, al=_V3, T=_MATRIX,
    ),
}  # fmt: skip
WORKS = {
    space: WORK.seen(
        space,
        frame=FRAMES[space],
        point=POINTS[space],
        modal=MODES[space],
        stiffened=STIFFENED[space],
        turning=TURNING[space],
        row=ROW,
        turn=TURNED,
    )
    for space in (PLANE, SPACE)
}
#: Of a constraint or a force: inertial force on its marker B, whose reverse acts on A,
#: and torques on both.
WRENCH = _rows("Told wrench", force=_V3, torque_a=_V3, torque_b=_V3)
#: Of a force: what it acts on and its rate; its size along that, energy that it stores,
#: powers that it loses and is given.
MEASURED = _rows(
    "Told force",
    **dict.fromkeys(["measure", "rate", "size", "stored", "lost", "given"], float64),
)
#: Of a body: energy of motion, of deformation and of gravity, power that its damping
#: takes; inertial momentum, and that about the inertial origin.
MOVED = _rows(
    "Told body",
    **dict.fromkeys(["kinetic", "elastic", "weight", "lost"], float64),
    momentum=_V3,
    angular=_V3,
)
TOLDS = {
    space: TOLD.seen(space, wrench=WRENCH, force=MEASURED, body=MOVED)
    for space in (PLANE, SPACE)
}


def in_plane(table: Any) -> Any:
    """A work as the equations of the plane see it."""
    raise TypeError("for kernels only")


def in_space(table: Any) -> Any:
    """A work as the equations of space see it."""
    raise TypeError("for kernels only")


for _function, _space in ((in_plane, PLANE), (in_space, SPACE)):

    class _Seen(AbstractTemplate):
        key = _function
        kinds = {WORK: WORKS[_space], TOLD: TOLDS[_space]}

        def generic(self, args: Any, kws: Any) -> Any:
            return signature(self.kinds[args[0]], *args)

    infer_global(_function)(_Seen)

    @lower_builtin(_function, types.Any)
    def _same(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return args[0]


class BySpace:
    """Two kernels, for plane and space; a call of it is one of that for its `work`."""

    def __init__(self, plane: Inner, space: Inner) -> None:
        self.kernels = {PLANE: plane, SPACE: space}
        self.py_funcs = plane.py_func, space.py_func

    def chosen(self, args: Any) -> Inner:
        """The kernel that is called with arguments of these types."""
        space = next(s for s, kind in WORKS.items() if kind in args)
        return self.kernels[space]


@typeof_impl.register(BySpace)
def _type_of(value: BySpace, context: Any) -> InnerType:
    return InnerType(value)
