"""Units of outputs, for axes and tables."""

from collections.abc import Callable, Iterator

from .connections import FORCES, THREAD_MULTIPLIER, force_coordinate, is_turned
from .forces import Force, PointForce
from .functions import InputFunction, Sum
from .joints import Coupling, Drive, Gear, coupled_coordinates, driven_coordinate
from .laws import Pid
from .outputs import (
    EFFORTS,
    FRICTION_QUANTITIES,
    IN_BODY,
    INPUTS,
    JOINT_QUANTITIES,
    MEASURES,
    MULTIPLIER,
    POWER,
    STATE,
    VALUE,
    OutputName,
    coordinate_of,
    is_elastic,
    is_rate,
    is_section_force,
    is_stress,
    parse_output,
)
from .tables import SceneTables

_KINDS = {"u": "m", "v": "m/s", "a": "m/s\N{SUPERSCRIPT TWO}", "w": "rad/s"}

_MOMENTA = {"momentum": "kg m/s", "angular_momentum": "kg m\N{SUPERSCRIPT TWO}/s"}
#: What a unit gets by what a drive prescribes.
_RATES = {"value": "", "rate": "/s", "acceleration": "/s\N{SUPERSCRIPT TWO}"}
#: Of what has an axis or a number behind it.
_WORDS = {**_MOMENTA, "quaternion": "", "rotation": "rad"}


def unit_of(
    name: str, scene: SceneTables | Callable[[], SceneTables | None] | None = None
) -> str:
    """Return the unit of an output; empty if it has none, or an unknown one.

    scene : or a function that returns it, called if the unit depends on it

    Quaternions, force scales, and `sticking` have none; elastic coordinates have the
    unit of their SID, states of formulas what follows from these, and `constraint` is
    the largest of lengths and angles. Without their scene the units of multipliers,
    friction and law values are not known either.

    Raises
    ------
    InputError : it is no name of an output.
    """
    parsed = parse_output(name)
    quantity = parsed.quantity.removesuffix(IN_BODY)
    if parsed.owner == "energy" and not parsed.marker:
        return "J"
    if parsed.owner == "constraint" and not parsed.marker:
        return ""
    if parsed.owner == INPUTS and not parsed.marker:
        return _input_unit(parsed.quantity, _given(scene))
    if parsed.owner in _MOMENTA and not parsed.marker:
        return _MOMENTA[parsed.owner]
    if "_" in quantity and quantity.rpartition("_")[0] in _WORDS:
        return _WORDS[quantity.rpartition("_")[0]]
    if quantity in FRICTION_QUANTITIES:
        return _friction_unit(parsed, _given(scene))
    if is_stress(quantity):
        return "Pa"
    if is_section_force(parsed):
        return "N" if quantity[0] in "NV" else "N m"
    if is_elastic(quantity):
        return ""
    if MULTIPLIER.fullmatch(quantity):
        return _multiplier_unit(parsed, _given(scene))
    if quantity in JOINT_QUANTITIES:
        return "N" if quantity[0] == "f" else "N m"
    if parsed.marker == STATE or quantity == VALUE:
        return _law_unit(parsed, _given(scene))
    if quantity in EFFORTS:
        return "N" if quantity == "force" else "N m"
    if quantity == POWER:
        return "W"
    if quantity in MEASURES:
        return _measure_unit(parsed, _given(scene))
    coordinate = coordinate_of(quantity)
    if coordinate:
        unit = "rad" if coordinate.startswith("angle") else "m"
        return f"{unit}/s" if is_rate(quantity) else unit
    return _KINDS[quantity[0]] if len(quantity) == 2 else "m"


def _given(
    scene: SceneTables | Callable[[], SceneTables | None] | None,
) -> SceneTables | None:
    return scene() if callable(scene) else scene


def _input_unit(name: str, scene: SceneTables | None) -> str:
    """Return the unit that an input states, else that of a force that it scales or of
    what it prescribes.
    """
    if scene is None or name not in scene.inputs:
        return ""
    stated = scene.inputs[name].unit
    if stated is not None:
        return stated
    return next((unit for _, unit in units_of_takers(name, scene)), "")


def units_of_takers(name: str, scene: SceneTables) -> Iterator[tuple[str, str]]:
    """Yield key and unit of each force, drive and controller that takes an input alone.

    The unit is empty of a force at a point, which the input scales.
    """
    for key, function, unit in units_of_functions(scene):
        if isinstance(function, InputFunction) and function.name == name:
            yield key, unit


