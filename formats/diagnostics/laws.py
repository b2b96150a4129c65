"""Diagnostics N5xx: friction, force laws and control laws."""

from .entry import INFO, WARNING, Entry

ENTRIES = (
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
)
