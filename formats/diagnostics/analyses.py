"""Diagnostics N7xx: equilibria, natural modes, inverse dynamics, studies."""

from .entry import ERROR, INFO, WARNING, Entry

ENTRIES = (
    Entry(
        "N701",
        ERROR,
        "no equilibrium in {iterations:iteration}: {residual:.1e} of the forces, at "
        "{body}",
        "Newton's method with a line search on the forces along the directions that "
        "joints leave free. Residual: norm of what is unbalanced over the largest "
        "forces met; an equilibrium is below 1e-10. The body is that on which the "
        "unbalanced forces do most work.",
        remedy="Hold what may fall or fly away, or start nearer to an equilibrium. "
        "Modes of free bodies: --about start.",
        example={"iterations": 200, "residual": 1.0, "body": "satellite"},
    ),
    Entry(
        "N702",
        ERROR,
        "the equilibrium leaves joints open: {gaps}",
        "Positions are moved onto the constraints in each step. The largest residuals "
        "over the sizes of the joints are named.",
        remedy="Correct positions of markers, or lengths.",
        example={"gaps": "pin by 0.02 m"},
    ),
    Entry(
        "N703",
        WARNING,
        "simulate cannot start in this equilibrium: {reason}",
        "The mass matrix along the directions that the constraints leave free is not "
        "positive definite in the deformed state.",
        remedy="Cut the body into parts.",
        example={"reason": "the inertia of arm is not positive"},
    ),
    Entry(
        "N704",
        WARNING,
        "the equilibrium is unstable: it moves away along {coordinate}",
        "The tangent stiffness K along the free directions has a negative eigenvalue "
        "in its symmetric part, and M a + K x = 0 has a solution that grows without "
        "vibration. Flutter under forces that follow a body is found by `analyse "
        "modes` (N714). Laws with states are not evaluated.",
        remedy="Start nearer to another equilibrium.",
        example={"coordinate": "arm.angle"},
    ),
    Entry(
        "N710",
        WARNING,
        "the state is not steady ({coordinate} accelerates): modes are not its motion",
        "Accelerations remain in axes that rotate with the bodies. Drives demand them "
        "(above 1e-8 of those by forces), or a Newton step leads to no steady state "
        "within 5 % of the size of the mechanism.",
        remedy="{remedy}",
        example={
            "coordinate": "arm.wz_body",
            "remedy": 'Use about = "static", or "start" with a scene in steady motion.',
        },
    ),
    Entry(
        "N711",
        WARNING,
        "mode of {here:.4g} Hz has {there:.4g} Hz in the steady state near by",
        "A Newton step on the accelerations that remain leads to a "
        "steady state near by, in which loads stiffen or soften the bodies. Reported "
        "where a frequency differs by more than 2 %.",
        remedy='Set initial.state = "static".',
        example={"here": 1.7, "there": 2.8, "coordinate": "arm.q1"},
    ),
    Entry(
        "N712",
        INFO,
        "{bodies} are described in axes {axes}{rest}",
        "Axes are sought in which the equations of small motions are constant: those "
        "of each body, then those of one body for all, then inertial ones. "
        "Frequencies in rotating axes differ from inertial ones by the speed.",
        example={
            "bodies": "rigid bodies",
            "axes": "that turn with hub",
            "rest": ", others in their own",
        },
    ),
    Entry(
        "N713",
        WARNING,
        "equations change as bodies turn{cause}: modes of an instant are not those of "
        "the motion",
        "The state matrix changes by more than 0.1 % over 0.4 rad of rotation in all "
        "axes that were tried.",
        remedy="Use Floquet's multipliers (analyse floquet), or simulate. A round "
        "body needs both of a pair.",
        example={"cause": ""},
    ),
    Entry(
        "N715",
        WARNING,
        "frozen values of one instant: they do not describe a motion",
        "Modes with frozen = true (--frozen), or a state space, were requested of a "
        "state that is not steady or of equations that change as bodies turn (see "
        "N710, N711, N713).",
        remedy="Use analyse floquet, or simulate.",
        example={},
    ),
    Entry(
        "N717",
        WARNING,
        "modes from {first} on are left out: they change while the bodies turn",
        "The shape function across the axis has no partner at a right "
        "angle: its reduction holds one of two. Modes above 0.5 of its frequency may "
        "change by more than 0.1 % over 0.4 rad.",
        remedy="Convert with one mode more or less.",
        units={"first": "Hz", "shape": "Hz"},
        example={"first": 410.0, "shape": 520.0},
    ),
    Entry(
        "N718",
        ERROR,
        "the state has no natural modes",
        "See the warning behind it: the state is not steady (N710, N711), or its "
        "equations change as bodies turn (N713), by more than 0.1 % over 0.4 rad.",
        remedy="{remedy}",
        example={
            "remedy": "With --frozen (frozen = true) they are those of one instant.",
            "t": 0.0,
        },
    ),
    Entry(
        "N719",
        ERROR,
        "no accelerations: the mass matrix is not positive along what can move",
        "Smallest eigenvalue of the mass matrix along the directions that the "
        "constraints leave free, scaled to ones on its diagonal, is not above 0.",
        remedy="Give each body that can move mass and inertia.",
        example={"t": 0.0},
    ),
    Entry(
        "N721",
        ERROR,
        "elastic coordinates find no equilibrium: bodies are too soft for the loads",
        "Newton's method on the elastic coordinates under the loads of the prescribed "
        "motion; the correction grew instead of falling.",
        remedy="Use simulate, or stiffer bodies.",
        example={"t": 0.2},
    ),
    Entry(
        "N722",
        ERROR,
        "the joints cannot be closed: drives demand a position out of reach",
        "Positions are found from one output time to the next; below the smallest part "
        "of an interval that is tried (halvings) the joints cannot be closed.",
        remedy="Correct lengths, or the drive from this time on.",
        example={"t": 0.2},
    ),
    Entry(
        "N723",
        ERROR,
        "{joints} demand {rates} that do not exist",
        "Least-squares solution of the derivatives of the constraints; its largest "
        "residual over the sizes of the joints exceeds that of rounding. The "
        "configuration is singular, or there are too many constraints.",
        remedy="Free a joint, or shift the output times.",
        example={"joints": ("crank", "slider"), "rates": "velocities", "t": 0.2},
    ),
    Entry(
        "N724",
        WARNING,
        "mode {mode} is followed from {key} = {before:.6g} to {after:.6g} with little "
        "certainty",
        "Largest agreement of mode shapes at neighbouring values (modal assurance "
        "criterion in the metric of the kinetic energy, `agreement` in the data); "
        "below 0.5 another mode may be taken for it.",
        remedy="Take more values.",
        example={
            "mode": 3,
            "key": "parameters.speed",
            "before": 100.0,
            "after": 200.0,
            "agreement": 0.31,
        },
    ),
    Entry(
        "N725",
        INFO,
        "the state space has the {derivative} as its input",
        "The input prescribes a motion, which constraint forces and accelerations "
        "follow with its derivatives. The input itself, and its rate where that is not "
        "the input, are states. Multiply a frequency response by (i omega)^k to "
        "get that to the input itself.",
        example={"derivative": "second derivative"},
    ),
    Entry(
        "N726",
        WARNING,
        "the response changes by {change} as the bodies turn: the state space is "
        "that of an instant",
        "The frequency response to the inputs changes by more than 0.1 % over 0.4 rad "
        "of rotation in all axes that were tried: an output or an input that turns "
        "with a body does not go with one that stands still.",
        remedy="Use outputs and forces in the same axes, such as those of the ground.",
        units={"change": "%"},
        example={"change": 0.39},
    ),
    Entry(
        "N727",
        ERROR,
        "there is no static equilibrium to linearise about",
        "A state space belongs to an operating point, by default the static "
        "equilibrium. The error behind it says why there is none.",
        remedy='Linearise about the initial state, about = "start" (--about start), or '
        "about a time of a run.",
        example={},
    ),
    Entry(
        "N728",
        INFO,
        "left out of the outputs: {names}, integrals along a run",
        "Outputs of a state space follow from the state and the inputs. Energies that "
        "are dissipated or supplied follow from all of the run before.",
        example={"names": "energy.supplied"},
    ),
    Entry(
        "N729",
        ERROR,
        "no modes at {key} = {value:.6g}",
        "The analysis at this value of the parameter failed for the reason behind it; "
        "a diagram needs modes at all values.",
        remedy="Leave the value out, or analyse the modes at it alone.",
        example={"key": "parameters.speed", "value": 100.0},
    ),
    Entry(
        "N741",
        ERROR,
        "the motion does not return after {period:.6g} s: {reason}",
        "Largest difference of positions, velocities and deformations between the end "
        "of the period and its start, but for whole revolutions, or of accelerations "
        "of equal states near the motion a period apart, in sizes of the mechanism and "
        "of the period (`size` in the data); a motion returns below 1e-6.",
        remedy="Begin in the periodic motion, as with initial = {{state = "
        '"result"}} after a long run. Give the period of all functions of time, '
        "best as a formula, and the functions over two periods.",
        example={"period": 0.5, "size": 0.3, "reason": "arm misses its start"},
    ),
    Entry(
        "N742",
        ERROR,
        "the motion has no variational equations: {reason}",
        "Small changes of the motion are those of its linearised run (theory, section "
        "19), which needs smooth equations and constraints that stay.",
        remedy="Take friction, events or corners of forces out of the scene.",
        example={"reason": "joint friction"},
    ),
    Entry(
        "N743",
        WARNING,
        "multipliers are known only to {error:.1e}",
        "A hundredth of the change of the multipliers when the steps of the period are "
        "halved, up to 2048 of them; reported above 1e-6. Modes that are fast against "
        "the period need many steps.",
        remedy="Leave fast modes out (shape_functions of their bodies).",
        example={"error": 2e-5},
    ),
    Entry(
        "N744",
        INFO,
        "{bodies} are described in multi-blade coordinates",
        "Equal bodies at equal azimuths around an axis, three or more: their harmonics "
        "over the azimuth, seen from axes that do not turn (Coleman transformation). "
        "The equations of small motions are constant in them.",
        example={"bodies": "blade1, blade2, blade3"},
    ),
    Entry(
        "N745",
        WARNING,
        "the law has a corner or a jump at this state: a mean stands for its slope",
        "Changes of the force to both sides of the state, over 1e-6 of the size of the "
        "mechanism, differ by more than 2 % of their sum; and what differs falls with "
        "the step, not with its square, over an eighth of it. Or the force changes by "
        "more than half as much over the shorter step. Motions about such a state are "
        "not linear: contacts that touch, dampers of two slopes, dry friction at "
        "rest. The mean is that over 1e-6 of the size of the mechanism; an input "
        "changes by 1e-3 of itself or of 1.",
        remedy="Analyse about a state beside it, or smooth the law.",
        example={"subject": "bump_stop"},
    ),
    Entry(
        "N714",
        WARNING,
        "growing, by up to exp({rate:.4g} t/s)",
        "Real part of an eigenvalue that is positive beyond rounding: damping ratio "
        "below -1e-6. It is not reported with N710, N711 or N713, where eigenvalues "
        "of the instant decide nothing.",
        remedy="Add damping, or check the signs of gains and springs.",
        example={"subject": "modes 1, 2", "rate": 3.2},
    ),
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
