"""Diagnostics N3xx: the run, its integrator and its output times."""

from .entry import INFO, WARNING, Entry

ENTRIES = (
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
        "reason follows from the rank of the constraints: no free coordinate, or no "
        "force along the free ones.",
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
)
