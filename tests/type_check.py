"""Run mypy on the package as it is installed: `python -m tests.type_check`.

mypy follows folders, and `sidtool.solver` and `sidtool.formats` stand at the top of the
repository. A folder below `build/` shows them where they are installed: by links, on
Windows by copies.
"""

from __future__ import annotations

import shutil
import subprocess
import sys

from .places import ROOT

#: Folder of the repository to its place in the package.
INNER = {"formats": "formats", "solver": "solver"}


def main() -> int:
    """Exit status of mypy."""
    top = ROOT / "build" / "typed"
    package = top / "sidtool"
    if package.exists():
        shutil.rmtree(package)
    package.mkdir(parents=True)
    shown = {path.name: path for path in (ROOT / "sidtool").iterdir()}
    shown |= {name: ROOT / folder for folder, name in INNER.items()}
    for name, path in shown.items():
        if name == "__pycache__":
            continue
        if sys.platform != "win32":
            (package / name).symlink_to(path)
        elif path.is_dir():
            shutil.copytree(path, package / name)
        else:
            shutil.copy(path, package / name)
    command = [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml"]
    return subprocess.run([*command, *sys.argv[1:]], cwd=top, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
