"""Diagnostics N4xx: limits of the floating frame, and what shape functions lack."""

from .entry import ERROR, WARNING, Entry

ENTRIES = (
    Entry(
        "N404",
        WARNING,
        "centrifugal softening of {ratio:.3g} of the stiffness, without stiffening",
        "Largest |eigenvalue| of (K_geo, Ke) over output times and ends of steps, "
        "reported from 1 %. The SID lacks geometric stiffening, so that K_geo holds "
        "the kinematic softening -omega^2 Me of a rotation only. The "
        "missing stiffening has the opposite sign and is about as large or larger.",
        remedy="{remedy}",
        units={"ratio": "%"},
        example={
            "subject": "blade",
            "ratio": -0.25,
            "load": "rotation of 2 rad/s",
            "remedy": "Convert the body with a table [stiffening].",
            "t": 15.0,
        },
    ),
    Entry(
        "N405",
        WARNING,
        "centrifugal softening exceeds the stiffness ({ratio:+.3g}) at {load}",
        "Smallest eigenvalue of (K_geo, Ke) below -1, with growth in Me q'' + Ge q' + "
        "(Ke + K_geo) q = 0. K_geo has the kinematic softening of rotation only, as "
        "the SID lacks the geometric stiffening that outweighs it.",
        remedy="{remedy}",
        units={"ratio": "%"},
        example={
            "subject": "blade",
            "ratio": -2.5,
            "load": "rotation of 6 rad/s",
            "remedy": "Convert the body with a table [stiffening].",
            "t": 15.0,
        },
    ),
    Entry(
        "N406",
        WARNING,
        "unstable at {load} about its long axis: between critical speeds",
        "Smallest eigenvalue of (K_geo, Ke) below -1 by rotation about an axis about "
        "which geometric stiffening does not act, with growth of the linear equations.",
        remedy="Run below or above the critical speeds.",
        example={"subject": "shaft", "load": "rotation of 310 rad/s", "t": 0.2},
    ),
    Entry(
        "N407",
        WARNING,
        "deformed without bound: loads and stiffness are those of no body",
        "The change of stiffness by loads is above 100 times the stiffness, with "
        "growth of the linear equations.",
        remedy="Check units and loads.",
        example={"subject": "rod", "t": 0.1},
    ),
    Entry(
        "N408",
        WARNING,
        "buckles: {load} is {factor:.3g} times what it can bear",
        "Eigenvalue of (K_geo, Ke) of all loads at an instant below -1, with K_geo "
        "from the stiffening terms of the SID, and growth of the linear equations. "
        "Its magnitude is the load over the buckling load.",
        remedy="Use a stronger section, or a smaller load.",
        example={
            "subject": "column",
            "factor": 1.34,
            "load": "a force of 1340 N at node 2",
            "t": 0.4,
        },
    ),
    Entry(
        "N411",
        WARNING,
        "deforms by {deflection:.2g} of its size; linear theory holds to {limit}",
        "Largest displacement of a node or of the centre of mass in the body frame, at "
        "output times and ends of steps, over the size of the body (its length, or the "
        "largest distance of nodes and centre of mass). Errors of linear theory grow "
        "with its square: about 1 % at 10 %.",
        remedy="Cut the body into parts joined by fixed joints.",
        units={"deflection": "%", "limit": "%"},
        example={"subject": "blade", "deflection": 0.28, "limit": 0.1},
    ),
    Entry(
        "N412",
        WARNING,
        "frequencies end at {highest}, {ratio:.2g} times the excitation of "
        "{excitation}",
        "Highest eigenfrequency of (Ke, Me) over the frequency of the fastest function "
        "of time (square root of max |f''| over the amplitude of its pieces) or of the "
        "fastest driven rotation; reported below 3. Loads of higher frequency "
        "meet a body that is too stiff.",
        remedy="Keep shape functions up to {needed}.",
        units={"highest": "Hz", "excitation": "Hz", "needed": "Hz"},
        example={
            "subject": "rod",
            "highest": 200.0,
            "ratio": 2.0,
            "excitation": 100.0,
            "by": "push",
            "needed": 300.0,
        },
    ),
    Entry(
        "N413",
        WARNING,
        "turns elastically by {rotation:.2g} rad; linear theory holds to {limit:g} rad",
        "Largest rotation of a node by deformation, at output times and ends of steps, "
        "reported above 0.15 rad.",
        remedy="Cut the body into parts joined by fixed joints.",
        example={"subject": "blade", "rotation": 0.3, "limit": 0.15},
    ),
    Entry(
        "N414",
        ERROR,
        "deforms by {deflection:.2g} of its size: numbers of the run mean nothing",
        "Largest displacement of a node or of the centre of mass in the body frame "
        "over the size of the body, reported above 1. See the warnings of the same "
        "body for the cause.",
        remedy="Check units and loads, or convert with [stiffening].",
        units={"deflection": "%"},
        example={"subject": "blade", "deflection": 2.5},
    ),
    Entry(
        "N419",
        WARNING,
        "leave linear theory by less than the bodies above",
        "Of more than eight bodies that leave linear theory those with the largest "
        "deformation are listed one by one, see N411 and N413.",
        remedy="Cut them into parts, too.",
        example={"subject": "b9, b10"},
    ),
    Entry(
        "N420",
        WARNING,
        "{missing:.2g} of the static compliance {directions} at {marker} is missing",
        "The compliance of the shape functions for a unit load at the marker over that "
        "of the full model, which the SID states; or 100 % where no shape function "
        "moves the marker. Reported above 10 % in directions in which joints or forces "
        "load it, above 50 % where what is missing is below 1 % of the largest "
        "compliance in these directions. The effect on the motion is not estimated.",
        remedy="Convert with {shapes} modes and {marker} as interface.",
        units={"missing": "%"},
        example={
            "subject": "rod",
            "missing": 0.17,
            "directions": "along x",
            "marker": "pin",
            "joints": ("crank_pin",),
            "shapes": "attachment",
        },
    ),
    Entry(
        "N422",
        WARNING,
        "{missing:.2g} of the sag under its own inertia {directions} is missing",
        "Share of the static deformation by gravity and by accelerations of the frame "
        "(from drives and the start) that the shape functions lack, which the SID "
        "states. Reported above 10 % in directions with at least half of the largest "
        "acceleration.",
        remedy="Use more modes, or attachment modes.",
        units={"missing": "%"},
        example={"subject": "rod", "missing": 0.2, "directions": "along y"},
    ),
    Entry(
        "N423",
        WARNING,
        "{share:.0f} of the compliance {direction} at {marker} is of the upper modes",
        "The SID does not state the compliance of the full model. Of the natural modes "
        "that take part in this direction (above 0.1 % of the largest part) the upper "
        "half has this share, so that further modes may add as much. Reported above "
        "10 %, above 50 % where it is below 1 % of the largest compliance.",
        remedy="Add attachment modes for {joints}.",
        units={"share": "%"},
        example={
            "subject": "rod",
            "share": 0.31,
            "direction": "along x",
            "marker": "pin",
            "joints": ("crank_pin",),
        },
    ),
    Entry(
        "N430",
        WARNING,
        "peak_von_mises is the largest of {count:node}; the peak may lie elsewhere",
        "The SID has no nodes that the conversion placed at the largest stresses of "
        "the surface (peak_points = 0), so that other points may have more stress.",
        remedy="Convert the model without peak_points = 0.",
        example={"subject": "rod", "count": 3},
    ),
)
