"""Tables over time from files and by formulas, and curves of springs by formulas."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np

from sidtool.formats.scene import SceneFile
from tests.metamorphic.generator.case import Case, Table
from tests.metamorphic.generator.ingredients import Random
from tests.metamorphic.generator.said import Said, copied, with_table

#: Values in files are so many times as large.
LARGER = 8.0
#: How far curves of springs go on in tables [m].
BEYOND = 10.0


def signals(case: Case, rng: Random) -> Said | None:
    """Tables over time from files or, of forces, looked up; curves of springs too."""
    table = copied(case)
    table["tables"] = {}
    with TemporaryDirectory() as folder:
        for part in ("drives", "forces"):
            for name, entry in list(table[part].items()):
                function = entry.get("function", {})
                if function.get("type") == "table":
                    if part == "forces" and rng.random() < 0.5:
                        entry["function"] = _formula(table, name, function)
                    else:
                        ending = str(rng.choice(["csv", "h5"]))
                        file = Path(folder, f"{name}.{ending}")
                        entry["function"] = _from_file(file, function)
                elif entry.get("type") == "spring_damper" and "table" in entry:
                    _with_curve(table, name)
        read = SceneFile.model_validate(table)
    for part in ("drives", "forces"):
        for name, entry in table[part].items():
            if "file" in entry.get("function", {}):
                entry["function"] = read.file_data()[part][name]["function"]
    return (
        None if table == case.table | {"tables": {}} else Said(with_table(case, table))
    )


def _formula(table: Table, name: str, function: Table) -> Table:
    table["tables"][name] = {
        "x": function["times"],
        "values": function["values"],
        "interpolation": function.get("interpolation", "linear"),
    }
    return {"type": "expression", "value": f"lookup({name}, t)"}


def _from_file(file: Path, function: Table) -> Table:
    """The times in ms; a scene keeps the numbers when it is read."""
    new = {k: v for k, v in function.items() if k not in ("times", "values")}
    t = 1e3 * np.array(function["times"])
    z = LARGER * np.array(function["values"])
    names = {"time": "run/t", "value": "z"}
    if file.suffix == ".h5":
        with h5py.File(file, "w") as content:
            content["run/t"], content["z"] = t, z
            content["run/t"].attrs["units"] = "ms"
    else:
        rows = [f"{b!r};{a!r}" for a, b in zip(t.tolist(), z.tolist(), strict=True)]
        file.write_text("\n".join(["z;run/t [ms]", *rows]), encoding="utf-8")
    return new | names | {"file": str(file), "scale": 1.0 / LARGER}


def _with_curve(table: Table, name: str) -> None:
    """An actuator that looks the force up at its own length, and a damper.

    The curve of a spring goes on in straight lines, a table does not: it gets points
    beyond both ends.
    """
    force = table["forces"][name]
    x, y = (np.array(force["table"][key]) for key in ("deflection", "force"))
    points = np.concatenate([x[0] - BEYOND, x, x[-1] + BEYOND], axis=None)
    slopes = np.diff(y)[[0, -1]] / np.diff(x)[[0, -1]]
    first, last = y[[0, -1]] + slopes * [-BEYOND, BEYOND]
    values = np.concatenate([first, y, last], axis=None)
    table["tables"][name] = {"x": points.tolist(), "values": values.tolist()}
    value = f"-lookup({name}, {name}.length - rest)"
    law = {"type": "expression", "value": value, "parameters": {"rest": force["rest"]}}
    where = {"markers": force["markers"]}
    table["forces"][name] = {"type": "actuator", "function": law} | where
    damper = {"type": "spring_damper", "damping": force["damping"]}
    table["forces"][f"{name}_damper"] = damper | where
