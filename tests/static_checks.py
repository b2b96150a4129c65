"""Check types and the order of imports: `python -m tests.static_checks`.

mypy checks the package as it is installed, and import-linter the contracts of
pyproject.toml: each package imports only packages below it, and no module imports
itself through others. The examples of the documentation and the files of `tests/typed`
are checked as those of users are: strictly, in another folder; with pyright, too, where
it is installed.

Both follow folders, and `sidtool.solver` and `sidtool.formats` are at the top of the
repository. A folder below `build/` shows them where they are installed: by links, on
Windows by copies. The benchmarks, which are rarely run, are checked with the tests that
they use beside it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from . import prose
from .places import PAGES, ROOT

#: Folder of the repository to its place in the package.
INNER = {"formats": "formats", "solver": "solver"}
#: The command `lint-imports`, wherever it is installed.
LINT_IMPORTS = """
from importlib.metadata import entry_points
(command,) = entry_points(group="console_scripts", name="lint-imports")
command.load()()
"""
#: The Python blocks of a page, which go on one after the other; not those that need an
#: optional package.
EXAMPLE = re.compile(r"(?<! -->\n)^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def main() -> int:
    """Exit status of the first check that fails, 0 if none does."""
    top = ROOT / "build" / "typed"
    package = top / "sidtool"
    for folder in (package, top / "benchmarks", top / "tests"):
        if folder.is_symlink():
            folder.unlink()
        elif folder.exists():
            shutil.rmtree(folder)
    package.mkdir(parents=True)
    shown = {package / path.name: path for path in (ROOT / "sidtool").iterdir()}
    shown |= {package / name: ROOT / folder for folder, name in INNER.items()}
    shown |= {top / name: ROOT / name for name in ("benchmarks", "tests")}
    for place, path in shown.items():
        if place.name == "__pycache__":
            continue
        if sys.platform != "win32":
            place.symlink_to(path)
        elif path.is_dir():
            shutil.copytree(path, place)
        else:
            shutil.copy(path, place)
    command = [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml"]
    for more in (sys.argv[1:], ["--follow-imports=silent", "-p", "benchmarks"]):
        done = subprocess.run([*command, *more], cwd=top, check=False)
        if done.returncode:
            return done.returncode
    return _check_imports(top) or _check_users(top) or prose.main()


def _check_imports(top: Path) -> int:
    """Exit status of import-linter; what it prints is shown if a contract is broken."""
    command = [sys.executable, "-c", LINT_IMPORTS, "--no-cache", "--no-logo"]
    environment = {**os.environ, "PYTHONPATH": str(top)}
    done = subprocess.run(
        [*command, str(ROOT / "pyproject.toml")],
        cwd=top,
        env=environment,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=False,
    )
    if done.returncode:
        print(done.stdout)
    else:
        print("Success:", *re.findall(r"Analyzed .*|Contracts: .*", done.stdout))
    return done.returncode


def _check_users(top: Path) -> int:
    """Exit status of mypy for what users write."""
    folder = ROOT / "build" / "users"
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir()
    for page in [ROOT / "README.md", *PAGES]:
        blocks = EXAMPLE.findall(page.read_text(encoding="utf-8"))
        if blocks:
            name = page.stem.lower() + "_page.py"
            (folder / name).write_text("\n".join(blocks), encoding="utf-8")
    for path in (ROOT / "tests" / "typed").glob("*.py"):
        shutil.copy(path, folder)
    command = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports"]
    command += ["--follow-imports=silent"]  # the package is checked by its own settings
    command += ["--config-file", "", "."]
    environment = {**os.environ, "MYPYPATH": str(top)}
    done = subprocess.run(command, cwd=folder, env=environment, check=False)
    return done.returncode or _check_with_pyright(folder, top)


def _check_with_pyright(folder: Path, top: Path) -> int:
    """Exit status of pyright for the same files; 0 where it is not installed."""
    program = shutil.which("pyright") or shutil.which("basedpyright")
    if program is None:
        return 0
    settings = {"extraPaths": [str(top)], "typeCheckingMode": "standard"}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = [program, "--pythonpath", sys.executable]
    return subprocess.run(command, cwd=folder, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
