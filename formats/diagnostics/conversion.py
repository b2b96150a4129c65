"""Diagnostics N1xx: models, their materials, and their conversion to SIDs."""

from .entry import INFO, WARNING, Entry

ENTRIES = (
    Entry(
        "N101",
        WARNING,
        "{quantity} {value:g} {unit} is outside of {least:g} to {most:g}{hint}",
        "The value is compared with the range from soft rubber to diamond (Young's "
        "modulus, 1e6 to 1.3e12 Pa) or from foam to osmium (density, 10 to 23 000 "
        "kg/m3). If the same number would be usual in another unit (GPa, MPa, kPa; "
        "g/cm3, kg/mm3, t/mm3), that unit and the converted value are given.",
        remedy="Give Pa and kg/m3.",
        example={
            "quantity": "Young's modulus",
            "value": 210.0,
            "unit": "Pa",
            "least": 1e6,
            "most": 1.3e12,
            "hint": "; in GPa it would be 2.1e+11 Pa",
        },
    ),
    Entry(
        "N103",
        WARNING,
        "implausible body: {reason}",
        "One of three numbers of the body is not that of a solid body in SI units. "
        "Size: the largest distance between nodes and centre of mass is above 150 m. "
        "Wave speed: the first frequency of (Ke, Me) times the size is above 20 000 "
        "m/s, which is faster than sound in any solid. Sag: g / omega1^2 with the "
        "first angular frequency omega1 is above the size of the body under the "
        "gravity of the scene, or above 30 sizes under 9.81 m/s2 where there is no "
        "gravity.",
        remedy="Check geometry.unit, and the units of mass and stiffness.",
        example={"subject": "arm", "reason": "sags by 83 m (270 sizes) under gravity"},
    ),
    Entry(
        "N104",
        WARNING,
        "damping De has a negative eigenvalue, {share} of the largest: it adds energy",
        "Smallest eigenvalue of the symmetric part of De over its largest absolute "
        "one, reported below -1e-9. Motion along its eigenvector is driven instead "
        "of damped.",
        remedy="Check the sign of [damping].",
        units={"share": "%"},
        example={"subject": "arm", "share": -0.02},
    ),
    Entry(
        "N107",
        WARNING,
        "the first mode ({frequency}) is overdamped, damping ratio {ratio}",
        "Damping ratio phi^T De phi / (2 omega) of the first mode phi of (Ke, Me), "
        "reported above 1. Such a mode creeps instead of vibrating. Damping of 2 per "
        "cent is a ratio of 0.02.",
        remedy="2 % of damping are ratio = 0.02.",
        units={"frequency": "Hz"},
        example={"subject": "arm", "frequency": 12.3, "ratio": 2.0},
    ),
    Entry(
        "N110",
        INFO,
        "read {elements:d} of {given:element} ({kinds}), {used:d} of {nodes:node}",
        "Counts of what the reader kept of a mesh file. Elements without a section "
        "or of lower dimension are not part of the body.",
        example={
            "elements": 144,
            "given": 150,
            "kinds": ("144 hex20",),
            "used": 1068,
            "nodes": 1068,
        },
    ),
    Entry(
        "N111",
        INFO,
        "only to name nodes: {count:element} {reason}",
        "Elements of lower dimension than the body, or without section, material or "
        "mass, name the nodes they touch. They add neither stiffness nor mass.",
        example={"count": 6, "reason": "of lower dimension"},
    ),
    Entry(
        "N112",
        INFO,
        "not needed for the body: {keywords}",
        "Keywords and cards that cannot change a linear elastic body are passed over.",
        example={"keywords": ("*STEP", "*OUTPUT")},
    ),
    Entry(
        "N113",
        WARNING,
        "left out by geometry.ignore: {keywords}",
        "The model asks for the mesh without them: masses, stiffnesses and constraints "
        "that they hold are 0 in the body.",
        remedy="Give their masses, stiffnesses and constraints in the model.",
        example={"keywords": ("*NONSTRUCTURAL MASS",)},
    ),
    Entry(
        "N114",
        INFO,
        "elements {type}: {replacement}",
        "The element type of the file has no counterpart with the same integration. "
        "The replacement is fixed for each type; N141 compares its effect with "
        "quadratic elements.",
        example={
            "type": "C3D8R",
            "replacement": "reduced integration is replaced by incompatible modes",
        },
    ),
    Entry(
        "N116",
        INFO,
        "{key} replaces {replaced} of the mesh file",
        "Both files give the value; that of the model file is used.",
        example={"key": "geometry.thickness", "replaced": "0.01, 0.02"},
    ),
    Entry(
        "N117",
        INFO,
        "material {name} of the file: {properties}",
        "Materials of the mesh file in SI units, after geometry.unit and WTMASS.",
        example={
            "name": "STEEL",
            "properties": "E = 2.1e+11 Pa, nu = 0.3, density = 7850 kg/m^3",
        },
    ),
    Entry(
        "N118",
        INFO,
        "{what}",
        "Numbers or names of several instances collide; an offset or another name "
        "makes them unique. Use these in the model file.",
        example={"what": "instance A-1: 1000 is added to its node numbers"},
    ),
    Entry(
        "N119",
        WARNING,
        "{what} left out: not of this part",
        "The model takes one part or instance of the deck (geometry.part). What "
        "connects it to others is dropped, so that it has 0 stiffness in the body.",
        remedy="Add a marker where other parts held it.",
        example={"what": "*TIE WELD (line 120)"},
    ),
    Entry(
        "N120",
        WARNING,
        "{place}: {what}",
        "The reader follows CalculiX where manuals of the deck are silent. Values "
        "beyond those that are needed, such as node 9 of a line of a C3D8, are not "
        "used.",
        remedy="Check the lines.",
        example={
            "place": "*NFILL (line 12)",
            "what": "2 nodes of the longer set have no partner",
        },
    ),
    Entry(
        "N121",
        INFO,
        "materials without a density have {density:g} kg/m^3",
        "geometry.density completes materials of the file; E and nu stay.",
        example={"density": 7850.0},
    ),
    Entry(
        "N122",
        INFO,
        "{nodes:node} tied to {faces:face}, at most {gap} apart",
        "Each slave node is projected on the master faces within the tolerance of "
        "the tie.",
        units={"gap": "m"},
        example={"subject": "tie WELD", "nodes": 25, "faces": 16, "gap": 1e-6},
    ),
    Entry(
        "N123",
        INFO,
        "lies on {master}: tied weakly (mortar method)",
        "A side of one patch covers a side of another, or a part of it, with other "
        "knots, degrees or control points. Displacements are equal in the mean over "
        "the side, not point by point.",
        example={"subject": "flange.left", "master": "web.right"},
    ),
    Entry(
        "N124",
        WARNING,
        "free, as not above the faces of the tie: {count:node}",
        "Slave nodes without a projection on the master faces within the tolerance; "
        "their number is above 0.",
        remedy="Raise POSITION TOLERANCE, or correct the surfaces.",
        example={"subject": "tie WELD", "count": 3},
    ),
    Entry(
        "N125",
        INFO,
        "{property}",
        "Properties of the bar and shell elements that differ from those of Nastran. "
        "They do not depend on the deck.",
        example={"property": "bars have the consistent mass of their sections"},
    ),
    Entry(
        "N126",
        WARNING,
        "consistent mass matrix: the inertia of twisted sections (Oe m1) is unreliable",
        "A consistent mass matrix of nodes that rotate does not separate the rotary "
        "inertia of sections from the inertia of their line. Of Euler-Bernoulli "
        "beams 20 % of Oe m1 of torsion is found on fine meshes, and wrong signs on "
        "coarse ones.",
        remedy='Use a lumped mass matrix, or geometry.type = "beam".',
        example={},
    ),
    Entry(
        "N127",
        INFO,
        "CalculiX expands {elements:element} into {kinds} with {nodes:node}",
        "CalculiX turns shells and beams into solids. Kinds and nodes are counted in "
        "the files that it writes.",
        example={"elements": 100, "kinds": ("100 hex20",), "nodes": 833},
    ),
    Entry(
        "N128",
        WARNING,
        "CalculiX warns: {warning}",
        "Text after *WARNING in the output of CalculiX; equal texts count as 1. "
        "sidtool does not judge it.",
        remedy="See the manual of CalculiX.",
        example={"warning": "no linear elastic material"},
    ),
    Entry(
        "N129",
        WARNING,
        "{limit}",
        "What elements of the deck cannot do in this body; the number of nodes or bars "
        "concerned is above 0.",
        remedy="{remedy}",
        example={
            "limit": "springs add no geometric stiffness",
            "remedy": "Use beams where these loads pass.",
        },
    ),
    Entry(
        "N130",
        WARNING,
        "sets with undefined members cannot be used: {sets}",
        "A set names a node or element that the file does not define (1 of each is "
        "given).",
        remedy="Correct the sets if you need them.",
        example={"sets": ("TOP (node 9999)",)},
    ),
    Entry(
        "N132",
        INFO,
        "own shells, bars and springs instead of those of CalculiX: {reason}",
        "The deck has what CalculiX does not have, or edges that CalculiX joins by "
        "rigid knots as large as the sections are thick. Or its solids would take "
        "minutes, which geometry.order accepts. Or CalculiX is not installed.",
        example={"reason": "edges where its shells meet"},
    ),
    Entry(
        "N133",
        INFO,
        "{count:equation} of the file for {nodes:node}",
        "Linear constraints of the deck between displacements of nodes.",
        example={"count": 12, "nodes": 4},
    ),
    Entry(
        "N134",
        INFO,
        "{elements:d} of {given:element}, {couplings:coupling}, {masses:point mass}",
        "What geometry.part selects of the mesh, with all nodes of these elements.",
        example={
            "subject": "part arm",
            "elements": 120,
            "given": 400,
            "couplings": 2,
            "masses": 1,
        },
    ),
    Entry(
        "N135",
        INFO,
        "{keywords} at nodes are included",
        "Point masses and rotary inertias of the deck.",
        example={"keywords": ("*MASS",)},
    ),
    Entry(
        "N136",
        INFO,
        "is at {position}, {gap} from the mean of its {count:node} ({reason})",
        "Distance of the marker from the mean of the tied nodes, reported above 1e-6 "
        "of their extent. Forces at the marker then cause moments on the nodes.",
        remedy="{remedy}",
        units={"gap": "m"},
        example={
            "subject": "marker pin",
            "position": "(0, 0, 0.01) m",
            "gap": 0.002,
            "count": 24,
            "reason": "as given",
            "remedy": 'markers.pin.at = "axis" puts it on the axis of the cylinder.',
        },
    ),
    Entry(
        "N137",
        INFO,
        "its nodes span no face or edge: each has the same weight",
        "A distributing tie weighs nodes by the faces or edges that they span; these "
        "nodes span none.",
        example={"subject": "marker pin"},
    ),
    Entry(
        "N138",
        WARNING,
        "no load on {idle:d} of its {count:node}, beside the faces of the others",
        "Weight 0 of nodes in a distributing tie whose faces or edges are not "
        "complete.",
        remedy="Name complete faces or edges.",
        example={"subject": "marker pin", "idle": 2, "count": 24},
    ),
    Entry(
        "N139",
        INFO,
        "nodes in the middle of straight edges raise the elements: {kinds}",
        "geometry.order = 2 adds midside nodes to linear elements for CalculiX.",
        example={"kinds": ("S3 to S6",)},
    ),
    Entry(
        "N140",
        WARNING,
        "f1 to f{count:d} of {kinds} differ from {better} by up to {difference:+.2g}",
        "Frequencies of the free body with the elements of the mesh and with better "
        "ones on the same mesh; reported above 1 %. The reference is "
        "a second computation with CalculiX.",
        remedy="Set {remedy}.",
        units={"difference": "%"},
        example={
            "kinds": "S4R",
            "better": "S8R",
            "count": 3,
            "difference": 0.35,
            "own": (82.231, 139.82, 226.86),
            "remedy": "geometry.order = 2",
        },
    ),
    Entry(
        "N141",
        WARNING,
        "f1 to f{count:d} of {kinds} elements are {sense} by up to {difference:.2g}",
        "Frequencies of the free body over those of the same mesh with better "
        "elements; reported above 1 %. Linear elements without incompatible modes bend "
        "too stiffly where few of them span a thickness.",
        remedy="Use {better}, or a finer mesh.",
        units={"difference": "%"},
        example={
            "kinds": "hex8",
            "count": 3,
            "sense": "too stiff",
            "difference": 0.36,
            "own": (82.231, 139.82, 226.86),
            "better": "incompatible modes",
        },
    ),
    Entry(
        "N142",
        WARNING,
        "{kinds} elements may be too stiff; no comparison: {reason}",
        "Linear elements are compared with better ones on the same mesh, if that has "
        "at most 60 000 degrees of freedom or 3 times those of the body and its "
        "constraints allow it.",
        remedy="Use {better} elements.",
        example={
            "kinds": "hex8",
            "reason": "better ones have 210000 unknowns",
            "better": "quadratic",
        },
    ),
    Entry(
        "N145",
        WARNING,
        "has no effect: {reason}",
        "A key of the model file that changes 0 numbers of this body.",
        remedy="Remove it, or correct what it depends on.",
        example={
            "subject": "geometry.density",
            "reason": "all materials of the file have a density",
        },
    ),
    Entry(
        "N146",
        WARNING,
        "{count:point mass} below zero, together {total}",
        "Point masses of the mesh file (CONM2, CMASS2, *MASS, MASS21) are added with "
        "their sign. The mass matrix stays that of a body as long as elements have "
        "more mass at these nodes.",
        remedy="Check the signs of the point masses.",
        units={"total": "kg"},
        example={"count": 1, "total": -0.2},
    ),
    Entry(
        "N147",
        WARNING,
        "nothing resists rotation about {axes} at markers {markers}",
        "No element at the node of the marker has stiffness or inertia about this axis "
        "of the model, or imported matrices have no such degree of freedom there, so "
        "psi = 0 about it. The marker turns about it with the body "
        "frame. A joint that holds this rotation, or a moment about it, acts on the "
        "body frame: displacements and section forces are then wrong.",
        remedy="Use joints that leave it free, or tie the marker to several nodes.",
        example={"axes": ("z",), "markers": ("a",)},
    ),
    Entry(
        "N150",
        WARNING,
        "the mesh differs from its geometry: mass {mass:+.3g}, centre {centre:.3g} m "
        "away",
        "Mass and centre of mass of the elements against those of the exact geometry, "
        "reported above 0.1 % (of the mass, and of the size for the centre).",
        remedy="Use more elements.",
        units={"mass": "%"},
        example={"mass": -0.012, "centre": 2e-4},
    ),
    Entry(
        "N155",
        INFO,
        "{found:d} instead of {requested:d}: inner knots of the geometry stay",
        "k-refinement keeps the inner knots of the geometry and divides each span "
        "equally.",
        example={
            "subject": "discretisation.functions[0]",
            "found": 12,
            "requested": 10,
        },
    ),
    Entry(
        "N160",
        INFO,
        "errors of the basis: {compliance:.2g} of the compliance, {relevant:.2g} of "
        "{frequencies}{rest}",
        "Largest relative error of the frequencies of the reduced body, and of its "
        "static compliance at the interfaces under unit loads, "
        "against the full model. The last frequencies of a basis with static shapes "
        "always have errors: shape functions beyond the requested number of modes "
        "(else the lower half) represent these shapes, not natural modes. A better "
        "method is named if one of these errors is above 1 %.",
        remedy="{remedy}",
        units={"relevant": "%", "frequency": "%", "compliance": "%"},
        example={
            "frequencies": "f1 to f4",
            "relevant": 2e-4,
            "rest": ", 47 % of f8",
            "count": 8,
            "frequency": 0.47,
            "compliance": 1e-3,
            "load": "pin x",
            "remedy": "",
        },
    ),
    Entry(
        "N161",
        WARNING,
        "errors of the basis: {compliance:.2g} of the compliance at {load}, "
        "{relevant:.2g} of {frequencies}{rest}",
        "As N160. Reported if a frequency up to the requested number of modes (else "
        "the lower half), or a compliance at the interfaces, has an error above 1 %. "
        "Other reduction methods are tried with the same load cases.",
        remedy="{remedy}",
        units={"relevant": "%", "frequency": "%", "compliance": "%"},
        example={
            "frequencies": "f1 to f5",
            "relevant": 0.02,
            "rest": "",
            "number": 5,
            "frequency": 0.02,
            "compliance": 0.16,
            "load": "pin x",
            "remedy": "Better: attachment with 5 modes, 10 functions: 0.001 %.",
        },
    ),
    Entry(
        "N162",
        WARNING,
        "held at {marker} its first frequency is {own:.5g} Hz instead of {full:.5g} Hz",
        "Modes of the free body do not represent the body that a joint holds at the "
        "marker of its frame. Both frequencies are of the reduced and of the full "
        "model held there; reported above 1 %.",
        remedy='Set reduction.fix = "{marker}", or Craig-Bampton with {marker}.',
        example={"marker": "hub", "own": 12.4, "full": 10.9},
    ),
    Entry(
        "N163",
        WARNING,
        "single point of a {kind}: the displacement under a force diverges",
        "The exact displacement of an elastic continuum under a point force is "
        "infinite. On a mesh it grows with the logarithm of the "
        "element size in the plane (Flamant), with its reciprocal in space "
        "(Boussinesq).",
        remedy="Tie markers to an edge, a face or a set (markers.NAME.tie).",
        example={
            "subject": "end, corner",
            "kind": "solid",
            "growth": "with the reciprocal of the element size",
        },
    ),
    Entry(
        "N164",
        INFO,
        "left out, as they follow from others: {omitted:d} of {count:shape function}",
        "Candidates that depend linearly on the others and on the rigid motion.",
        example={"omitted": 3, "count": 11, "names": ("pin z",)},
    ),
    Entry(
        "N165",
        WARNING,
        "errors of the basis cannot be measured: {reason}",
        "The comparison with the full model failed; the errors of frequencies and "
        "compliances (see N160) are not known.",
        remedy="Compare with another number of modes.",
        example={"reason": "rounding hides its mass matrix"},
    ),
    Entry(
        "N166",
        WARNING,
        "stress by rotation about {axes}: {missing:.2g} of its energy is missing",
        "Share of the strain energy under the loads of a steady rotation that the "
        "shape functions lack. Stress is that of the shape functions: a bar that turns "
        "about one end has 2/3 of its largest stress by one linear shape function, "
        "where 17 % of the energy is missing, and none by bending modes. Reported "
        "above 1 % for models with [stress] and [stiffening].",
        remedy="Use attachment modes with centrifugal = true.",
        units={"missing": "%"},
        example={"axes": ("y", "z"), "missing": 0.17},
    ),
    Entry(
        "N170",
        WARNING,
        "peak_points = 0: peak_von_mises is the largest stress of the markers only",
        "Without peak points the stress is known at 0 points of the surface besides "
        "the markers.",
        remedy="Leave peak_points out to find the points with 99 % of the peak.",
        example={},
    ),
    Entry(
        "N171",
        INFO,
        "no stress at {markers}: tied to node sets",
        "Stress belongs to a point of the material; the marker of a tie is none.",
        example={"markers": ("pin",)},
    ),
    Entry(
        "N173",
        WARNING,
        "not in an ASCII file: {count:section} for section forces",
        "A SID in ASCII holds the blocks of Wallrapp's format only. The mass integrals "
        "of the parts of a body beyond its sections are in HDF5 files, and in the SIDs "
        "of bodies that a scene names by `model`.",
        remedy="Write a file that ends in .h5.",
        example={"subject": "blade.SID_FEM", "count": 11},
    ),
    Entry(
        "N172",
        WARNING,
        "superelement too stiff: no static motions of {interfaces} among the shapes",
        "The static stiffness between interfaces is exact if the shape functions "
        "contain the static response to displacements and rotations of each interface, "
        "or to forces and moments there. Reported for interfaces that are not in "
        "`reduction.interfaces`, for rotations = false, and for SIDs whose labels are "
        "all natural modes. Natural modes make the static stiffness too large.",
        remedy='Use method = "craig_bampton" with these interfaces.',
        example={"interfaces": ("a", "b")},
    ),
)
