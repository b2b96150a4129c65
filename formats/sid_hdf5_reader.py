"""Taking a SID out of an open HDF5 file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import h5py
import numpy as np

from .carried import Carried
from .errors import InputError
from .sid import BLOCK_SHAPES, NODE_SHAPES, SID, Array, Dialect, Node, Taylor

#: The parts of an expansion that may be missing.
PARTS = ("m1", "mn")


class Reader:
    """Takes datasets out of a file that may lie about their type.

    Their sizes are those of `check_sizes`.
    """

    def __init__(self, source: str) -> None:
        self._source = source

    def sid(self, file: h5py.Group) -> SID:
        """The whole body."""
        blocks: dict[str, Any] = {
            name: self._block(file[f"blocks/{name}"]) for name in BLOCK_SHAPES
        }
        extra = {
            str(group.attrs["name"]): self._block(group)
            for _, group in sorted(file["extra"].items())
        }
        return SID(
            mass=float(file.attrs["mass"]),
            labels=tuple(self._texts(file["labels"])),
            nodes=self._nodes(file["nodes"]),
            title=_text(file.attrs["title"]),
            extra=extra,
            dialect=_dialect(file.attrs["dialect"]),
            written_by=_text(file.attrs.get("written_by", "sidtool")),
            carried=self._carried(file),
            from_matrices=bool(file.attrs.get("from_matrices", False)),
            **blocks,
        )

    def _carried(self, file: h5py.Group) -> Carried | None:
        if "carried" not in file:
            return None
        group = file["carried"]
        rows = self._numbers(group["shares"], 2).tolist()
        told = [tuple(None if math.isnan(x) else x for x in row) for row in rows]
        names = self._texts(group["id"])
        lost = tuple(float(x) for x in group.attrs["lost"])
        if {len(row) for row in told} - {6} or len(lost) not in (0, 6):
            raise ValueError("shares are not told by direction")
        shares = dict(zip(names, told, strict=True))
        return Carried(bool(group.attrs["free"]), shares, lost)

    def _block(self, group: h5py.Group) -> Taylor:
        parts = {
            part: self._numbers(group[part], 3) if part in group else None
            for part in PARTS
        }
        m0 = self._numbers(group["m0"], 2)
        return Taylor(m0, order=int(group.attrs["order"]), **parts)

    def _nodes(self, group: h5py.Group) -> tuple[Node, ...]:
        ids, frames = self._texts(group["id"]), self._texts(group["rframe"])
        stacks: dict[str, dict[int, Any]] = {
            name: self._stack(group[name]) if name in group else {}
            for name in NODE_SHAPES
        }
        return tuple(
            Node(
                id=name,
                rframe=frame,
                sigma=stacks["sigma"].get(index),
                **{entry: stacks[entry][index] for entry in stacks if entry != "sigma"},
            )
            for index, (name, frame) in enumerate(zip(ids, frames, strict=True))
        )

    def _stack(self, group: h5py.Group) -> dict[int, Taylor]:
        m0 = self._numbers(group["m0"], 3)
        linear: dict[int, Array] = {}
        if "m1" in group:
            m1 = self._numbers(group["m1"], 4)
            linear = dict(zip(self._indices(group["m1_node"]), m1, strict=True))
        higher: Mapping[str, Any] = group.get("mn", {})
        nodes, orders = self._indices(group["node"]), self._indices(group["order"])
        return {
            node: Taylor(
                value,
                linear.get(node),
                self._numbers(higher[str(node)], 3) if str(node) in higher else None,
                order,
            )
            for node, order, value in zip(nodes, orders, m0, strict=True)
        }

    def _numbers(self, dataset: h5py.Dataset, dimensions: int) -> Array:
        if dataset.dtype.kind != "f" or dataset.ndim != dimensions:
            raise self._wrong(dataset, f"{dimensions} dimensions of real numbers")
        values: Array = np.asarray(dataset[()], dtype=np.float64)
        return values

    def _indices(self, dataset: h5py.Dataset) -> list[int]:
        if dataset.dtype.kind not in "iu" or dataset.ndim != 1:
            raise self._wrong(dataset, "a list of integers")
        indices: list[int] = dataset[()].tolist()
        return indices

    def _texts(self, dataset: h5py.Dataset) -> list[str]:
        if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1:
            raise self._wrong(dataset, "a list of texts")
        return [str(text) for text in dataset.asstr()[:]]

    def _wrong(self, dataset: h5py.Dataset, expected: str) -> InputError:
        return InputError(
            f"has shape {dataset.shape} and type {dataset.dtype}",
            source=self._source,
            place=f"dataset {dataset.name}",
            expected=expected,
        )


def _dialect(text: object) -> Dialect:
    stored = json.loads(_text(text))
    known = {item.name: stored[item.name] for item in fields(Dialect)}
    notes = known.pop("notes")
    if not all(isinstance(value, str) for value in (*known.values(), *notes)):
        raise ValueError("the dialect is not made of texts")
    return Dialect(**known, notes=tuple(notes))


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"found {type(value).__name__} instead of a text")
    return value
