"""Diagnostics N2xx and N5xx: the scene, its start, its force and control laws."""

from .entry import ERROR, INFO, WARNING, Entry

#: Of bodies that vibrate about their equilibrium from the start.
EQUILIBRIUM_REMEDY = (
    'Ramp the loads, or set initial.state = "static" where the mechanism can rest.'
)

ENTRIES = (
    Entry(
        "N201",
        WARNING,
        "gravity of {gravity} is {ratio} times that of the earth",
        "Norm of the vector `gravity`, reported above 100 m/s2. A centrifuge may have "
        "as much.",
        remedy="Give m/s2.",
        units={"gravity": "m/s2"},
        example={"gravity": 9810.0, "ratio": 1000.0},
    ),
    Entry(
        "N202",
        INFO,
        "{value:g} rad is a multiple of 30 or 45: are degrees meant ({value:g} deg = "
        "{radians:.4g} rad)?",
        "Initial angles, ends of drives and references of controllers above one turn "
        "that are whole multiples of 30 or 45. A motor may well turn by 60 rad.",
        remedy="Give radians.",
        example={"subject": "drives.motor", "value": 90.0, "radians": 1.571},
    ),
    Entry(
        "N203",
        WARNING,
        "{size} long, joined by {joint} to {other} of {other_size}",
        "Largest distance of nodes and centre of mass of two bodies that a joint "
        "connects, reported from a ratio of 100.",
        remedy="Is one of them in mm?",
        units={"size": "m", "other_size": "m"},
        example={
            "subject": "arm",
            "size": 300.0,
            "joint": "pin",
            "other": "hand",
            "other_size": 0.12,
        },
    ),
    Entry(
        "N204",
        WARNING,
        "moments of inertia {moments:.4g} are those of no body",
        "Eigenvalues of the inertia tensor about the centre of mass. Of a real body "
        "the largest is at most the sum of the two others.",
        remedy="Give moments about the centre of mass.",
        units={"moments": "kg m2"},
        example={"subject": "arm", "moments": (1.0, 1.0, 3.0)},
    ),
    Entry(
        "N205",
        WARNING,
        "radius of gyration {radius}, but markers are only {extent} apart",
        "Root of the largest central moment of inertia over the mass, against the "
        "largest distance of markers, reported from a ratio of 30 unless the body is "
        "dense enough for it.",
        remedy="Give kg m2 and kg.",
        units={"radius": "m", "extent": "m"},
        example={"subject": "arm", "radius": 31.6, "extent": 0.5},
    ),
    Entry(
        "N206",
        WARNING,
        "{key} = {value:g} is negative and drives what it should hold",
        "First value of `stiffness` or `damping` of a spring, damper or bushing "
        "below 0.",
        remedy="Check the sign.",
        example={"subject": "spring", "key": "stiffness", "value": -100.0},
    ),
    Entry(
        "N207",
        WARNING,
        "acts between two markers of the rigid body {body}, without effect",
        "Both markers belong to one body without elastic coordinates, so that the "
        "power of the force is 0.",
        remedy="Put one marker on another body.",
        example={"subject": "spring", "body": "arm"},
    ),
    Entry(
        "N208",
        INFO,
        "the run of {span} is {periods} periods of its first mode",
        "Time span times the first frequency of (Ke, Me), reported if it is below 0.01 "
        "for all flexible bodies. It is usual for the study of impacts.",
        remedy="Give time.end in s.",
        units={"span": "s"},
        example={"subject": "rod", "span": 1e-5, "periods": 3.1e-4},
    ),
    Entry(
        "N209",
        WARNING,
        "{rate} rad/s move {size} at {speed:.2g} m/s; 1/min would be {radians:.3g} "
        "rad/s",
        "Largest rate of a drive times the size of the mechanism, or initial angular "
        "velocity of a body times the distance of its nodes, reported above 2000 m/s.",
        remedy="Give rad/s.",
        units={"size": "m"},
        example={
            "subject": "motor",
            "rate": 3000.0,
            "size": 1.2,
            "speed": 3600.0,
            "radians": 314.2,
        },
    ),
    Entry(
        "N210",
        WARNING,
        "stiffness {stiffness:.3g} {unit}: {ratio} steel blocks of {size}",
        "Reported if both hold: the spring is stiffer than a solid block of steel of "
        "the size L of the mechanism (E L, in torsion E L^3), and it would make the "
        "mass of all bodies vibrate faster than sound (20 000 m/s) crosses L.",
        remedy="Check the unit.",
        units={"size": "m"},
        example={
            "subject": "spring",
            "stiffness": 1e15,
            "unit": "N/m",
            "ratio": 4760.0,
            "size": 1.0,
        },
    ),
    Entry(
        "N211",
        WARNING,
        "damping {damping:.3g} {unit} would stop all {mass} within {time}",
        "Inertia of all bodies over the damping, reported if it is 10 times shorter "
        "than sound (20 000 m/s) needs to cross the mechanism.",
        remedy="Check the unit.",
        units={"mass": "kg", "time": "s"},
        example={
            "subject": "damper",
            "damping": 1e9,
            "unit": "N s/m",
            "mass": 10.0,
            "time": 1e-8,
        },
    ),
    Entry(
        "N212",
        WARNING,
        "vibration at {frequency} or more, {periods:.2g} periods: {steps:.1g} steps",
        "Root of the stiffness over the mass of all bodies, a lower bound of its "
        "frequency, times the run, or times the time in which its damper stops it. "
        "Reported from 1e5 periods; ten steps are counted for each.",
        remedy="Replace the spring by a joint, or add a damper.",
        units={"frequency": "Hz"},
        example={
            "subject": "spring",
            "frequency": 5.03e4,
            "periods": 5e5,
            "steps": 5e6,
        },
    ),
    Entry(
        "N213",
        WARNING,
        "a friction coefficient of {coefficient} is above that of any materials",
        "Larger one of kinetic and static coefficient, reported above 3. Dry pairs of "
        "materials have 0.05 to 1.",
        remedy="Give 0.1 for 10 %.",
        example={"subject": "slide", "coefficient": 10.0},
    ),
    Entry(
        "N214",
        WARNING,
        "{quantity} of {value:g} m in a mechanism of {size}",
        "The radius of a pin with friction is larger than the mechanism, or the rest "
        "length of a spring or the reference of a controller is above 50 times it.",
        remedy="Give m.",
        units={"size": "m"},
        example={
            "subject": "pin",
            "quantity": "pin radius",
            "value": 10.0,
            "size": 0.5,
        },
    ),
    Entry(
        "N216",
        WARNING,
        "gain {key} = {gain:g} drives {output} away from its reference",
        "A gain p or d of a PID is below 0, while its actuator acts on the coordinate "
        "that it measures. The closed loop is not analysed.",
        remedy="Check the sign of the gain.",
        example={"subject": "motor", "key": "p", "gain": -5.0, "output": "pin.angle"},
    ),
    Entry(
        "N217",
        WARNING,
        "stiffness {stiffness:.4g} {unit} holds nothing: its ends moved by "
        "{displacement:.3g} {length_unit}",
        "The ends moved by more than the size of the mechanism (or a turn), the period "
        "of the spring with the two bodies alone is longer than the run, and the "
        "steady load that it met would stretch it beyond the same limit (50 rad).",
        remedy="Is it in N/mm, kN/m or kN m/rad?",
        example={
            "subject": "spring",
            "stiffness": 10.0,
            "unit": "N/m",
            "displacement": 3.1,
            "length_unit": "m",
        },
    ),
    Entry(
        "N218",
        WARNING,
        "gained {speed:.2g} m/s, more than any mechanism does",
        "Speed of the frame at the end of the run less that at its start, or the rate "
        "of rotation times the size of the body, reported above 2000 m/s. It is not "
        "reported after a run that stopped early.",
        remedy="Are {loads} in N and N m?",
        example={"subject": "slider", "speed": 4.3e5, "loads": ("push",)},
    ),
    Entry(
        "N219",
        INFO,
        "vibrates about equilibrium from the start, with about {share:.2g} of its size",
        "As N220, below 1 % of the size of the body.",
        remedy=EQUILIBRIUM_REMEDY,
        units={"share": "%"},
        example={
            "subject": "rod",
            "share": 0.0021,
        },
    ),
    Entry(
        "N220",
        WARNING,
        "not in equilibrium at the start; vibrates with about {share:.2g} of its size",
        "Deformation whose elastic forces would leave the elastic coordinates no "
        "acceleration at the start (W Ke dq = q'', with W the acceleration by unit "
        "forces), as the largest displacement of a node over the size of the body. "
        "Reported from 10 % of the largest deflection in the run and 1 % of the size.",
        remedy=EQUILIBRIUM_REMEDY,
        units={"share": "%"},
        example={
            "subject": "rod",
            "share": 0.021,
        },
    ),
    Entry(
        "N221",
        WARNING,
        "the assembly moved {changes} to close joints and drives",
        "Frames of the assembled start against those of the scene; the three bodies "
        "that moved most are named. Reported above rtol times the size of the "
        "mechanism, or rtol as an angle.",
        remedy="Correct the initial positions, or set fixed = true.",
        units={"linear": "m", "angular": "rad"},
        example={
            "changes": ("rod by 0.12 m and 0.35 rad",),
            "bodies": ("rod",),
            "linear": (0.12,),
            "angular": (0.35,),
        },
    ),
    Entry(
        "N222",
        WARNING,
        "the assembly deformed {changes} to close joints and drives",
        "Largest change of the displacement of a node, from the deformation that the "
        "scene gives (none if it gives none) to that of the assembled start. Reported "
        "above rtol times the size of the mechanism.",
        remedy="Give positions that fit, or initial.elastic.",
        units={"linear": "m"},
        example={
            "changes": ("rod by 0.0012 m",),
            "bodies": ("rod",),
            "linear": (0.0012,),
        },
    ),
    Entry(
        "N223",
        WARNING,
        "joints and drives changed the initial velocity of {changes}",
        "Velocities are projected on the constraints with the mass matrix, as an "
        "impulse would do. Reported where the change over the run exceeds rtol times "
        "the size of the mechanism, and rtol times the velocity.",
        remedy="Give velocities that the joints allow.",
        units={"linear": "m/s", "angular": "rad/s"},
        example={
            "changes": ("rod by 1.5 m/s and 3 rad/s",),
            "bodies": ("rod",),
            "linear": (1.5,),
            "angular": (3.0,),
        },
    ),
    Entry(
        "N224",
        WARNING,
        "starts at rest, not in steady rotation: {reason}",
        "With initial.state = 'static' bodies that rotate start in the equilibrium "
        "of springs and centrifugal forces. It is sought by Newton's iteration over "
        "steady rotations about fixed axes, in scenes of at most 400 velocity "
        "coordinates without friction. Without it they vibrate where springs carry "
        "them.",
        remedy='Start from a damped run: initial.state = "result".',
        example={"subject": "rotor", "reason": "the friction of pin is in it"},
    ),
    Entry(
        "N225",
        WARNING,
        "starts in an unstable steady rotation: departs with exp({rate:.3g} t/s)",
        "An eigenvalue of the small motions about the steady rotation, with gyroscopic "
        "terms, has this positive real part. If the steady rotation nearest to the "
        "start is unstable, another is sought by descent on the potential of forces "
        "and centrifugal forces, V - omega^2 I/2, from the start. The warning says "
        "that none is found, or that this one is unstable, too.",
        remedy="Start nearer to another steady rotation, or add damping.",
        example={"subject": "hub, arm", "rate": 28.9},
    ),
    Entry(
        "N232",
        WARNING,
        "over-constrained: {count:constraint} not enforced, open by "
        "{residual:.1e} of its size",
        "Constraints that follow from others but for the rounding of the data are "
        "left out. Their largest residual at the output times is given, relative to "
        "the size of the mechanism.",
        remedy="Without contradiction: {substitution}.",
        example={
            "count": 2,
            "residual": 3e-7,
            "substitution": "hinge as a cylindrical joint (axis = [0, 0, 1])",
        },
    ),
    Entry(
        "N233",
        WARNING,
        "forces not unique ({reason}); smallest ones recorded",
        "The transposed constraint Jacobian has a null space, in which forces of these "
        "joints and drives can be shifted without a change of the motion. Recorded are "
        "the multipliers of least norm in scaled units. Real ones depend on stiffness "
        "and fit of the parts.",
        remedy="Free a joint, or make a body flexible.",
        example={
            "subject": "hinge_a, hinge_b",
            "reason": "5 redundant constraints",
        },
    ),
    Entry(
        "N240",
        INFO,
        "simulated as rigid{lost}",
        "Bodies with `rigid = true`, with --rigid, or that a requested accuracy allows "
        "to be rigid. Outputs of their elastic coordinates are not recorded.",
        example={"subject": "rod", "lost": ", not recorded: rod.q1"},
    ),
    Entry(
        "N241",
        INFO,
        "reduced: {reduction}",
        "Shape functions that the scene or a requested accuracy selects, or geometric "
        "stiffening that it leaves out.",
        example={"subject": "rod", "reduction": "shape functions 1, 2 of rod.SID_FEM"},
    ),
    Entry(
        "N242",
        WARNING,
        "not the shapes of {file}: {changes}",
        "A SID replaces the file that the scene names. Kinds of motion, such as "
        "bending in y, are compared for q1 to qn, with n the smaller number of "
        "coordinates.",
        remedy="Check outputs and initial values of these coordinates.",
        example={
            "subject": "rod",
            "file": "rod.SID_FEM",
            "changes": ("q2 is axial, was bending in y",),
        },
    ),
    Entry(
        "N244",
        WARNING,
        "no effect: {reason}",
        "A key of the scene that differs from its default and changes 0 numbers of "
        "this run.",
        remedy="Remove it, or change what it depends on.",
        example={"subject": "accuracy.rtol", "reason": "the step is fixed"},
    ),
    Entry(
        "N245",
        WARNING,
        "the unit {unit} is not known: its numbers count as SI",
        "The unit in brackets in the head of a column, or of a dataset, is not among "
        "those that are converted: the factor is 1.",
        remedy="Write another unit, or give the scale of the column.",
        example={"subject": "bearing.csv, kxx", "unit": "kgf/mm"},
    ),
    Entry(
        "N246",
        WARNING,
        "a number is looked up beyond the table, from {first:.4g} to {last:.4g}",
        "A formula of a number reads a table at parameters below the least or above "
        "the largest of its points (min, max). The value of the nearest end holds.",
        remedy="Check the unit of its column, or extend the table.",
        example={"subject": "tables.kyy, x", "first": 52.4, "last": 838.0},
    ),
    Entry(
        "N234",
        WARNING,
        "no value at {count:output time}, first at t = {t:.6g}: singular configuration",
        "Constraint forces are solved for at each output time. Where constraints "
        "depend on each other, this system is singular. Close to such a configuration "
        "(sine of the angle between constraints below 0.01) the forces are solved for "
        "again with constraints whose rates are violated by their tolerance. Forces "
        "are not recorded where one changes by more than 0.1 % of the largest (without "
        "any load, by more than 1e-6 of the largest of the run), nor where the sine is "
        "below 1e-6. Those of mechanisms beside it are. The state itself is valid.",
        remedy="Shift the output times.",
        example={"subject": "pin.fx, pin.fy", "count": 1, "t": 0.25},
    ),
    Entry(
        "N510",
        WARNING,
        "{reason}, in a step that was repeated",
        "A law gave no finite number, or raised an exception, in a stage of a step "
        "that the integrator could do without. Outputs that need the value there are "
        "not numbers.",
        remedy="Limit the arguments of the law.",
        example={"reason": "the law of push raised ValueError at t = 0.3 s"},
    ),
    Entry(
        "N511",
        INFO,
        "is at its limit of {limit:g}",
        "Value of a controller or formula within 1e-9 of its limit in the static "
        "state, which then depends on the limit and not on the gains.",
        example={"subject": "motor", "limit": 20.0},
    ),
    Entry(
        "N512",
        WARNING,
        "coordinates grew to {largest:.2g}; a loop of sampled laws may be unstable",
        "Largest change of a coordinate since the start, reported above 1e6 sizes of "
        "the mechanism in scenes with sampled laws. The loop itself is not analysed.",
        remedy="Use smaller gains, or a shorter sample_time.",
        units={"periods": "s"},
        example={"subject": "motor", "largest": 2.1e8, "periods": (0.01,)},
    ),
    Entry(
        "N513",
        INFO,
        "sampling and holding is ignored: the law is taken as continuous",
        "An equilibrium or a linearisation has no instants of samples. The delay of "
        "about half a sample is not in the damping of the modes.",
        example={"subject": "motor"},
    ),
    Entry(
        "N514",
        INFO,
        "friction {state} in this state; modes assume motions too small to change that",
        "Joints whose friction holds in the state are constraints of the "
        "linearisation, sliding ones have the friction of their load.",
        example={"subject": "slide", "state": "holds"},
    ),
    Entry(
        "N515",
        INFO,
        "the equilibrium is that without its friction",
        "Statics are solved with friction left out. With friction the scene rests in a "
        "range of states around this one.",
        example={"subject": "slide"},
    ),
    Entry(
        "N516",
        INFO,
        "held by friction in this equilibrium",
        "Without friction there is no equilibrium (N701). The joints rest where the "
        "scene starts, by forces t with |t| <= mu_s N; they rest in a range of states "
        "around this one, too.",
        example={"subject": "slide"},
    ),
    Entry(
        "N517",
        ERROR,
        "friction does not hold the scene where it starts",
        "There is no equilibrium without friction (N701), and joints that stick where "
        "they start would need forces t with |t| > mu_s N.",
        remedy="Start without initial.state, give a spring, or more friction.",
        example={"subject": "slide"},
    ),
)
