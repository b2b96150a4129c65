"""Programs and packages that the tests can use, but that no machine has to have.

A test that uses one is marked `@pytest.mark.needs("ccx")`. It is skipped where the
program or package is missing. All other tests run as on a machine that has none of
them: they are not on the PATH, and their import fails, here and in processes that a
test starts. So a test without its mark fails on every machine, not only where the
program is missing.

`python tests/optional.py FOLDER` prints a PATH without the optional programs; FOLDER
gets what that takes. This file needs the standard library only, as `.ci/run` calls it
before anything is installed.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

#: Name of a mark to the names under which the program is installed.
PROGRAMS = {
    "cc": ("cc", "gcc"),
    "ccx": ("ccx",),
    "chromium": (
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
    ),
    "ffmpeg": ("ffmpeg", "ffprobe"),
    "git": ("git",),
    "gmsh": ("gmsh",),
    "mpirun": ("mpirun", "mpiexec"),
    "wine": ("wine", "wine64"),
}
#: Name of a mark to the top-level modules of the package.
PACKAGES = {
    "cholespy": ("cholespy",),
    "control": ("control",),
    "dask": ("dask", "distributed"),
    "exudyn": ("exudyn",),
    "fmpy": ("fmpy",),
    "gmsh": ("gmsh",),
    "gymnasium": ("gymnasium",),
    "mpi4py": ("mpi4py",),
    "playwright": ("playwright",),
    "pyamg": ("pyamg",),
    "pypardiso": ("pypardiso",),
    "pyyeti": ("pyyeti",),
    "sksparse": ("sksparse",),
    "sksundae": ("sksundae",),
    "slepc4py": ("slepc4py", "petsc4py"),
    "sphinx": ("sphinx", "myst_parser", "furo"),
    "vtk": ("vtk", "vtkmodules"),
    "ziglang": ("ziglang",),
}
NAMES = frozenset(PROGRAMS) | frozenset(PACKAGES)

_WINDOWS = sys.platform == "win32"
_PREFIX = "sidtool-tests-"


def _package(module: str) -> str:
    """The top-level package of a module."""
    return module.partition(".")[0]


def program(name: str) -> str | None:
    """The path of an optional program, by any name that it is installed under."""
    return next(filter(None, map(shutil.which, PROGRAMS[name])), None)


def hidden_path(path: str, folder: Path) -> str:
    """A search path without the optional programs.

    A folder that holds one is replaced by links to all others that it holds, below
    `folder`. Windows has no links without rights: there the whole entry is left out.
    """
    hidden = {alias for aliases in PROGRAMS.values() for alias in aliases}
    entries = []
    for k, entry in enumerate(path.split(os.pathsep)):
        if not entry or not Path(entry).is_dir():
            continue
        held = {item.name for item in os.scandir(entry)}
        if not any(Path(name).stem in hidden for name in held):
            entries.append(entry)
        elif not _WINDOWS:
            links = folder / f"path{k}"
            links.mkdir(parents=True)
            for name in held - hidden:
                os.symlink(os.path.abspath(os.path.join(entry, name)), links / name)
            entries.append(str(links))
    return os.pathsep.join(entries)


class _VisibleModules:
    """The finder of modules on the path, which does not find hidden ones.

    An entry None in `sys.modules` would hide them as well, but scipy takes a name that
    is there for a package that is imported.
    """

    def __init__(self) -> None:
        self.hidden: frozenset[str] = frozenset()

    def find_spec(
        self,
        name: str,
        path: Sequence[str] | None = None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        if name in self.hidden:
            return None
        return PathFinder.find_spec(name, path, target)

    def __getattr__(self, name: str) -> Any:
        return getattr(PathFinder, name)  # such as of `importlib.metadata`


class Machine:
    """The programs and packages of this machine, hidden from all but marked tests."""

    def __init__(self) -> None:
        # a worker of pytest-xdist inherits the environment after programs were hidden,
        # and uses the links of the process that started it
        hidden = os.environ.get("SIDTOOL_TESTS_HIDDEN_PATH")
        self._path = os.environ.setdefault("SIDTOOL_TESTS_PATH", os.environ["PATH"])
        sys.path[:] = [entry for entry in sys.path if _PREFIX not in entry]
        self._folder = tempfile.TemporaryDirectory(prefix=_PREFIX)
        self._root = Path(self._folder.name)
        self._hidden = hidden or hidden_path(self._path, self._root)
        os.environ["SIDTOOL_TESTS_HIDDEN_PATH"] = self._hidden
        self._programs = {
            name: [p for a in aliases if (p := shutil.which(a, path=self._path))]
            for name, aliases in PROGRAMS.items()
        }
        self._packages = {
            name: all(find_spec(module) is not None for module in modules)
            for name, modules in PACKAGES.items()
            if name != "vtk"
        } | {"vtk": find_spec("vtkmodules") is not None}
        self._unloaded: dict[str, ModuleType] = {}
        self._shown: frozenset[str] | None = None
        self._modules = _VisibleModules()
        finders: list[Any] = sys.meta_path
        finders[finders.index(PathFinder)] = self._modules
        self._show(())

    def has(self, name: str) -> bool:
        """Whether a program or package is there; one that is both counts as either."""
        return bool(self._programs.get(name)) or self._packages.get(name, False)

    @contextmanager
    def showing(self, names: Collection[str]) -> Iterator[None]:
        """With some of the optional programs and packages, for one test."""
        self._show(names)
        try:
            yield
        finally:
            self._show(())

    def close(self) -> None:
        """Remove the links, and show all packages again."""
        self._folder.cleanup()
        finders: list[Any] = sys.meta_path
        finders[finders.index(self._modules)] = PathFinder

    def _show(self, names: Collection[str]) -> None:
        factors = sys.modules.get("sidtool.eigensolvers.factorisation")
        if factors is not None:
            factors.reason_unavailable.cache_clear()
        if self._shown == frozenset(names):
            return
        self._shown = frozenset(names)
        os.environ["PATH"] = os.pathsep.join(
            [*self._folders_of_programs(names), self._hidden]
        )
        os.environ["PYTHONPATH"] = os.pathsep.join(
            [str(self._folder_of_blocked(names)), *self._python_path()]
        )
        hidden = {
            module
            for name, modules in PACKAGES.items()
            for module in modules
            if name not in names
        }
        for name in [n for n in self._unloaded if _package(n) not in hidden]:
            sys.modules[name] = self._unloaded.pop(name)
        for name in [n for n in sys.modules if _package(n) in hidden]:
            self._unloaded[name] = sys.modules.pop(name)
        self._modules.hidden = frozenset(hidden)

    def _python_path(self) -> list[str]:
        given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
        return [p for p in given if p and _PREFIX not in p]

    def _folders_of_programs(self, names: Collection[str]) -> list[str]:
        found = [p for name in names for p in self._programs.get(name, ())]
        if _WINDOWS or not found:
            return [str(Path(path).parent) for path in found]
        folder = self._root / "-".join(["programs", *sorted(names)])
        if not folder.is_dir():
            folder.mkdir()
            for path in found:
                (folder / Path(path).name).symlink_to(path)
        return [str(folder)]

    def _folder_of_blocked(self, names: Collection[str]) -> Path:
        """Modules that cannot be imported, for processes that a test starts."""
        folder = self._root / "-".join(["blocked", *sorted(names)])
        if not folder.is_dir():
            folder.mkdir()
            for name, modules in PACKAGES.items():
                for module in modules if name not in names else ():
                    text = f"No module named {module!r} (hidden by the tests)"
                    (folder / f"{module}.py").write_text(
                        f"raise ModuleNotFoundError({text!r}, name={module!r})\n",
                        encoding="utf-8",
                    )
        return folder


if __name__ == "__main__":
    print(hidden_path(os.environ["PATH"], Path(sys.argv[1])))
