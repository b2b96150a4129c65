"""Diagnostics N6xx: a requested accuracy and what its errors do not include."""

from .entry import ERROR, INFO, WARNING, Entry

ENTRIES = (
    Entry(
        "N603",
        INFO,
        "errors do not include {what}: {reason}",
        "Errors are differences to the finest model that can be run. What that model "
        "has in common with the chosen one is not in these differences: the mesh and "
        "the shape functions that a SID does not have, a mesh that cannot be refined, "
        "a body frame that the scene refers to, printed digits with which no other "
        "run is possible.",
        remedy="{remedy}",
        example={
            "subject": "rod",
            "what": "mesh and missing shape functions",
            "reason": "only a SID is given",
            "remedy": "Give its model.",
        },
    ),
    Entry(
        "N604",
        WARNING,
        "mesh error of {amount} in {output} hardly falls in {halvings:refinement}",
        "The last change of the output by halved elements is more than 3/4 of the one "
        "before it, and the remaining error is above 0.1 of what is allowed. A body of "
        "solid or plane elements yields without limit under a force at a point, as "
        "elements become smaller.",
        remedy="{remedy}",
        units={"share": "%"},
        example={
            "subject": "rod",
            "amount": "5e-07 m",
            "output": "piston.x",
            "halvings": 3,
            "share": 0.2,
            "remedy": "Tie the marker to an edge or face.",
        },
    ),
    Entry(
        "N605",
        WARNING,
        "geometric stiffness of {ratio} is neither in its SID nor in the errors",
        "Largest |eigenvalue| of (K_geo, Ke) in the finest run: above 0.1 % and above "
        "the wanted relative error, below 1 % (from there on see N404). Runs with and "
        "without cannot be compared, as the SID has the softening by rotation only.",
        remedy="Convert with [stiffening].",
        units={"ratio": "%"},
        example={"subject": "rod", "ratio": 0.004},
    ),
    Entry(
        "N606",
        WARNING,
        "its missing geometric stiffness ({ratio}) would change {output} by {amount}",
        "The model is converted again with a table [stiffening], and one more run is "
        "compared with the finest one. The change is above the allowed error, and no "
        "part of the errors. A request is refused where it also changes an output by "
        "0.01 of its variation and the stiffness by more than 25 %.",
        remedy="Give it [stiffening].",
        units={"ratio": "%", "share": "%"},
        example={
            "subject": "arm",
            "ratio": 0.12,
            "output": "arm.tip.x",
            "amount": "2e-05 m",
            "share": 1.4,
        },
    ),
    Entry(
        "N608",
        INFO,
        "computed in the frame of {frames}; that changes {output} by {amount}",
        "Each flexible body is run in the frames at its loaded nodes, in their chord "
        "and in mean axes. The one in which it deforms least is used if that changes "
        "outputs by 0.1 to 0.5 of what is allowed. Positions and displacements of the "
        "body that are not recorded are those in this frame.",
        example={
            "subject": "rod",
            "frames": ("chord:1,2",),
            "output": "rod.q1",
            "amount": "2e-08",
        },
    ),
    Entry(
        "N609",
        WARNING,
        "error of linear theory about {amount}, {ratio} times what is wanted",
        "2 or 3 times the change of the output in another body frame, which is "
        "of the order of the terms that linear theory neglects. It is no part of the "
        "error of the outputs; see the column theory. Reported for the worst output.",
        remedy="Convert with [stiffening], or cut bodies into parts.",
        example={
            "subject": "rod.q3",
            "amount": "1.1e-07",
            "ratio": 80.0,
            "count": 2,
        },
    ),
    Entry(
        "N611",
        INFO,
        "rounding of its SID file ({digits}) changes {output} by {amount}",
        "Three runs with each number of the file moved by half a unit of its last "
        "digit, up or down by a hash of its digits; three times the largest change. "
        "It is part of the error. Reported unless it is far below what is allowed.",
        units={"share": "%"},
        example={
            "subject": "rod",
            "digits": "6 digits",
            "output": "piston.x",
            "amount": "2e-08 m",
            "share": 0.1,
        },
    ),
    Entry(
        "N612",
        INFO,
        "mesh error of {amount} in {output} after {halvings:refinement}",
        "Elements are halved until the remaining error is below 0.1 of what is "
        "allowed, at most 3 times. It is the sum of the geometric series of the last "
        "two changes, at least half of the last one. It is part of the error.",
        units={"share": "%"},
        example={
            "subject": "rod",
            "amount": "5e-08 m",
            "output": "piston.x",
            "halvings": 2,
            "share": 0.05,
        },
    ),
    Entry(
        "N613",
        INFO,
        "{first} to {last} modes: the last change is {amount} in {output}",
        "Modes are doubled until an output changes by less than 0.1 of what is "
        "allowed, at most 3 times. The last change is part of the error, as the "
        "following ones are not known.",
        units={"share": "%"},
        example={
            "subject": "rod",
            "first": 4,
            "last": 8,
            "amount": "5e-08 m",
            "output": "piston.x",
            "share": 0.05,
        },
    ),
    Entry(
        "N615",
        INFO,
        "no error is given: {reason}",
        "An output has no error if it varies by rounding only (below 1e-12 of its "
        "values or 1e-9 of the largest output of its unit), if it is no quantity "
        "(drift, a flag of sticking), if it belongs to shape functions or frames that "
        "differ between the models, or if the chosen model does not have it.",
        example={"subject": "rod.y", "reason": "it varies by rounding only"},
    ),
    Entry(
        "N616",
        INFO,
        "choices were compared on the first {part} of {span}, the result on all of it",
        "Each choice needs a run. In long scenes they are compared on the shortest "
        "first part that shows 0.7 of the variation of each output. The chosen model "
        "is then compared with the reference over the whole span; this is the error.",
        units={"part": "s", "span": "s"},
        example={"part": 0.5, "span": 20.0},
    ),
    Entry(
        "N617",
        ERROR,
        "the wanted accuracy cannot be reached: {reason}",
        "A measured limit: two integrators at the tightest tolerance differ by more "
        "than 0.05 of what is allowed, printed digits or meshes use more than 0.5 of "
        "it, no output varies by more than rounding, no integrator keeps it, or runs "
        "that are tight enough would take too long. Nothing is run with less.",
        remedy="Ask for a larger error or other outputs.",
        example={"reason": "no integrator keeps it"},
    ),
    Entry(
        "N618",
        INFO,
        "runs take {seconds}: few were made, and terms of the model not compared",
        "The scene is long, and no first part of it shows what the rest needs. Looser "
        "runs of the full model, and two with the modes of least elastic energy left "
        "out, are compared with a tight one.",
        units={"seconds": "s"},
        example={"seconds": 12.0, "omitted": ("modes 3, 4 of rod",)},
    ),
)
