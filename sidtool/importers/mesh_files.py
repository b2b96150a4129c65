"""Mesh files: choice of a reader, extraction of a part, names in a deck."""

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import diagnose

from ..mesh.deck_text import hide_included_text
from ..mesh.imported_mesh import (
    LEFT_OUT,
    ONLY_NODES,
    ImportedMesh,
    RawMass,
    find_undefined_members,
)
from ..mesh.mesh import ElementBlock
from .abaqus.couplings import masses_of
from .abaqus.input_file import read_deck
from .abaqus.mesh import node_sets, undefined_set_members

Reader = Callable[..., ImportedMesh]

#: Ending -> module and function; one line adds a format. Only the reader that a file
#: needs is imported.
MESH_READERS = {
    pattern.removeprefix("*"): reader
    for pattern, reader in (
        ("*.inp", ("sidtool.importers.abaqus.input_file", "read_inp")),
        ("*.msh", ("sidtool.importers.gmsh", "read_msh")),
        ("*.bdf", ("sidtool.importers.nastran.bulk_data", "read_bdf")),
        ("*.nas", ("sidtool.importers.nastran.bulk_data", "read_bdf")),
        ("*.dat", ("sidtool.importers.nastran.bulk_data", "read_bdf")),
        ("*.cdb", ("sidtool.importers.ansys.archive", "read_cdb")),
    )
}


def read_mesh(
    path: str | Path,
    ignored: Iterable[str] = (),
    part: str | None = None,
    density: float | None = None,
    *,
    bending: bool = False,
) -> ImportedMesh:
    """Read the mesh of a file.

    Parameters
    ----------
    ignored : keywords, cards or commands that are ignored on purpose
    part : the instance, the set or component of elements, or the number of the
        property, that is the body; None for all
    density : density of materials without one in the file, in its units

    Raises
    ------
    InputError : the ending is unknown, or names file, line and expectation.
    """
    ending = Path(path).suffix.lower()
    if ending not in MESH_READERS:
        raise InputError(
            f"files ending in {ending or 'nothing'} are not known as meshes",
            source=path,
            expected=", ".join(MESH_READERS),
        )
    words = frozenset(" ".join(word.upper().strip("*$").split()) for word in ignored)
    module, name = MESH_READERS[ending]
    reader: Reader = getattr(import_module(module), name)
    shells = {"bending": True} if bending and name == "read_bdf" else {}
    with hide_included_text(Path(path)), _without_garbage_collection():
        if part is None:
            return reader(path, words, density=density, **shells)
        if name == "read_inp":
            return reader(path, words, part, density=density)
        imported = reader(path, words, density=density, **shells)
    try:
        return extract_part(imported, part)
    except InputError as error:
        raise error.located(path) from None


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Do not search for unreachable cycles: the records of a mesh are a tree of
    millions of objects, whose repeated search takes a third of the time.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def extract_part(imported: ImportedMesh, name: str) -> ImportedMesh:
    """The elements of a part, with the couplings and masses at their nodes.

    Raises
    ------
    InputError : there is no such part, or an equation connects it to the rest.
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
    missing = find_undefined_members(there, {name: sorted(chosen)}, "element")
    if missing:
        raise InputError(
            f"the part {name!r} names {missing[name]}, which the file does not define",
            place="geometry.part",
            expected="elements of this file",
        )
    blocks = tuple(_blocks_of_part(imported, chosen))
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
        inside = [n in held for n, _ in (*equation.terms, *equation.rotations)]
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
    part = diagnose(
        "N134",
        f"part {name}",
        elements=count,
        given=whole,
        couplings=len(couplings),
        masses=len(masses),
    )
    return replace(
        imported,
        mesh=replace(imported.mesh, blocks=blocks),
        couplings=couplings,
        masses=masses,
        equations=tuple(equations),
        bars=bars,
        shells=shells,
        springs=springs,
        diagnostics=(*imported.diagnostics, part),
    )


def _blocks_of_part(imported: ImportedMesh, chosen: set[int]) -> Iterator[ElementBlock]:
    wanted = np.fromiter(chosen, np.int64, len(chosen))
    for block in imported.mesh.blocks:
        is_in_part = np.isin(block.labels, wanted)
        if is_in_part.any():
            yield replace(
                block, nodes=block.nodes[is_in_part], labels=block.labels[is_in_part]
            )


@dataclass(frozen=True)
class DeckNames:
    """Nodes, node sets and masses of a deck.

    Attributes
    ----------
    nodes, sets : nodes by number, and node sets by name
    elements, masses : number of elements, and point masses
    undefined : set -> its members that the deck does not define, as text
    left_out : keywords ignored by `geometry.ignore`, as `unread_keyword_notes` takes
        them
    """

    nodes: dict[int, tuple[float, float, float]]
    sets: dict[str, list[int]]
    elements: int
    masses: tuple[RawMass, ...]
    undefined: dict[str, str]
    left_out: tuple[str, ...] = ()


def read_deck_names(path: Path, ignored: frozenset[str] = frozenset()) -> DeckNames:
    """Read nodes, node sets and masses of a flat deck.

    Parameters
    ----------
    ignored : keywords that are ignored on purpose, in capitals

    Raises
    ------
    InputError : the file is not valid; the error names file, line and expectation.
    """
    deck = read_deck(path, ignored | {ONLY_NODES})
    body = deck.assembly
    sets, masses = node_sets(deck, body, body, ""), tuple(masses_of(deck, body, ""))
    undefined = undefined_set_members(deck, body, sets)
    chosen = {"".join(word.split()) for word in ignored}
    left_out = tuple(
        name
        for name in deck.unread_keywords
        if name.endswith(LEFT_OUT)
        and "".join(name.removesuffix(LEFT_OUT).strip("*").split()) in chosen
    )
    return DeckNames(body.nodes, sets, len(body.elements), masses, undefined, left_out)
