"""The folders at the top of the repository as one package; all else: pyproject.toml."""

from pathlib import Path

from setuptools import find_namespace_packages, setup

#: Package to folder. Links would say the same, but Windows makes text files of them.
FOLDERS = {
    "sidtool": "sidtool",
    "sidtool.formats": "formats",
    "sidtool.solver": "solver",
    "sidtool.examples": "examples",
}

packages = []
for package, folder in FOLDERS.items():
    inner = find_namespace_packages(folder, exclude=["*__pycache__*"])
    if not any(Path(folder).glob("*/*.*")):
        raise SystemExit(f"{folder}/ is missing or empty: this copy is not complete")
    packages += [package, *(f"{package}.{name}" for name in inner)]

setup(packages=packages, package_dir=FOLDERS)
