"""Diagnostics N73x: studies of many runs."""

from .entry import INFO, WARNING, Entry

ENTRIES = (
    Entry(
        "N730",
        INFO,
        "the reference is good to {uncertainty:.0e} only, due to {limiting}",
        "Relative error of the reference, from two integrators at tight tolerance and "
        "the last refinements of mesh and modes. Reported above 1e-3 where other "
        "outputs are known better. Smaller errors are not resolved.",
        remedy="{remedy}",
        example={
            "uncertainty": 0.02,
            "limiting": ("pin.fx",),
            "remedy": "Use finer meshes, or compare --of piston.x alone (3e-06).",
        },
    ),
    Entry(
        "N732",
        WARNING,
        "not predictable: two references differ by {difference} of its variation",
        "Largest difference of two integrators of different order at tight tolerance, "
        "over the variation of the output, above 1e-3: the motion is chaotic or "
        "passes a bifurcation. No setting is recommended for such an output.",
        remedy="Use a shorter time span.",
        units={"difference": "%"},
        example={"subject": "lower.x", "difference": 0.3},
    ),
    Entry(
        "N733",
        INFO,
        "{count} of {all} combinations: those with at most {differ} choices changed",
        "All combinations of the varied axes are more than 300 points. Those that "
        "differ from the scene in few choices are run.",
        remedy="--differ {next} adds more; finished ones are reused.",
        example={"count": 280, "all": 1200, "differ": 2, "next": 3},
    ),
    Entry(
        "N734",
        WARNING,
        "not converged: mesh and modes still change it by {change} of its variation",
        "Estimated error of the finest mesh plus the last change by modes, over the "
        "variation of the output, above 0.1. The output is not compared.",
        remedy="Use finer meshes or more modes.",
        units={"change": "%"},
        example={"subject": "arm.q3", "change": 0.9},
    ),
)
