"""Diagnostics N30x, N31x, N50x: why a run or an analysis stops, and likely causes."""

from .entry import ERROR, WARNING, Entry

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
        "is shortened: it is the rounding of the coordinates.",
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
)
