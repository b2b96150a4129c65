"""The generated header of a unit: structures of the tables, image, inputs, outputs.

The content of a table, with all that it refers to, as constant data.

The image is a sequence of 64-bit words. Words that are addresses are zero in it; the
relocations give what they point to: to another word of the image, or to a kernel. An
instance is a copy of the image with its addresses filled in.
"""

import ctypes
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidtool.solver.compiler.arrays import PointerType, ViewType
from sidtool.solver.compiler.kernels import Entry
from sidtool.solver.compiler.records import RowsType
from sidtool.solver.compiler.tables import ALIGNMENT, Table, TableType
from sidtool.solver.compiler.types import float64, int64, void
from sidtool.solver.dynamics import control_laws
from sidtool.solver.functions.piecewise import N_INPUT_TERMS
from sidtool.solver.integrators import loop_state, newton_iteration
from sidtool.solver.output.events import VALUE_TOLERANCE
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system.sensors import SAMPLE_TOLERANCE

from .linking import PREFIX, called_kernels
from .plant_table import (
    ORIENTATION,
    PLANT,
    ROOT,
    OutputTerms,
    PlantTables,
    ending_events,
)

WORD = 8
#: Fields of `Lapack`, as routines of LAPACK.
_LAPACK = {"factor": "getrf", "solve": "getrs"}
#: How names of LAPACK begin, by the tables of factors.
_PRECISION = {"Factors": "d", "ComplexFactors": "z"}

#: Communication points are compared with this tolerance, relative to 1 s and the time.
TIME_TOLERANCE = 1e-9
CODES = (
    "INTERVAL_END",
    "STEPS_DONE",
    "TOO_SMALL",
    "OFF_CONSTRAINTS",
    "NOT_FINITE",
    "NO_CONVERGENCE",
    "BELOW_ROUNDING",
    "NEAR_SINGULARITY",
)


@dataclass(frozen=True, eq=False)
class MemoryImage:
    """Words of the image, and what its addresses point to.

    Attributes
    ----------
    words : (n,) int64
    pointers : (word, word that it points to)
    kernels : (word, symbol of the kernel that it points to)
    """

    words: np.ndarray
    pointers: tuple[tuple[int, int], ...]
    kernels: tuple[tuple[int, str], ...]
    _places: tuple[tuple[int, int, int], ...]

    def word_of(self, array: np.ndarray, index: int = 0) -> int:
        """Word of an entry of an array, which is counted in full rows."""
        address = array.__array_interface__["data"][0] + WORD * index
        return _offset(self._places, address) // WORD


def memory_image(table: Table) -> MemoryImage:
    """The image of a table, which is at its begin."""
    walk = _Walk()
    walk.add_table(table, type(table).kind)
    return walk.image()


@dataclass(eq=False)
class _Walk:
    """Memory in the order in which tables refer to it.

    That order, unlike the order of addresses, is the same in each process.
    """

    spans: list[tuple[int, int]] = field(default_factory=list)
    pointers: dict[int, int] = field(default_factory=dict)
    kernels: dict[int, str] = field(default_factory=dict)
    empty: list[int] = field(default_factory=list)
    seen: set[int] = field(default_factory=set)
    kept: list[Any] = field(default_factory=list)

    def add_table(self, table: Any, kind: TableType, precision: str = "") -> None:
        """Add a table and what it refers to."""
        if table.address in self.seen:
            return
        self.seen.add(table.address)
        self.kept.append(table)
        self.spans.append((table.address, WORD * kind.words))
        precision = _PRECISION.get(kind.owner.__name__, precision)
        for name, member in kind.members.items():
            if name not in kind.scalars:
                word = table.address + WORD * kind.offsets[name]
                self._add_member(word, name, getattr(table, name), member, precision)

    def _add_member(
        self, word: int, name: str, value: Any, member: Any, precision: str
    ) -> None:
        if isinstance(member, TableType):
            if value is None:
                self.empty.append(word)
                return
            self.pointers[word] = value.address
            self.add_table(value, member, precision)
        elif isinstance(member, PointerType):
            if not value.address:
                self.empty.append(word)
                return
            symbol = precision + _LAPACK[name] if name in _LAPACK else name
            self.kernels[word] = PREFIX + symbol
        elif isinstance(member, ViewType | RowsType):
            if not value.nbytes:
                self.empty.append(word)
                return
            address = int(value.__array_interface__["data"][0])
            self.pointers[word] = address
            self.spans.append((address, value.nbytes))
            self.kept.append(value)
        else:
            raise TypeError(f"a field {name} of {member}")

    def image(self) -> MemoryImage:
        """The image of all that was added."""
        content, places = bytearray(), []
        for begin, end in self._merged_spans():
            content += bytes(-len(content) % ALIGNMENT)
            places.append((begin, end, len(content)))
            content += ctypes.string_at(begin, end - begin)
        content += bytes(-len(content) % ALIGNMENT)
        words = np.frombuffer(bytes(content), np.int64).copy()
        known = tuple(places)

        def word(address: int) -> int:
            return _offset(known, address) // WORD

        for address in (*self.pointers, *self.kernels, *self.empty):
            words[word(address)] = 0
        pointers = sorted((word(a), word(b)) for a, b in self.pointers.items())
        kernels = sorted((word(a), symbol) for a, symbol in self.kernels.items())
        return MemoryImage(words, tuple(pointers), tuple(kernels), known)

    def _merged_spans(self) -> list[tuple[int, int]]:
        """Begin and end of memory, overlapping parts as one, in order of the walk."""
        order: dict[int, int] = {}
        for k, (begin, _) in enumerate(self.spans):
            order.setdefault(begin, k)
        merged: list[list[int]] = []
        for begin, size in sorted(self.spans):
            if merged and begin < merged[-1][1]:
                merged[-1][1] = max(merged[-1][1], begin + size)
                merged[-1][2] = min(merged[-1][2], order[begin])
            else:
                merged.append([begin, begin + size, order[begin]])
        return [(a, b) for a, b, _ in sorted(merged, key=lambda part: part[2])]


