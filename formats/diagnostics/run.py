"""Diagnostics N3xx, N50x, N4xx: the run, why it stops, limits of the model."""

from .entry import ERROR, INFO, WARNING, Entry

_FASTEST = " 'Fastest' is the body with the largest acceleration over its size."

ENTRIES = (
    Entry(
        "N301",
        ERROR,
        "a coordinate became infinite or undefined; fastest: {fastest}",
        "A position, velocity or error estimate is not finite." + _FASTEST,
        remedy="Check laws and loads near this time.",
        example={"fastest": "rod", "t": 0.3},
    ),
    Entry(
        "N302",
        ERROR,
        "step size below the resolution of time; fastest: {fastest}",
        "The error control asks for steps shorter than the rounding of the time. The "
        "motion is not smooth there, or a body is blocked (see N313 and N310)."
        + _FASTEST,
        remedy="Check drives, stops and friction near this time.",
        example={"fastest": "slider", "t": 0.0877},
    ),
    Entry(
        "N303",
        ERROR,
        "constraints not met at the end of a step; fastest: {fastest}",
        "Newton's iteration of the positions did not reduce the residual of the "
        "constraints below the tolerance of positions, a fraction of rtol." + _FASTEST,
        remedy="Check joints and drives near this time; with a fixed step, shorten it.",
        example={"fastest": "slider", "t": 0.2},
    ),
    Entry(
        "N304",
        ERROR,
        "Newton iteration diverged with the fixed step of {step}; fastest: {fastest}",
        "The residual of an implicit step grew from one iteration to the next, and a "
        "fixed step is not repeated with a smaller size." + _FASTEST,
        remedy="Use a smaller step, or error control (no step).",
        units={"step": "s"},
        example={"step": 0.01, "fastest": "rod", "t": 0.2},
    ),
    Entry(
        "N305",
        ERROR,
        "stiff scene: {method} is limited by stability; fastest: {fastest}",
        "The steps of this explicit method are limited by its stability and not by the "
        "tolerance, so that the run would take above 1e5 steps." + _FASTEST,
        remedy='Use integrator = "radau9" or "auto".',
        example={"method": "dop853", "fastest": "rod", "t": 0.2},
    ),
    Entry(
        "N306",
        ERROR,
        "rounding exceeds the tolerance rtol = {rtol:g} of {method}",
        "The error estimate of a step does not fall below the tolerance when the step "
        "is shortened: it is the rounding of the coordinates. In generalised_alpha "
        "velocities are differences of positions over steps h, with errors of 2e-16 of "
        "the size over h; impacts, which need steps of 1e-6 of the run, end it below "
        "rtol = 1e-6.",
        remedy="Use a larger rtol, or radau9.",
        example={"method": "dop853", "rtol": 1e-13, "t": 0.0},
    ),
    Entry(
        "N307",
        ERROR,
        "deformed so far that its inertia is not positive definite",
        "Smallest eigenvalue of the mass matrix of the body, scaled to ones on its "
        "diagonal, is below 0.01 of that of the undeformed body. J, Cr m1 and Oe m1 of "
        "a SID hold for small deformations.",
        remedy="{remedy}",
        example={
            "subject": "rod",
            "t": 0.3,
            "remedy": "Set quadratic_inertia = true, or cut the body into parts.",
        },
    ),
    Entry(
        "N308",
        ERROR,
        "defect of its SID that was accepted: {reason}",
        "The mass matrix of the undeformed body has no positive eigenvalue along a "
        "motion of its frame, and the scene was compiled with accept_defects.",
        remedy='Use frame = "held", or join the node in which the frame rests.',
        example={
            "subject": "bar",
            "reason": "no positive inertia about z",
            "t": 0.0,
        },
    ),
    Entry(
        "N309",
        WARNING,
        "possible cause: its inertia is {ratio:.1g} of that of {heaviest}",
        "Smallest entry of mass and moment of inertia over size squared, as a ratio to "
        "the largest one of the mechanism; named below 1e-9, where rounding hides the "
        "light body.",
        remedy="Give it more, or use a joint of type distance for a massless rod.",
        example={"subject": "rod", "ratio": 1e-12, "heaviest": "ship"},
    ),
    Entry(
        "N310",
        ERROR,
        "singular configuration of {joints}",
        "The least singular value of the scaled constraint Jacobian is zero, or below "
        "0.01 of the largest one in the run. Motions cross there.",
        remedy="{remedy}",
        example={
            "joints": ("pin_a", "pin_b"),
            "t": 0.25,
            "remedy": "Start beside it, or change a length or a drive.",
        },
    ),
    Entry(
        "N312",
        ERROR,
        "joints and drives deform it at the start until its inertia is not positive",
        "The positions of bodies and markers do not meet the joints, and the assembly "
        "deforms the body. Smallest eigenvalue of its scaled mass matrix below 0.01 of "
        "that of the undeformed body.",
        remedy="Correct positions, or set quadratic_inertia = true.",
        example={"subject": "rod", "t": 0.0},
    ),
    Entry(
        "N313",
        ERROR,
        "from t = {later:.4g} on {contradiction}",
        "At 0.1, 1 and 5 % of the time span after the stop the joints and drives are "
        "closed with undeformed bodies. If that fails (residual above 1e-7 of the "
        "sizes), those are named without each of which the rest can be met.",
        remedy="Change a length or a drive.",
        units={"later": "s"},
        example={
            "later": 0.0887,
            "contradiction": "a, m, b and c cannot be met together",
            "joints": ("a", "m", "b", "c"),
        },
    ),
    Entry(
        "N315",
        ERROR,
        "bushing nearly a full turn from rest, where its torque is not unique",
        "The torque of a bushing follows from its rotation vector, whose length is "
        "unique below 2 pi.",
        remedy="Name an axis to turn about with `shaft`.",
        example={"subject": "mount", "t": 0.6},
    ),
    Entry(
        "N318",
        ERROR,
        "turns by more than {limit:g} rad in a step, too far to count rotations",
        "Rotations are counted from step to step: the change of the angle in a step, "
        "from its rate and from its values, must stay below the limit.",
        remedy="Use a smaller step.",
        example={"subject": "axle", "limit": 2.5, "t": 0.0},
    ),
    Entry(
        "N319",
        WARNING,
        "{reason}, not finished",
        "A signal such as Ctrl-C ended the run between two steps. The result "
        "has completed = false, its files hold the motion so far.",
        remedy="With -o and --continue the same command goes on.",
        example={"reason": "ended by Ctrl-C", "t": 0.4},
    ),
    Entry(
        "N501",
        ERROR,
        "friction of {joints} has no solution, or several",
        "The determinant of the equations of friction (1 without friction) is below "
        "0.1, or no combination of stick and slip satisfies them: the load that "
        "friction makes increases it (Painleve paradox).",
        remedy="Use a lower coefficient, or a longer guide.",
        example={"joints": ("slider",), "t": 0.1},
    ),
    Entry(
        "N502",
        ERROR,
        "{joints} change between stick and slip without end",
        "Stick and slip are decided again at each change; the number of decisions at "
        "one instant exceeded 100.",
        remedy="Use a larger rtol, or a little damping.",
        example={"joints": ("slider", "pin"), "t": 0.1},
    ),
    Entry(
        "N504",
        ERROR,
        "dead point of {joints}: what friction holds {bodies} is not determined",
        "The motion that the constraints leave has no part along the joint: its rate "
        "in their null space is below 1e-3 of its scale.",
        remedy="Start beside it, faster or driven, or without this friction.",
        example={"joints": ("slider",), "bodies": ("piston",), "t": 0.0},
    ),
    Entry(
        "N509",
        ERROR,
        "{reason}",
        "A force or control law, or a Python function, gave no finite number or "
        "raised an exception at a state that the run has reached.",
        remedy="Limit the arguments of the law.",
        example={
            "reason": "the law of motor gives no finite number at t = 0.5 s, where "
            "angle = 0.5",
            "t": 0.5,
        },
    ),
    Entry(
        "N317",
        INFO,
        "the run was continued at t = {t:.9g} s",
        "The result holds two or more runs, joined where the earlier one had ended.",
        example={"t": 1.5},
    ),
    Entry(
        "N321",
        WARNING,
        "stiff scene: stability limits {share} of the steps of {method}",
        "Steps whose size was limited by the stability of the explicit method and not "
        "by the tolerance, over all steps; reported from 1/4.",
        remedy='Use integrator = "radau9" or "auto".',
        units={"share": "%"},
        example={"share": 0.82, "method": "dop853"},
    ),
    Entry(
        "N322",
        INFO,
        "q{number} ({kind}, {frequency}, {share:.1g} of the elastic energy) decides "
        "the steps",
        "Frequency: root of the mean square of the acceleration over that of the "
        "velocity of each elastic coordinate at the output times. Energy: its mean "
        "elastic energy over that of all bodies. Reported if a step follows 1.5 to 60 "
        "of its periods in number, its energy is below 1 %, and the next coordinate "
        "would allow steps twice as long.",
        remedy="Add damping, or leave it out of shape_functions.",
        units={"frequency": "Hz", "share": "%"},
        example={
            "subject": "rod",
            "number": 5,
            "steps_per_period": 12.0,
            "kind": "axial",
            "frequency": 1250.0,
            "share": 1e-4,
        },
    ),
    Entry(
        "N323",
        WARNING,
        "rounding hides errors below {rounding:.0e} m; rtol = {rtol:g} is not promised",
        "Rounding of coordinates (machine precision times their size, for each step) "
        "against rtol times the largest motion of a coordinate; reported where ten "
        "times the latter is smaller.",
        remedy="Put the origin near to the motion ({motion:.1g} m at {size:.3g} m).",
        example={"rounding": 1e-10, "rtol": 1e-9, "motion": 1e-3, "size": 1e4},
    ),
    Entry(
        "N324",
        WARNING,
        "nothing moves by more than rounding, {rounding:.0e} m: {reason}",
        "Largest motion of a coordinate against the rounding of coordinates. The "
        "reason follows from the rank of the constraints: no free coordinate, joints "
        "that friction holds, or no force along the free ones.",
        remedy="{remedy}",
        example={
            "rounding": 1e-15,
            "reason": "joints and drives leave no motion",
            "remedy": "Free a joint, or move a drive.",
        },
    ),
    Entry(
        "N326",
        WARNING,
        "fixed steps of {step} may pass over {features}",
        "Shortest piece of a function of time, or width of a zone of a table of "
        "forces, times 1.25 and the part of it that a step may pass, below the fixed "
        "step. Passages through zones are counted in the run.",
        remedy="Use smaller steps, or error control (no step).",
        units={"step": "s"},
        example={
            "step": 0.01,
            "features": ("push, which changes within 0.001 s (t = 0.5 s)",),
        },
    ),
    Entry(
        "N327",
        INFO,
        "the last output time is {last:g} s, the end {end:g} s",
        "Output times are start + k output_step. The last one is before the end by "
        "more than 1e-9 of the span, as output_step does not divide it.",
        example={"last": 0.99, "end": 1.0},
    ),
    Entry(
        "N328",
        INFO,
        "Python function sampled; features shorter than {shortest} may be missed",
        "A Python function is replaced by polynomials on an adaptive grid. What lasts "
        "less than the first spacing of the grid may lie between its points.",
        remedy="Announce instants with sidtool.Timed.",
        units={"shortest": "s"},
        example={"subject": "push", "shortest": 1.2e-4},
    ),
    Entry(
        "N329",
        WARNING,
        "singular configuration of {joints} passed at t = {t:.6g} s ({count:d} in all)",
        "Least singular value of the scaled constraint Jacobian along the step, "
        "compared with its usual size; motions cross there (a bifurcation), and "
        "rounding, tolerance and integrator may decide which one goes on.",
        remedy="Start beside it, drive the motion, or guide it.",
        example={"joints": ("pin_a", "pin_b"), "t": 0.25, "count": 1},
    ),
    Entry(
        "N330",
        WARNING,
        "joints deform it by more than loads do: {reason}",
        "At the end of the run the joints and drives cannot be met by undeformed "
        "bodies (see N313 of a stopped run), and the deflection in the run is above "
        "0.1 of the size. Such motions may magnify errors beyond rtol.",
        remedy="Correct the length or the drive.",
        example={"subject": "rod", "reason": "a and b come no nearer than 0.02 m"},
    ),
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
        "{missing:.2g} of the strain energy by {causes} is missing",
        "Share of the static strain energy under gravity and by the acceleration and "
        "rotation of the frame (from drives and the start) that the shape functions "
        "lack, which the SID states. Deformation and stress lack it: one linear shape "
        "function of a hanging bar has 3/4 of the energy, 1/2 of the largest stress. "
        "Of a free body only rotations count, balanced by its inertia: a bar about its "
        "middle grows by rho omega^2 L^3 / (12 E), with bending modes by nothing. "
        "Accelerations act on it with the forces at markers "
        "that cause them (N420). Each square and product of angular velocities is "
        "judged on its own. Reported above 10 % of a load, where that is 1 % of the "
        "largest such energy, and above 99.9 % of bodies with stress, and of free ones "
        "that would deform by 1e-6 of their size, only.",
        remedy="Use attachment modes, with centrifugal = true for rotations.",
        units={"missing": "%"},
        example={
            "subject": "rod",
            "missing": 0.25,
            "causes": "acceleration along x",
        },
    ),
    Entry(
        "N423",
        WARNING,
        "{share:.0f} of the compliance {direction} at {marker} is of {modes}",
        "The SID does not state the compliance of the full model. Of the natural modes "
        "that take part in this direction (above 0.1 % of the largest part) the upper "
        "half has this share, so that further modes may add as much. Reported above "
        "10 %, above 50 % where it is below 1 % of the largest compliance. If all that "
        "take part have one frequency, what further ones add is unknown; a single "
        "mode of the stretching of a uniform bar lacks 19 %.",
        remedy="Add attachment modes for {joints}.",
        units={"share": "%"},
        example={
            "subject": "rod",
            "share": 0.31,
            "direction": "along x",
            "marker": "pin",
            "modes": "the upper modes",
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
