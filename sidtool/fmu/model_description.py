"""modelDescription.xml of both versions of FMI."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.etree import ElementTree as xml

#: Base units of derived ones, by the attributes of <BaseUnit>.
_BASE_UNITS: dict[str, dict[str, int]] = {
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "K": {"K": 1},
    "A": {"A": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "Hz": {"s": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
#: Names of variables that the structured naming convention of FMI allows.
_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
TIME = "time"
FIRST_VARIABLE = 1
#: Abilities of a unit, by version; and of a linearised one, for model exchange.
_ABILITIES = {
    "2.0": {
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    },
    "3.0": {
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "hasEventMode": "true",
    },
}
_EXCHANGE_ABILITIES = {
    "2.0": {
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
        "providesDirectionalDerivative": "true",
    },
    "3.0": {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    },
}


@dataclass(frozen=True)
class Variable:
    """An input or an output, or a state of a linearised mechanism or its rate.

    Attributes
    ----------
    unit : as sidtool writes it, such as N m/rad; empty for none
    start : value before it is set, of an input or a state
    is_state : of a linearised mechanism
    rate_of : number of the state that it is the rate of
    nominal : size of a state
    """

    name: str
    unit: str
    description: str = ""
    start: float | None = None
    is_state: bool = False
    rate_of: int | None = None
    nominal: float | None = None

    @property
    def causality(self) -> str:
        if self.is_state or self.rate_of is not None:
            return "local"
        return "output" if self.start is None else "input"

    @property
    def initial(self) -> str:
        """Where the start value is from: exact for given ones, none for inputs."""
        if self.causality == "input":
            return ""
        return "exact" if self.is_state else "calculated"


@dataclass(frozen=True)
class UnitDescription:
    """What the description of a unit says.

    Attributes
    ----------
    identifier : a name of C, that of the library
    token : identifies the library of one export
    variables : numbered from 1 on in this order: inputs, outputs; inputs, states,
        outputs, rates of a linearised mechanism, which is for model exchange, too
    step : output step of the scene [s], or its fixed step
    """

    title: str
    identifier: str
    token: str
    tool: str
    variables: tuple[Variable, ...]
    start: float
    end: float
    step: float
    tolerance: float
    is_linear: bool = False


def model_description(unit: UnitDescription, version: str) -> str:
    """The text of modelDescription.xml for version "2.0" or "3.0" of FMI."""
    names = [variable.name for variable in unit.variables]
    structured = all(_STRUCTURED.fullmatch(name) for name in names)
    token = {"2.0": "guid", "3.0": "instantiationToken"}[version]
    root = xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": version,
            "modelName": unit.title or unit.identifier,
            token: unit.token,
            "generationTool": unit.tool,
            "variableNamingConvention": "structured" if structured else "flat",
        },
    )
    name = {"modelIdentifier": unit.identifier}
    if unit.is_linear:
        xml.SubElement(root, "ModelExchange", name | _EXCHANGE_ABILITIES[version])
        if version == "2.0":
            root.set("numberOfEventIndicators", "0")
    xml.SubElement(root, "CoSimulation", name | _ABILITIES[version])
    _add_units(root, (TIME_VARIABLE, *unit.variables))
    _add_log_categories(root, version)
    experiment = {"startTime": unit.start, "stopTime": unit.end}
    experiment |= {"tolerance": unit.tolerance, "stepSize": unit.step}
    xml.SubElement(
        root,
        "DefaultExperiment",
        {name: repr(float(x)) for name, x in experiment.items()},
    )
    {"2.0": _add_variables_2, "3.0": _add_variables_3}[version](root, unit.variables)
    xml.indent(root)
    text = xml.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


TIME_VARIABLE = Variable(TIME, "s", "simulated time")


def _add_log_categories(root: xml.Element, version: str) -> None:
    categories = xml.SubElement(root, "LogCategories")
    for name in ("logStatusWarning", "logStatusDiscard", "logStatusError"):
        xml.SubElement(categories, "Category", {"name": name})


def _numbered(variables: Iterable[Variable]) -> Iterator[tuple[int, Variable]]:
    return enumerate(variables, FIRST_VARIABLE)


def _attributes(number: int, variable: Variable) -> dict[str, str]:
    attributes = {"name": variable.name, "valueReference": str(number)}
    if variable.description:
        attributes["description"] = variable.description
    return attributes


def _type_attributes(variable: Variable) -> dict[str, str]:
    attributes = {}
    if variable.start is not None:
        attributes["start"] = repr(float(variable.start))
    if variable.unit:
        attributes["unit"] = unit_name(variable.unit)
    if variable.nominal is not None:
        attributes["nominal"] = repr(variable.nominal)
    return attributes


def _roles(variable: Variable) -> dict[str, str]:
    attributes = {"causality": variable.causality, "variability": "continuous"}
    return attributes | ({"initial": variable.initial} if variable.initial else {})


def _unknowns(variables: tuple[Variable, ...], kind: str) -> list[int]:
    """Numbers of the outputs, of the rates, or of both."""
    return [
        number
        for number, variable in _numbered(variables)
        if (variable.causality == "output" and kind != "rates")
        or (variable.rate_of is not None and kind != "outputs")
    ]


def _add_variables_2(root: xml.Element, variables: tuple[Variable, ...]) -> None:
    listed = xml.SubElement(root, "ModelVariables")
    time = _attributes(0, TIME_VARIABLE)
    time |= {"causality": "independent", "variability": "continuous"}
    entry = xml.SubElement(listed, "ScalarVariable", time)
    xml.SubElement(entry, "Real", _type_attributes(TIME_VARIABLE))
    for number, variable in _numbered(variables):
        attributes = _attributes(number, variable) | _roles(variable)
        entry = xml.SubElement(listed, "ScalarVariable", attributes)
        real = _type_attributes(variable)
        if variable.rate_of is not None:  # the time is the first variable
            real["derivative"] = str(variable.rate_of + 1)
        xml.SubElement(entry, "Real", real)
    structure = xml.SubElement(root, "ModelStructure")
    parts = {"Outputs": "outputs", "Derivatives": "rates", "InitialUnknowns": "both"}
    for part, kind in parts.items():
        numbers = _unknowns(variables, kind)
        if numbers:
            group = xml.SubElement(structure, part)
            for number in numbers:
                xml.SubElement(group, "Unknown", {"index": str(number + 1)})


def _add_variables_3(root: xml.Element, variables: tuple[Variable, ...]) -> None:
    listed = xml.SubElement(root, "ModelVariables")
    time = _attributes(0, TIME_VARIABLE) | _type_attributes(TIME_VARIABLE)
    time |= {"causality": "independent", "variability": "continuous"}
    xml.SubElement(listed, "Float64", time)
    for number, variable in _numbered(variables):
        attributes = _attributes(number, variable) | _type_attributes(variable)
        attributes |= _roles(variable)
        if variable.rate_of is not None:
            attributes["derivative"] = str(variable.rate_of)
        xml.SubElement(listed, "Float64", attributes)
    structure = xml.SubElement(root, "ModelStructure")
    parts = {
        "Output": "outputs",
        "ContinuousStateDerivative": "rates",
        "InitialUnknown": "both",
    }
    for part, kind in parts.items():
        for number in _unknowns(variables, kind):
            xml.SubElement(structure, part, {"valueReference": str(number)})


def _add_units(root: xml.Element, variables: Iterable[Variable]) -> None:
    units = dict.fromkeys(v.unit for v in variables if v.unit)
    definitions = xml.SubElement(root, "UnitDefinitions")
    for unit in units:
        entry = xml.SubElement(definitions, "Unit", {"name": unit_name(unit)})
        base = base_units(unit)
        if base is not None:
            exponents = {name: str(k) for name, k in base.items() if k}
            xml.SubElement(entry, "BaseUnit", exponents)


def unit_name(unit: str) -> str:
    """A unit as tools of FMI write it: N.m, m/s2."""
    for character, digit in zip("\u00b2\u00b3", "23", strict=True):
        unit = unit.replace(character, digit)
    return ".".join(unit.replace("^", "").replace("*", " ").split())


def base_units(unit: str) -> dict[str, int] | None:
    """Exponents of the base units, None for a unit that is not known."""
    exponents: dict[str, int] = {}
    numerator, *denominators = unit_name(unit).split("/")
    for sign, part in ((1, numerator), *((-1, text) for text in denominators)):
        for factor in part.strip("()").split("."):
            match = re.fullmatch(r"([A-Za-z]+)(-?\d*)", factor)
            if factor == "1":
                continue
            if match is None or match[1] not in _BASE_UNITS:
                return None
            power = sign * int(match[2] or 1)
            for name, k in _BASE_UNITS[match[1]].items():
                exponents[name] = exponents.get(name, 0) + power * k
    return exponents