def _offset(places: tuple[tuple[int, int, int], ...], address: int) -> int:
    """Where an address lies in the image [bytes]."""
    for begin, end, start in places:
        if begin <= address < end:
            return start + address - begin
    raise LookupError(f"an address that is not in the image: {address}")


def scene_header(
    tables: PlantTables,
    inputs: Sequence[str],
    outputs: Sequence[OutputTerms],
    events: Sequence[OutputTerms] = (),
) -> str:
    """The text of scene.h.

    Parameters
    ----------
    events : quantities of `ending_events`
    """
    image = memory_image(tables.plant)
    system, settings = tables.system, tables.start.settings
    kernels = called_kernels(system.planar, settings.integrator)
    constants = {name: getattr(loop_state, name) for name in CODES}
    constants["FREQUENT_FAILURES"] = newton_iteration.FREQUENT_FAILURES
    constants["FAILED_LAW"] = control_laws.FAILED_LAW
    constants["FAILURE_TIME"] = control_laws.FAILURE_TIME
    constants |= {"ROOT": ROOT, "ORIENTATION": ORIENTATION}
    constants["N_INPUT_TERMS"] = N_INPUT_TERMS
    constants["N_DENSE_POINTS"] = len(tables.plant.control.output_fractions) - 1
    numbers = {
        "START_TIME": system.scene.time.start,
        "SAMPLE_TOLERANCE": SAMPLE_TOLERANCE,
        "TIME_TOLERANCE": TIME_TOLERANCE,
        "FIXED_STEP": settings.step or 1.0,
        "EVENT_TOLERANCE": VALUE_TOLERANCE,
    }
    parts = [
        "/* Written by sidtool: tables and data of one scene. */",
        "#include <stdint.h>",
        *(f"enum {{ {name} = {value} }};" for name, value in constants.items()),
        *(f"#define {name} {_real(value)}" for name, value in numbers.items()),
        *_structures(PLANT),
        *(_prototype(name, kernel) for name, kernel in kernels.items()),
        *_image_data(image),
        *_time_data(tables),
        *_input_data(tables, image, tuple(inputs)),
        *_output_data(tables, image, (*outputs, *events)),
        f"enum {{ N_OUTPUTS = {len(outputs)} }};",
        *_event_data(tables),
    ]
    return "\n".join(parts) + "\n"


def _real(value: float) -> str:
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def _structures(root: TableType) -> list[str]:
    """All tables as structures of 64-bit fields; the root comes last."""
    known: dict[str, list[str]] = {}

    def add(kind: TableType) -> None:
        name = kind.owner.__name__
        if name in known:
            return
        known[name] = []
        fields = []
        for field_name, member in kind.members.items():
            if isinstance(member, TableType):
                add(member)
                fields.append(f"struct {member.owner.__name__} *{field_name};")
            elif isinstance(member, PointerType):
                fields.append(f"void (*{field_name})(void);")
            elif isinstance(member, ViewType | RowsType):
                fields.append(f"{_c_type(member.numbers)} *{field_name};")
                fields.append(f"int64_t {field_name}_extent[{member.ndim}];")
            else:
                fields.append(f"{_c_type(member)} {field_name};")
        known[name] = fields

    add(root)
    lines = [f"struct {name};" for name in known]
    for name, fields in known.items():
        lines += [f"struct {name} {{", *(f"    {line}" for line in fields), "};"]
    return lines


def _c_type(kind: Any) -> str:
    if isinstance(kind, np.dtype):
        return "int64_t" if kind == np.int64 else "double"
    return {float64: "double", int64: "int64_t", void: "void"}[kind]


