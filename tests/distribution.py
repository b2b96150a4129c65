"""Check what a release contains: `python -m tests.distribution DIST`.

DIST holds one wheel and one sdist. The release workflow calls this after building them.
"""

from __future__ import annotations

import stat
import sys
import tarfile
import zipfile
from pathlib import Path

from .places import ROOT

#: Folder of the repository to its place in the package, as in `setup.py`.
FOLDERS = {
    "sidtool": "sidtool",
    "formats": "sidtool/formats",
    "solver": "sidtool/solver",
    "examples": "sidtool/examples",
}
#: Endings of the files that the packages need.
NEEDED = {".css", ".html", ".js", ".md", ".py", ".toml", ".typed"}


def package_files() -> dict[str, str]:
    """Return the files of the packages: name in the sdist to name in the wheel."""
    found = {}
    for folder, package in FOLDERS.items():
        for path in (ROOT / folder).rglob("*"):
            own_sid = path.match("rod_*.SID_FEM")
            if path.suffix in NEEDED or own_sid or path.name == "py.typed":
                inside = path.relative_to(ROOT / folder).as_posix()
                found[f"{folder}/{inside}"] = f"{package}/{inside}"
    return found


def faults_of_wheel(path: Path) -> list[str]:
    """Return what is missing from a wheel, and what does not belong into it."""
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
    names = {entry.filename for entry in entries}
    faults = [f"missing: {n}" for n in package_files().values() if n not in names]
    for entry in entries:
        name = entry.filename
        if stat.S_ISLNK(entry.external_attr >> 16):
            faults.append(f"link: {name}")
        if not name.startswith("sidtool"):
            faults.append(f"outside of the package: {name}")
        if "/tests/" in name or "/test_" in name:
            faults.append(f"test: {name}")
    return faults


def faults_of_sdist(path: Path) -> list[str]:
    """Return the links of an sdist and the files of the packages that it lacks."""
    with tarfile.open(path, encoding="utf-8") as archive:
        members = archive.getmembers()
    names = {member.name.partition("/")[2] for member in members}
    links = [f"link: {m.name}" for m in members if m.issym() or m.islnk()]
    return links + [f"missing: {n}" for n in package_files() if n not in names]


def main() -> int:
    """Print the faults of a wheel and an sdist; the exit status is 1 if there are."""
    folder = Path(sys.argv[1])
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    faults = faults_of_wheel(wheel) + faults_of_sdist(sdist)
    print(*faults or [f"{wheel.name}, {sdist.name}: complete"], sep="\n")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
