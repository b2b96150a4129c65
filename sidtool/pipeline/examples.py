"""Copies of the example folders."""

import shutil
import tempfile
from pathlib import Path

from sidtool.formats.base.errors import InputError
from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.operating_system import (
    is_writable_folder,
    path_problem,
    replace_file,
)
from sidtool.formats.storage.unreadable import failure_reason

#: Titles of the examples of `sidtool new`, by folder.
EXAMPLE_TITLES = {
    "slider_crank": "the founding example: a crank, a flexible rod, a piston",
    "robot_arm": "a spatial arm of two links from solids, with motors and payload",
    "con_rod": "a connecting rod from its outline, with bores, ties and stress",
    "imported_mesh": "one part from meshes of four programs",
    "light_rod": "the lightest connecting rod within a limit of stress",
    "arm_link": "the arm that comes to rest soonest, by its sections",
    "beam": "one bar on a wall, the smallest start",
    "imported_matrices": "a lattice mast from mass and stiffness matrices",
    "spinning_blade": "a beam that its rotation stiffens",
    "wind_turbine": "blades and a tower from tables of stations, at rated speed",
    "jib_crane": "a frame of beams with a load on a rope",
    "rotor": "a disc on a flexible shaft, and its critical speeds",
    "journal_bearing": "a rotor on films of oil, and the speed at which it whirls",
    "unbalance": "a rotor on bearings from a table over the speed",
    "helicopter": "three blades on a soft support, and their ground resonance",
    "satellite": "a free body with two panels and a reaction wheel",
    "four_bar": "a linkage with a flexible coupler, and events",
    "gear_train": "a motor, two shafts, a gear and a load in torsion",
    "valve_train": "a cam from a table, a rocker arm and a valve",
    "press": "a flywheel, a slide with dry friction, a part that is formed",
    "feed_axis": "a table on a ball screw, with its controller",
    "run_up": "a rotor with an unbalance through its critical speed",
    "scara": "a Nastran deck as a link, two motors with PD controllers",
    "delta_robot": "three flexible arms and six rods move a platform",
    "slewing_crane": "a turning jib with a load on a rope",
    "vehicle_axle": "an axle with springs and tyres on a road from a file",
    "tuned_damper": "a mast with a tuned mass damper in the wind",
    "parameter_study": "how long a move of a flexible arm shall take",
    "xylophone": "a bar that a notebook tunes",
    "controlled_arm": "an arm that a PID controller lifts",
}
#: Files of an example that are copied; commands create all others.
_COPIED_FILES = (
    "*.toml",
    "*.py",
    "*.ipynb",
    "*.md",
    "*_stations.csv",
    "*_table.csv",
    "rod_*.SID_FEM",
)
_PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
#: Folders of examples: in an installed package, and in a clone.
_EXAMPLES = (_PACKAGE_FOLDER / "examples", _PACKAGE_FOLDER.parent / "examples")


def example_folder(name: str) -> Path:
    """Return the folder of the files of an example.

    Raises
    ------
    InputError : sidtool was installed without its examples.
    """
    for folder in _EXAMPLES:
        if (folder / name / "README.md").is_file():
            return folder / name
    raise InputError(
        "the files of the example are not here",
        source=_EXAMPLES[0] / name,
        expected="sidtool from its repository or its wheel",
    )


def copy_example(folder: Path, start: str) -> list[str]:
    """Copy the files of an example into a new folder, all or nothing.

    Returns
    -------
    names of the copied files

    Raises
    ------
    InputError : the folder exists, cannot be made, or has the ending of a file.
    """
    source = example_folder(start)
    check_ending(folder, "folder")
    if problem := path_problem(folder):
        raise InputError(problem, source=folder, expected="another name")
    if folder.is_symlink() or folder.exists():
        raise InputError(
            "exists already", source=folder, expected="the name of a new folder"
        )
    names = sorted(path.name for own in _COPIED_FILES for path in source.glob(own))
    parent = folder.absolute().parent
    if parent.is_dir() and not is_writable_folder(parent):
        raise InputError(
            "cannot be made (Permission denied)",
            source=folder,
            expected="a name in a folder that can be written",
        )
    try:
        with tempfile.TemporaryDirectory(dir=parent, prefix=".sidtool-") as temporary:
            new_folder = Path(temporary) / "new"
            new_folder.mkdir()
            for name in names:
                shutil.copyfile(source / name, new_folder / name)
            replace_file(new_folder, folder)
    except OSError as error:
        raise InputError(
            f"cannot be made ({failure_reason(error)})",
            source=folder,
            expected="a name in a folder that can be written",
        ) from None
    return names