def _prototype(name: str, kernel: Entry) -> str:
    """Declaration of a kernel: tables by address, arrays by address and extents."""
    signature = kernel.signatures[0]
    arguments: list[str] = []
    for kind in signature.args:
        if isinstance(kind, TableType):
            arguments.append(f"struct {kind.owner.__name__} *")
        elif isinstance(kind, ViewType):
            arguments += [f"{_c_type(kind.numbers)} *", *["int64_t"] * kind.ndim]
        else:
            arguments.append(_c_type(kind))
    returned = _c_type(signature.return_type)
    return f"extern {returned} {PREFIX}{name}({', '.join(arguments)});"


def _array(declaration: str, entries: Iterable[str]) -> str:
    """A constant array of at least one entry, as C has no empty ones."""
    return f"static const {declaration}[] = {{{', '.join(entries)}}};"


def _image_data(image: MemoryImage) -> list[str]:
    words = (
        "INT64_MIN" if word == -(2**63) else f"{word}LL"
        for word in image.words.tolist()
    )
    symbols = sorted({symbol for _, symbol in image.kernels})
    pointers = (f"{{{word}, {target}}}" for word, target in image.pointers)
    kernels = (f"{{{word}, {symbol}}}" for word, symbol in image.kernels)
    return [
        _array("int64_t image", words),
        _array("struct { int32_t word, target; } pointer_words", pointers),
        *(f"extern void {symbol}(void);" for symbol in symbols),
        _array("struct { int32_t word; void (*kernel)(void); } kernel_words", kernels),
    ]


def _time_data(tables: PlantTables) -> list[str]:
    """Breaks of functions, then the end; laws that are sampled."""
    system = tables.system
    end = system.scene.time.end
    breaks = [*system.break_causes, end]
    laws = []
    for k, force in enumerate(system.forces):
        if force.sample_period:
            body = system.arrays.force[k, at.F_B]
            velocity = system.arrays.body[body, at.VEL]
            laws.append(f"{{{k}, {velocity}, {_real(force.sample_period)}}}")
    names = (json.dumps(force.name) for force in system.forces)
    return [
        _array("double breaks", map(_real, breaks)),
        f"enum {{ N_SAMPLED_LAWS = {len(laws)} }};",
        _array(
            "struct { int64_t force, velocity; double period; } sampled_laws",
            [*laws, "{0, 0, 1.0}"],
        ),
        _array("char *const force_names", [*names, '""']),
    ]


def _input_data(
    tables: PlantTables, image: MemoryImage, inputs: tuple[str, ...]
) -> list[str]:
    """The piece of a polynomial that each input is: its start, then coefficients."""
    arrays, rows = tables.system.arrays, []
    for name in inputs:
        start = tables.system.input_data(name).start
        continuity = tables.system.scene.inputs[name].continuity
        rows.append(f"{{{image.word_of(arrays.real_data, start)}, {continuity}}}")
    return [
        f"enum {{ N_INPUTS = {len(rows)} }};",
        _array("struct { int64_t piece, continuity; } inputs", [*rows, "{0, 0}"]),
    ]


def _output_data(
    tables: PlantTables, image: MemoryImage, outputs: tuple[OutputTerms, ...]
) -> list[str]:
    plant = tables.plant

    def word(location: tuple[str, int] | None) -> int:
        if location is None:
            return -1
        name, index = location
        of_output = name in ("wrench", "force", "body")
        return image.word_of(getattr(plant.output if of_output else plant, name), index)

    terms: list[str] = []
    rows = []
    for output in outputs:
        rows.append(
            f"{{{len(terms)}, {len(output.terms)}, {_real(output.constant)}, "
            f"{output.kind}}}"
        )
        terms += [
            f"{{{word(t.first)}, {word(t.second)}, {_real(t.weight)}}}"
            for t in output.terms
        ]
    return [
        _array(
            "struct { int64_t first, second; double weight; } terms",
            [*terms, "{0, -1, 0.0}"],
        ),
        _array(
            "struct { int64_t first, count; double constant; int kind; } outputs",
            [*rows, "{0, 0, 0.0, 0}"],
        ),
    ]


def _event_data(tables: PlantTables) -> list[str]:
    """Events that end the motion; their quantities stand behind the outputs."""
    directions = {"rising": 1, "falling": -1, "both": 0}
    events = ending_events(tables.system.scene)
    rows = [
        f"{{{json.dumps(name)}, {_real(event.value)}, {directions[event.direction]}, "
        f"{event.count or 1}}}"
        for name, event in events.items()
    ]
    return [
        f"enum {{ N_EVENTS = {len(rows)} }};",
        _array(
            "struct { const char *name; double value; int direction, count; } events",
            [*rows, '{"", 0.0, 0, 0}'],
        ),
    ]
