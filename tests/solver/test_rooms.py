"""The rooms of the solver stand in one order: imports run downward."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

from tests.places import ROOT

SOLVER = ROOT / "solver"
#: From the lowest to the highest; loose files stand above all but those in LEAVES.
ROOMS = (
    "compiler",
    "spatial",
    "linear",
    "dynamics",
    "functions",
    "system",
    "integrators",
    "initial_state",
    "output",
    "diagnostics",
    "analyses",
    "simulation",
)
#: Files that one folder may have.
CROWDED = 30
#: Loose files that every room may import.
LEAVES = {"": 11}


def modules() -> dict[str, Path]:
    found = {}
    for path in SOLVER.rglob("*.py"):
        parts = path.relative_to(SOLVER).with_suffix("").parts
        found[".".join(p for p in parts if p != "__init__")] = path
    return found


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Modules of the solver that a module imports, at the top or in a function."""
    package = name if path.stem == "__init__" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.dump(branch.test)
        for node in ast.walk(branch)
    }
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.level or id(node) in typing:
            continue
        base = package.split(".") if package else []
        base = base[: len(base) - node.level + 1]
        home = ".".join([*base, *([node.module] if node.module else [])])
        for entry in node.names:
            inner = f"{home}.{entry.name}" if home else entry.name
            found.add(inner if inner in known else home)
    return found - {name}


def height(name: str) -> int:
    room, _, _ = name.partition(".")
    return ROOMS.index(room) if room in ROOMS else LEAVES.get(room, len(ROOMS))


def test_imports_run_downward() -> None:
    known = modules()
    upward = [
        (name, other)
        for name, path in known.items()
        for other in imports(name, path, known)
        if height(other) > height(name)
    ]
    assert upward == []


def test_every_room_is_listed() -> None:
    rooms = {path.parent.name for path in SOLVER.glob("*/*.py")}
    assert rooms == set(ROOMS)
    loose = [path.stem for path in SOLVER.glob("*.py")]
    assert len(loose) <= 8


def test_no_folder_is_crowded() -> None:
    sources = [ROOT / name for name in ("formats", "solver", "sidtool")]
    paths = {path.resolve() for top in sources for path in top.rglob("*.py")}
    assert max(Counter(path.parent for path in paths).values()) <= CROWDED
