"""A part of a mesh file by name: some of its elements, and what holds them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError

from ..frontends.mesh.data import ElementBlock
from .imported import ImportedMesh, undefined_members


def part_of(imported: ImportedMesh, name: str) -> ImportedMesh:
    """The elements of a part, with the couplings and masses at their nodes.

    Raises
    ------
    InputError : there is no such part, or an equation holds it to the rest.
    """
    parts = {key.upper(): set(labels) for key, labels in imported.parts.items()}
    if not parts.get(name.upper()):
        known = ", ".join(map(repr, imported.parts)) or "none"
        raise InputError(
            f"there is no part {name!r} of elements",
            place="geometry.part",
            expected=f"one of {known}",
        )
    chosen = parts[name.upper()]
    there = {n for b in imported.mesh.blocks for n in b.labels.tolist()}
    there |= {bar.label for bar in imported.bars}
    there |= {shell.label for shell in imported.shells}
    lost = undefined_members(there, {name: sorted(chosen)}, "element")
    if lost:
        raise InputError(
            f"the part {name!r} names {lost[name]}, which the file does not define",
            place="geometry.part",
            expected="elements of this file",
        )
    blocks = tuple(_blocks(imported, chosen))
    bars = tuple(bar for bar in imported.bars if bar.label in chosen)
    shells = tuple(shell for shell in imported.shells if shell.label in chosen)
    rows = [b.nodes.ravel() for b in blocks]
    labels = set(imported.mesh.labels[np.concatenate(rows)].tolist()) if rows else set()
    labels |= {node for bar in bars for node in bar.nodes}
    labels |= {node for shell in shells for node in shell.nodes}
    springs = tuple(s for s in imported.springs if labels.issuperset(s.nodes))
    couplings = tuple(
        coupling
        for coupling in imported.couplings
        if labels & {*coupling.nodes, coupling.reference}
    )
    held = labels | {c.reference for c in couplings}
    masses = tuple(mass for mass in imported.masses if mass.node in held)
    equations = []
    for equation in imported.equations:
        inside = [node in held for node, _ in equation.terms]
        if any(inside) and not all(inside):
            raise InputError(
                f"an equation holds the part {name!r} to the rest",
                place=equation.place,
                expected="a part that nothing else holds",
            )
        equations += [equation] if any(inside) else []
    whole = sum(len(b.nodes) for b in imported.mesh.blocks)
    whole += len(imported.bars) + len(imported.shells)
    count = sum(len(b.nodes) for b in blocks) + len(bars) + len(shells)
    said = f"part {name}: {count} of {whole} elements, {len(couplings)} of "
    said += f"{len(imported.couplings)} couplings, {len(masses)} of "
    said += f"{len(imported.masses)} masses"
    return replace(
        imported,
        mesh=replace(imported.mesh, blocks=blocks),
        couplings=couplings,
        masses=masses,
        equations=tuple(equations),
        bars=bars,
        shells=shells,
        springs=springs,
        notes=(*imported.notes, said),
    )


def _blocks(imported: ImportedMesh, chosen: set[int]) -> Iterator[ElementBlock]:
    wanted = np.fromiter(chosen, np.int64, len(chosen))
    for block in imported.mesh.blocks:
        kept = np.isin(block.labels, wanted)
        if kept.any():
            yield replace(block, nodes=block.nodes[kept], labels=block.labels[kept])
