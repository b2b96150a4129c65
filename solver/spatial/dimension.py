"""Plane and space as kernels see them: records with vectors of each dimension."""

from collections.abc import Callable
from typing import Any

from ..compiler.inner_kernels import Inner, Intrinsic, KernelChoice
from ..compiler.records import RecordType, RowsType
from ..compiler.types import KernelType, float64
from ..compiler.vectors import Rotation, SymmetricMatrix, ValueType, Vector
from .system_arrays import OUTPUT_ARRAYS, WORK

PLANE, SPACE = "plane", "space"


def _rows(name: str, **fields: Any) -> RowsType:
    return RowsType(RecordType(name, **fields))


ROW = _rows("Row", value=float64, rate=float64, gamma=float64)
_V2, _V1, _V3 = ValueType(Vector, 2), ValueType(Vector, 1), ValueType(Vector, 3)
_COSINE_SINE, _MATRIX = ValueType(Rotation, 2), ValueType(Rotation, 9)
#: Rotation from one marker to another, and the inertial torque that works on it.
ROTATION_STATE = _rows("Turned", value=float64, rate=float64, axis=_V3)
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
    PLANE: {
        "translation": _V2,
        "rotation": _V1,
        "matrix": ValueType(SymmetricMatrix, 1),
    },
    SPACE: {
        "translation": _V3,
        "rotation": _V3,
        "matrix": ValueType(SymmetricMatrix, 6),
    },
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


#: Record of one elastic coordinate k, theory section 5: rows k of Ct and Cr at q (ct,
#: cr), derivative of J (j1), Cr in the gyroscopic term (cr_gyro), Oe Omega (oe) and the
#: row sum of Ge q' omega (ge).
MODES = _by_space(
    "Mode", translation="ct", rotation="cr cr_gyro", matrix="j1", number="oe ge"
)
#: Record of a stiffened body, theory section 12 (qdot and qddot stand for q', q''):
#: md, Ct_qdot       mdCM and Ct^T q', eq. (25)
#: a_centre          acceleration of the centre of mass relative to the frame
#: mu, mu1, mu1_dot  mdCM - mdCM0, its part of first order and the rate of that
#: Ct_qddot          Ct^T q''
#: Ct_dot_qdot       Ct'^T q'
#: theta, theta_dot, theta_ddot  rotation vector of the mean axes and its derivatives
#: omega_m, omega_m_dot  angular velocity of the mean axes and its rate
#: u, u_dot          u of eq. (26) and its rate
#: Hu, Hu_dot        angular momentum H u and its rate
#: H_inv_Dqdot       H^-1 D^T q', eq. (26)
#: H, H_dot, H_inv   H of eq. (27), its rate and its inverse
#: H_second, H_second_dot  terms of second order in q of H, and their rate
MEAN_AXES = _by_space(
    "Mean axes",
    translation="md Ct_qdot a_centre mu mu1 mu1_dot Ct_qddot Ct_dot_qdot",
    rotation="theta theta_dot omega_m omega_m_dot Hu Hu_dot u u_dot H_inv_Dqdot "
    "theta_ddot",
    matrix="H H_dot H_inv H_second H_second_dot",
)
#: Record of one elastic coordinate k of a stiffened body, theory section 12:
#: ct, ct0           row k of Ct at q and at 0
#: Ct1_qdot, Ct1_qddot  sums over l of Ct1[k, l] q_l' and of Ct1[k, l] q_l''
#: D_k, D_k_dot      row k of D, eq. (27), and its rate
#: D_column_qdot, D_column_qddot  sums over l of the transposed coupling term [l, k]
#: times q_l' and times q_l''
#: theta_k           mean rotation of the shape function
#: d_omega           derivative by q_k of the frame's angular velocity in mean axes
#: dH, dH_dot        derivative of H by q_k and its rate
#: H_second_k, H_second_k_dot  part of these of second order
#: dH_u, dH_H_inv_Dqdot  dH times u and times H^-1 D^T q'
STIFFENED_COORDINATE = _by_space(
    "Stiffened coordinate",
    translation="ct ct0 Ct1_qdot Ct1_qddot",
    rotation="D_k D_k_dot D_column_qdot D_column_qddot theta_k d_omega dH_u "
    "dH_H_inv_Dqdot",
    matrix="dH dH_dot H_second_k H_second_k_dot",
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
WORK_BY_SPACE = {
    space: WORK.with_field_types(
        space,
        frame=FRAMES[space],
        point=POINTS[space],
        modal_scratch=MODES[space],
        stiffened_scratch=STIFFENED_COORDINATE[space],
        rotation_scratch=MEAN_AXES[space],
        row=ROW,
        rotation_counter=ROTATION_STATE,
    )
    for space in (PLANE, SPACE)
}
#: Output of a constraint or a force: inertial force on its marker B, whose opposite
#: acts on A, and the torques on both markers.
WRENCH = _rows("Wrench output", force=_V3, torque_a=_V3, torque_b=_V3)
#: Output of a force: its measure g and the rate of that, the force along g, the energy
#: stored in its spring, the powers that it dissipates and supplies.
FORCE_OUTPUT = _rows(
    "Force output",
    **dict.fromkeys(
        [
            "measure",
            "rate",
            "force",
            "stored_energy",
            "dissipated_power",
            "supplied_power",
        ],
        float64,
    ),
)
#: Output of a body: kinetic, elastic and gravity energy, power dissipated by its
#: damping; momentum, and angular momentum about the inertial origin, inertial
#: components.
BODY_OUTPUT = _rows(
    "Body output",
    **dict.fromkeys(
        ["kinetic", "elastic", "gravity_energy", "dissipated_power"], float64
    ),
    momentum=_V3,
    angular=_V3,
)
OUTPUT_ARRAYS_BY_SPACE = {
    space: OUTPUT_ARRAYS.with_field_types(
        space, wrench=WRENCH, force=FORCE_OUTPUT, body=BODY_OUTPUT
    )
    for space in (PLANE, SPACE)
}


def _view_in(space: str) -> Callable[[KernelType], Any]:
    """How kernels of a space see a table: the same pointer with other fields."""
    views: dict[KernelType, KernelType] = {
        WORK: WORK_BY_SPACE[space],
        OUTPUT_ARRAYS: OUTPUT_ARRAYS_BY_SPACE[space],
    }
    return lambda table: (views[table](table), lambda builder, values: values[0])


#: A work as the equations of the plane and of space see it.
as_planar, as_spatial = (Intrinsic(_view_in(space)) for space in (PLANE, SPACE))


class BySpace(KernelChoice):
    """Two kernels, for plane and space; a call of it is one of that for its `work`."""

    def __init__(self, plane: Inner, space: Inner) -> None:
        self.kernels = {PLANE: plane, SPACE: space}
        self.py_funcs = plane.py_func, space.py_func

    def kernel_for(self, arguments: tuple[KernelType, ...]) -> Inner:
        """The kernel that is called with arguments of these types."""
        space = next(s for s, kind in WORK_BY_SPACE.items() if kind in arguments)
        return self.kernels[space]