def units_of_functions(scene: SceneTables) -> Iterator[tuple[str, object, str]]:
    """Yield key, function and unit of what forces, drives and controllers take.

    The unit is empty of a force at a point, which the function scales.
    """
    for owner, force in scene.forces.items():
        function = getattr(force, "function", None)
        key = f"forces.{owner}.function"
        if isinstance(function, Pid):
            yield (
                f"{key}.reference",
                function.reference,
                unit_of(function.measured, scene),
            )
        elif function is not None:
            unit = _law_unit(OutputName(owner, "", VALUE), scene)
            yield from _parts(key, function, unit)
    for owner, drive in scene.drives.items():
        along = _effort_unit(driven_coordinate(drive, scene.joints))
        unit = ("rad" if along == "N m" else "m") + _RATES[drive.of]
        yield from _parts(f"drives.{owner}.function", drive.function, unit)


def _parts(key: str, function: object, unit: str) -> Iterator[tuple[str, object, str]]:
    """A function, or the parts of a sum."""
    if isinstance(function, Sum):
        for k, part in enumerate(function.parts):
            yield f"{key}.parts[{k}]", part, unit
    else:
        yield key, function, unit


def _effort_unit(coordinate: str) -> str:
    """Return the unit of the force or torque along a coordinate."""
    return "N m" if is_turned(coordinate) else "N"


def _measure_unit(name: OutputName, scene: SceneTables | None) -> str:
    """Return the unit of a length, a deflection or a rate of a force."""
    if name.quantity == "length" or scene is None:
        return "m" if name.quantity == "length" else ""
    coordinate = force_coordinate(scene.forces[name.owner], scene)
    unit = "rad" if is_turned(coordinate) else "m"
    return f"{unit}/s" if name.quantity == "rate" else unit


def _friction_unit(name: OutputName, scene: SceneTables | None) -> str:
    if name.quantity == "normal_force":
        return "N"
    if scene is None or name.quantity == "sticking":
        return ""
    return _effort_unit(scene.joints[name.owner].coordinates[0])


def _law_unit(name: OutputName, scene: SceneTables | None) -> str:
    if scene is None:
        return ""
    force: Force | Drive | None = scene.forces.get(name.owner)
    drive = scene.drives.get(name.owner)
    if drive is not None and (force is None or drive.has_law):
        if name.quantity in drive.integrated:
            along = _effort_unit(driven_coordinate(drive, scene.joints))
            unit = "rad" if along == "N m" else "m"
            return unit if name.quantity == "value" else f"{unit}/s"
        force = drive
    function = getattr(force, "function", None)
    if name.marker != STATE:
        if isinstance(force, PointForce):
            return ""
        joint, coordinate = (getattr(force, k, None) for k in ("joint", "coordinate"))
        if joint is None:
            return "N"
        return _effort_unit(coordinate or scene.joints[joint].coordinates[0])
    if not isinstance(function, Pid):
        return ""
    unit = unit_of(function.measured, scene)
    if name.quantity == "derivative":
        return f"{unit}\N{SUPERSCRIPT TWO}" if unit.endswith("/s") else f"{unit}/s"
    return unit.removesuffix("/s") if unit.endswith("/s") else f"{unit} s"


def _multiplier_unit(name: OutputName, scene: SceneTables | None) -> str:
    """That of fK."""
    if scene is None:
        return ""
    if name.owner in scene.drives:
        return _effort_unit(driven_coordinate(scene.drives[name.owner], scene.joints))
    joint = scene.joints[name.owner]
    if isinstance(joint, Gear | Coupling):
        # The unit of the last coordinate of a gear, whose ratio converts the first; of
        # other sums only if all coordinates are of one kind.
        terms = coupled_coordinates(joint, scene.joints)
        units = [_effort_unit(coordinate) for _, coordinate, _ in terms]
        return units[-1] if isinstance(joint, Gear) or len(set(units)) == 1 else ""
    forces = FORCES[joint.type][scene.dimension == "spatial"]
    number = int(name.quantity[1:])
    is_thread = joint.type == "screw" and number == THREAD_MULTIPLIER
    return "N" if number <= forces or is_thread else "N m"
