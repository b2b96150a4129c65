"""No file of the package imports itself through others."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

from tests.places import ROOT

#: What users hold opens, in its methods, the doors to all that can be done with it.
FACES = {
    "sidtool.api.scene",
    "sidtool.api.result",
    "sidtool.study.study_result",
    "sidtool.sweep.sweep_result",
}


def modules() -> dict[str, Path]:
    """By their names below `sidtool`."""
    found = {}
    for top in ("sidtool", "formats", "solver"):
        for path in (ROOT / top).rglob("*.py"):
            below = path.relative_to(ROOT)
            parts = below.with_suffix("").parts
            parts = parts if top == "sidtool" else ("sidtool", *parts)
            found[".".join(part for part in parts if part != "__init__")] = path
    return found


def imports(name: str, path: Path, known: dict[str, Path]) -> set[str]:
    """Modules that a module imports, but for types alone."""
    package = name if path.stem == "__init__" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    left = {
        id(node)
        for branch in ast.walk(tree)
        if (name in FACES and isinstance(branch, ast.FunctionDef))
        or (isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.dump(branch.test))
        for node in ast.walk(branch)
    }
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or id(node) in left:
            continue
        base = package.split(".")
        base = base[: len(base) - node.level + 1] if node.level else []
        home = ".".join([*base, *([node.module] if node.module else [])])
        for entry in node.names:
            inner = f"{home}.{entry.name}"
            found.add(inner if inner in known else home)
    return (found & set(known)) - {name, "sidtool"}


def test_no_file_imports_itself_through_others() -> None:
    known = modules()
    graph = {name: imports(name, path, known) for name, path in known.items()}
    assert len(list(TopologicalSorter(graph).static_order())) == len(known)
    assert {"sidtool.solver.simulation.run_loop", "sidtool.formats.base.sid"} <= set(
        known
    )
