"""Derivatives of the SID of a model by its design variables.

The model is discretised with an imaginary step in the variable, and the functions of a
conversion then carry the step through frame, reduction and SID. Shape functions keep
their sign and normalisation, so that SID + e dSID is the SID of the model with the
variable changed by a small e. Modes of one frequency are differentiated as a subspace,
in which case Ke + e dKe is not diagonal: it holds the frequencies of the changed model.

Quantities of a body and their derivatives: mass, frequencies, inertia, compliance.

A quantity is written NAME or NAME(ARGUMENT), see `QUANTITIES`. It is a function of a
SID; its derivative follows from that of the SID by the product rule.

A SID with its derivatives by design variables, in memory and in HDF5.

The file is that of the SID. Its group `derivatives` holds a SID of derivatives for each
variable, with the attributes `variable` and `value`.
"""

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label
from sidtool.formats.base.sid import BLOCK_SHAPES, J_INDICES, NODE_SHAPES, SID, Taylor
from sidtool.formats.file_names import check_ending
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.sid_files import SidReader, read_hdf5, write_sid_group
from sidtool.formats.storage.hdf5_files import check_finite, write_sealed
from sidtool.formats.toml.expressions import split_at_commas
from sidtool.formats.toml.files import locate_errors

from ..conversion.stress_recovery import (
    PointChoice,
    StressPoint,
    peak_points,
    points_at,
)
from ..discretisation.registry import finite_element_model
from ..eigensolvers.eigenpair_derivatives import clusters
from ..elements.finite_element_model import FiniteElementModel
from ..pipeline.model_to_sid import sid_of_basis
from ..reduction.admissible_space import AdmissibleSpace
from ..reduction.body_frames import FRAMES, Frame, clamped_dofs
from ..reduction.complex_step_space import NominalSpaces, complex_step_space
from ..reduction.methods import REDUCTIONS, ReducedBasis
from .design_variables import DesignVariable, VariableLike, design_variable

_FORM = re.compile(r"(\w+)(?:\((.*)\))?")
_ENTRY = re.compile(r"(?:(\w+)\.)?(\w+?)(?:\.m1\[([0-9]+)\])?\[([0-9]+),\s*([0-9]+)\]")
_AXES = "xyz"

#: Value and derivative of a quantity.
Pair = tuple[float, float]

#: Forms of quantities with their meanings, for help and messages.
QUANTITIES: Mapping[str, str] = {
    "mass": "mass",
    "frequency(k)": "k-th frequency of the body on the supports of its frame; "
    "frequency(*) all of them",
    "centre(x)": "coordinate of the centre of mass in the body frame, also y, z",
    "inertia(xx)": "moment or product of inertia about the origin of the body frame, "
    "also yy, zz, xy, xz, yz",
    "compliance(NAME.x)": "static displacement of a marker along x, y or z by a unit "
    "force there",
    "entry(Ke[0,0])": "entry of a block of the SID; of a node entry(2.phi[1,0]), of a "
    "first-order term entry(J.m1[0][2,0])",
}

#: Group of the file of a SID, and attributes of its groups.
GROUP, VARIABLE, VALUE, MARKERS = "derivatives", "variable", "value", "markers"
#: Shape functions agree to this share of the largest displacement.
_SAME = 1e-6
#: Geometries that other programs discretise, or whose matrices are all there is.
_NOT_OWN = "an own discretisation; matrices and CalculiX elements have no derivatives"


@dataclass(frozen=True)
class Quantity:
    """A number that a SID gives.

    Attributes
    ----------
    text : as it is written
    unit : its SI unit
    evaluate : function of a SID and its derivative that returns value and derivative
    """

    text: str
    unit: str
    evaluate: Callable[[SID, SID], Pair]


def parse_quantities(
    texts: str | Iterable[str], sid: SID, nodes: Mapping[str, str]
) -> list[Quantity]:
    """Return the quantities of texts, each of which may hold several.

    Parameters
    ----------
    nodes : marker -> id of its node in the SID

    Raises
    ------
    InputError : there is no such quantity, mode, marker or entry.
    """
    given = [texts] if isinstance(texts, str) else [*texts]
    parts = [part for text in given for part in split_at_commas(text)]
    found: list[Quantity] = []
    for part in dict.fromkeys(parts):
        found += _parse(part, sid, nodes)
    if not found:
        raise _unknown("nothing")
    return found


def _parse(text: str, sid: SID, nodes: Mapping[str, str]) -> list[Quantity]:
    match = _FORM.fullmatch(text)
    if match is None or match[1] not in _PARSERS:
        raise _unknown(repr(text))
    return _PARSERS[match[1]](text, (match[2] or "").strip(), sid, nodes)


