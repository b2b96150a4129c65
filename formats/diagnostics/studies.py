"""Diagnostics N73x: studies of many runs, derivatives of a motion."""

from .entry import ERROR, INFO, WARNING, Entry

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
        "{count} of {all} combinations: those with at most {differ:choice} changed",
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
    Entry(
        "N735",
        ERROR,
        "no derivative by this variable: {reason}",
        "Neighbouring scenes are run with the steps of this one. At all distances from "
        "1e-3 down to 1e-7 of the variable they have other events, friction states in "
        "another order or other constraints, or cannot be run. The motion has no "
        "derivative there, or only one on each side.",
        remedy="Change the variable a little, or separate events that coincide.",
        example={
            "subject": "block.mass",
            "reason": "event hit in another step at t = 0.31 s",
        },
    ),
    Entry(
        "N736",
        WARNING,
        "{of} has another peak, whose derivative differs by {difference}",
        "A peak away from the largest one is lower by less than 1e-3 of the range of "
        "the output, and its derivative by this variable differs by more than 1 %. The "
        "derivative is that of the largest peak. A larger change of the variable may "
        "let the other peak be the largest one: an optimiser meets a kink.",
        remedy="Use norm(OUTPUT, p), which is smooth.",
        units={"difference": "%"},
        example={
            "subject": "parameters.n",
            "of": "max_abs(rod.q1)",
            "difference": 0.3,
        },
    ),
    Entry(
        "N737",
        WARNING,
        "derivative of {of} is known to {error} only",
        "Estimated error of a derivative, relative to its size, above 1e-3: the "
        "truncation error of the differences plus rounding of the runs. Functionals "
        "that hardly depend on a variable, and motions that are chaotic or not smooth, "
        "have such derivatives. Derivatives that change a functional by less than 1e-3 "
        "of its size for a change of the variable by its own size count as that.",
        remedy="Use a smaller rtol, a shorter time span, or a mean for a final value.",
        units={"error": "%"},
        example={
            "subject": "bodies.block.mass",
            "of": "final(block.x)",
            "error": 3e-3,
        },
    ),
    Entry(
        "N738",
        WARNING,
        "the mechanism passes a singular configuration: derivatives may be wrong",
        "Steps near a singular configuration follow another formula, whose choice "
        "depends on the numbers of the scene.",
        remedy="Compare with a sweep, or start beside the singular configuration.",
        example={"t": 0.25},
    ),
    Entry(
        "N739",
        WARNING,
        "residuals of neighbouring values are correlated ({correlation:.2f})",
        "Correlation of the residuals of a fit with their neighbours in time, above "
        "0.2 and above 4 / sqrt(n). Independent noise has none: the scene does not "
        "describe the measurement, or the noise was filtered. Intervals are too narrow "
        "then.",
        remedy="Identify more numbers, or take fewer values of a filtered signal.",
        example={"subject": "arm.tip.y", "correlation": 0.8},
    ),
    Entry(
        "N740",
        WARNING,
        "its effect is that of {other}: correlation {correlation:.5f}",
        "Correlation of two identified numbers, from the derivatives of the measured "
        "values, with a magnitude above 0.999. The measurement determines a "
        "combination of both.",
        remedy="Measure another output, or give one of both numbers.",
        example={
            "subject": "spring.stiffness",
            "other": "block.mass",
            "correlation": 0.99999,
        },
    ),
)
