"""A SID with its derivatives by design variables, in memory and in HDF5.

The file is that of the SID. Its group `derivatives` holds a SID of derivatives for each
variable, with the attributes `variable` and `value`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import h5py

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import NODE_SHAPES, SID, Taylor
from sidtool.formats.file_names import check_ending
from sidtool.formats.sid_hdf5 import SidReader, read_hdf5, write_sid_group
from sidtool.formats.storage.hdf5_files import check_finite, write_sealed

from .quantities import Quantity, parse_quantities

#: Group of the file of a SID, and attributes of its groups.
GROUP, VARIABLE, VALUE, MARKERS = "derivatives", "variable", "value", "markers"


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