def _unknown(what: str) -> InputError:
    return InputError(
        f"found {what}", place="--of", expected=", ".join(QUANTITIES) + " or others"
    )


def _mass(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    return [Quantity(text, "kg", lambda s, d: (s.mass, d.mass))]


def _frequency(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    numbers = range(1, sid.nq + 1) if argument == "*" else [_mode(argument, sid)]
    return [
        Quantity(f"frequency({k})", "Hz", partial(_frequency_pair, k)) for k in numbers
    ]


def _mode(argument: str, sid: SID) -> int:
    if is_label(argument) and 1 <= int(argument) <= sid.nq:
        return int(argument)
    raise InputError(
        f"there is no mode {argument!r}",
        place="--of",
        expected=f"frequency(k) with k from 1 to {sid.nq}, or frequency(*)",
    )


def _frequency_pair(number: int, sid: SID, derivative: SID) -> Pair:
    return _frequencies(sid, derivative)[number - 1]


def _frequencies(sid: SID, derivative: SID) -> list[Pair]:
    """Return frequencies [Hz] and their derivatives.

    Those of equal frequencies are the eigenvalues of their block, ascending: they are
    derivatives along the variable, and those of the other direction are in the
    opposite order.
    """
    squares = np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)
    values = np.sqrt(np.maximum(squares, 0.0))
    slopes = np.zeros(sid.nq)
    for group in clusters(squares):
        inside = np.ix_(group, group)
        block = (
            derivative.Ke.m0[inside] - squares[group].mean() * derivative.Me.m0[inside]
        )
        slopes[group] = np.linalg.eigvalsh((block + block.T) / 2)
    rates = slopes / (2 * np.maximum(values, 1e-300)) / (2 * np.pi)
    return list(zip((values / (2 * np.pi)).tolist(), rates.tolist(), strict=True))


def _centre(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    axis = _axis(argument)

    def evaluate(s: SID, d: SID) -> Pair:
        value = float(s.mdCM.m0[axis, 0]) / s.mass
        return value, (float(d.mdCM.m0[axis, 0]) - value * d.mass) / s.mass

    return [Quantity(text, "m", evaluate)]


def _axis(argument: str) -> int:
    if argument in ("x", "y", "z"):
        return _AXES.index(argument)
    raise InputError(f"found {argument!r}", place="--of", expected="x, y or z")


def _inertia(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    names = [_AXES[a] + _AXES[b] for a, b in J_INDICES]
    if argument not in names:
        raise InputError(f"found {argument!r}", place="--of", expected=", ".join(names))
    row = names.index(argument)
    return [
        Quantity(
            text,
            "kg m^2",
            lambda s, d: (float(s.J.m0[row, 0]), float(d.J.m0[row, 0])),
        )
    ]


def _compliance(
    text: str, argument: str, sid: SID, nodes: Mapping[str, str]
) -> list[Quantity]:
    name, _, direction = argument.rpartition(".")
    axis = _axis(direction)
    if name not in nodes:
        raise InputError(
            f"there is no marker {name!r}", place="--of", expected=", ".join(nodes)
        )

    def evaluate(s: SID, d: SID) -> Pair:
        row, change = (x.node(nodes[name]).phi.m0[axis] for x in (s, d))
        answer = np.linalg.solve(s.Ke.m0, row)
        return float(row @ answer), float(
            2 * change @ answer - answer @ d.Ke.m0 @ answer
        )

    return [Quantity(text, "m/N", evaluate)]


def _entry(text: str, argument: str, sid: SID, _: Any) -> list[Quantity]:
    match = _ENTRY.fullmatch(argument)
    expected = "such as entry(Ke[0,0]), entry(2.phi[1,0]) or entry(J.m1[0][2,0])"
    if match is None:
        raise InputError(f"found {argument!r}", place="--of", expected=expected)
    node, block, order, *index = match.groups()
    row, column = map(int, index)
    if block not in (BLOCK_SHAPES if node is None else NODE_SHAPES):
        raise InputError(
            f"there is no block {block!r}", place="--of", expected=expected
        )

    def number(s: SID) -> float:
        part = getattr(s if node is None else s.node(node), block)
        if part is None:
            raise IndexError
        if order is not None:
            return float(part.first_order(s.nq)[int(order), row, column])
        return float(part.m0[row, column])

    try:
        number(sid)
    except IndexError:
        raise InputError(
            f"the SID has no {argument}", place="--of", expected=expected
        ) from None
    return [Quantity(text, "", lambda s, d: (number(s), number(d)))]


_PARSERS: dict[str, Callable[..., list[Quantity]]] = {
    "mass": _mass,
    "frequency": _frequency,
    "centre": _centre,
    "inertia": _inertia,
    "compliance": _compliance,
    "entry": _entry,
}


@dataclass(frozen=True, eq=False)
class SidDerivatives(Mapping[str, SID]):
    """The SID of a model, and its derivatives by the names of design variables.

    ``derivatives["thickness"].Ke.m0`` is the derivative of `sid.Ke.m0`; mass, blocks
    and nodes are all derivatives, labels those of the SID.

    Attributes
    ----------
    sid : of the model; its blocks are those of `convert`
    variables : name -> value in the model
    derivatives : name -> derivatives in the form of a SID
    markers : name of a marker -> id of its node
    """

    sid: SID
    variables: Mapping[str, float]
    derivatives: Mapping[str, SID]
    markers: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> SID:
        return self.derivatives[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.derivatives)

    def __len__(self) -> int:
        return len(self.derivatives)

    def __repr__(self) -> str:
        return f"<SidDerivatives of {self.sid.title!r} by {', '.join(self)}>"

    def neighbour(self, changes: Mapping[str, float]) -> SID:
        """Return SID + sum of derivatives times changes of the variables."""
        sid = self.sid
        for name, amount in changes.items():
            sid = _combined(sid, self.derivatives[name], amount)
        return sid

    def quantities(self, texts: str | Iterable[str]) -> list[Quantity]:
        """Return quantities by their names, such as "frequency(1)" or "mass".

        Raises
        ------
        InputError : there is no such quantity, mode, marker or entry.
        """
        return parse_quantities(texts, self.sid, self.markers)

    def value(self, quantity: str) -> float:
        """Return the value of a quantity, see `quantities`."""
        (one,) = self.quantities(quantity)
        return one.evaluate(self.sid, self.sid)[0]

    def derivative(self, quantity: str, variable: str) -> float:
        """Return the derivative of a quantity by a variable, see `quantities`."""
        (one,) = self.quantities(quantity)
        return one.evaluate(self.sid, self[variable])[1]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the SID and its derivatives (.h5); it can be read as that of the SID.

        Raises
        ------
        InputError, OSError : a number is not finite, or the file cannot be written.
        """
        check_ending(path, "derivatives")
        for sid in (self.sid, *self.derivatives.values()):
            check_finite(sid)

        def write(file: h5py.File) -> None:
            write_sid_group(file, self.sid)
            groups = file.create_group(GROUP)
            groups.attrs[MARKERS] = json.dumps(dict(self.markers))
            for index, (name, sid) in enumerate(self.derivatives.items()):
                group = groups.create_group(f"{index:06d}")
                write_sid_group(group, sid)
                group.attrs[VARIABLE], group.attrs[VALUE] = name, self.variables[name]

        write_sealed(Path(path), write)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a SID and its derivatives, bit for bit as they were written.

        Raises
        ------
        InputError : the file is damaged, of another kind, or has no derivatives.
        """
        source, sid = os.fspath(path), read_hdf5(path)
        values: dict[str, float] = {}
        found: dict[str, SID] = {}
        with h5py.File(path, "r") as file:
            if GROUP not in file:
                raise InputError(
                    "holds a SID without derivatives",
                    source=source,
                    expected="a file of sidtool sensitivity or SidDerivatives.save",
                )
            markers = json.loads(str(file[GROUP].attrs[MARKERS]))
            for _, group in sorted(file[GROUP].items()):
                name = str(group.attrs[VARIABLE])
                values[name] = float(group.attrs[VALUE])
                found[name] = SidReader(source).sid(group)
        return cls(sid, values, found, markers)


def _combined(sid: SID, other: SID, amount: float) -> SID:
    """Return sid + amount * other, block by block."""

    def block(a: Taylor | None, b: Taylor | None) -> Any:
        if a is None or b is None:
            return a
        m1 = a.m1
        if b.m1 is not None:
            m1 = amount * b.m1 + (0.0 if m1 is None else m1)
        return Taylor(a.m0 + amount * b.m0, m1, order=a.order)

    nodes = [
        replace(
            node,
            **{n: block(getattr(node, n), getattr(step, n)) for n in NODE_SHAPES},
        )
        for node, step in zip(sid.nodes, other.nodes, strict=True)
    ]
    blocks = {
        name: block(value, other.blocks[name]) for name, value in sid.blocks.items()
    }
    mass = sid.mass + amount * other.mass
    return replace(sid, mass=mass, nodes=tuple(nodes), sections=(), **blocks)


__all__ = ["DifferentiableBody", "SidDerivatives", "sid_derivatives"]


def sid_derivatives(
    model: ModelFile | str | Path, variables: Sequence[VariableLike]
) -> SidDerivatives:
    """Return the SID of a model and the derivative of each block by design variables.

    Parameters
    ----------
    model : a model, or the path of a model file
    variables : keys of numbers of the model, as "material.youngs_modulus" or
        "geometry.control_points[1][0][1]", parameters, and `ShapeVariable`

    Raises
    ------
    InputError : there is no such number, it changes the structure of the model, or the
        model is discretised by another program.
    """
    content = model if isinstance(model, ModelFile) else read_model(model)
    with locate_errors(content):
        body = DifferentiableBody(content)
        found = [design_variable(content, variable) for variable in variables]
        derivatives = {one.name: body.derivative(one) for one in found}
        values = {one.name: one.value for one in found}
        markers = {name: str(m.node) for name, m in content.markers.items()}
        return SidDerivatives(body.sid, values, derivatives, markers)


class DifferentiableBody:
    """A model, discretised and reduced once for the derivatives by all variables."""

    def __init__(self, model: ModelFile) -> None:
        if model.comes_as_matrices:
            raise InputError("has no derivatives", place="geometry", expected=_NOT_OWN)
        self.model = model
        body = finite_element_model(model)
        frame = FRAMES[model.frame.type](body, model.frame)
        self._spaces = NominalSpaces(body, frame)
        self._fixed = getattr(model.reduction, "fixed_names", ())
        space, loaded = self._reduced_spaces(body, frame)
        places: list[tuple[int, int]] = []

        def choose(*arguments: Any) -> list[StressPoint]:
            points = peak_points(*arguments)
            places.extend(point.place for point in points)
            return points

        converted = _converted(model, body, frame, space, loaded, choose)
        self.sid, self.basis = converted
        self._points = points_at(places)

    def derivative(self, variable: DesignVariable) -> SID:
        """Return the derivative of every block by a variable, in the form of a SID."""
        model = variable.with_imaginary_step(self.model)
        # Sections have no derivatives, and their displacements by jumps are real.
        body = replace(finite_element_model(model), cuts=())
        frame = FRAMES[model.frame.type](body, model.frame)
        space, loaded = self._reduced_spaces(body, frame)
        sid, basis = _converted(model, body, frame, space, loaded, self._points)
        self._check_shapes(basis)
        return _mapped(sid, lambda values: np.imag(values) / variable.step)

    def _reduced_spaces(
        self, body: FiniteElementModel, frame: Frame
    ) -> tuple[AdmissibleSpace, AdmissibleSpace | None]:
        """Return the spaces of the reduction and of loads on the body."""
        space = complex_step_space(body, frame, self._fixed, self._spaces)
        if not self.model.stiffening:
            return space, None
        return space, complex_step_space(body, frame, (), self._spaces)

    def _check_shapes(self, basis: ReducedBasis) -> None:
        """Check that shape functions with a step are those of the SID."""
        own, found = self.basis.shapes, basis.shapes.real
        size = np.abs(own).max(initial=0.0)
        if own.shape != found.shape or np.abs(own - found).max() > _SAME * size:
            raise InputError(
                "has shape functions that rounding decides about",
                place="reduction",
                expected="fewer modes, or interfaces whose loads differ more",
            )


def _converted(
    model: ModelFile,
    body: FiniteElementModel,
    frame: Frame,
    space: AdmissibleSpace,
    loaded: AdmissibleSpace | None,
    choose: PointChoice,
) -> tuple[SID, ReducedBasis]:
    """Return the SID of a discretised body, and its shape functions."""
    reduce, settings = REDUCTIONS[model.reduction.method], model.reduction
    if settings.method == "user":
        basis = reduce(body, frame, settings)
    else:
        basis = reduce(body, frame, settings, space)
    held = frame.held
    if frame.rows is None:
        fixed = getattr(settings, "fixed_names", ())
        held = clamped_dofs(body, frame, fixed)
    basis = replace(basis, space=None)
    parts = (model, body, frame, basis, held)
    sid, basis, _ = sid_of_basis(*parts, loaded=loaded, choose=choose)
    return sid, basis


def _mapped(sid: SID, change: Callable[[Any], Any]) -> SID:
    """Return a SID with a function applied to mass, all blocks and all nodes."""

    def block(value: Taylor | None) -> Any:
        if value is None:
            return None
        m1 = None if value.m1 is None else change(value.m1)
        return Taylor(change(value.m0), m1, order=value.order)

    nodes = [
        replace(node, **{name: block(getattr(node, name)) for name in NODE_SHAPES})
        for node in sid.nodes
    ]
    blocks = {name: block(value) for name, value in sid.blocks.items()}
    mass = float(change(sid.mass))
    return replace(sid, mass=mass, nodes=tuple(nodes), sections=(), **blocks)
