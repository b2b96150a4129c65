"""Beams by stations, frames and cuts of solids, said differently.

A force pulls at the tip of a part that hangs on its root. In all descriptions its
sections carry the same, as it swings and at rest.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sidtool
from sidtool.formats.base.sid import Array
from sidtool.formats.model import ModelFile
from tests.sidtool.conversion.test_cuts import SOLIDS, solid
from tests.sidtool.elements.station_tables import LENGTH, eccentric, matrices
from tests.sidtool.frames import frame

Data = dict[str, Any]
#: Gravity [m/s^2] and the force at the tip [N], in the axes of the first description.
GRAVITY, PULL = np.array([1.0, -4.0, -9.0]), np.array([30.0, 70.0, -50.0])
#: Of the moving part [rad/s].
SPIN = np.array([0.4, -0.9, 1.3])
FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
#: The part beyond becomes the part before: x and z of the section change their
#: directions, and all forces, too.
REVERSED = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
#: Of the largest force and the largest moment.
ALLOWED = 1e-8


def carried(
    model: ModelFile, turn: Array, sections: list[str], load: float = 1.0
) -> Array:
    """Forces and moments at sections, (2, section, 6): as the part begins to swing
    about its root, undeformed, and at rest on a clamped root; gravity and force times
    `load`."""
    body, rate = sidtool.convert(model), turn @ SPIN
    part: Data = {"sid": body, "markers": {"root": 1, "tip": 2}}
    away = -body.node("1").position
    spin = {
        "initial": {
            "position": away.tolist(),
            "velocity": np.cross(rate, away).tolist(),
            "angular_velocity": rate.tolist(),
        }
    }
    pull = {
        "type": "force",
        "marker": "part.tip",
        "force": (load * turn @ PULL).tolist(),
    }
    names = [f"part.{s}.{f}" for s in sections for f in FORCES]

    def scene(kind: str, body: Data) -> sidtool.Scene:
        return sidtool.Scene(
            dimension="spatial",
            gravity=(load * turn @ GRAVITY).tolist(),
            time={"end": 1e-6, "output_step": 1e-6},
            bodies={"part": body},
            joints={"root": {"type": kind, "markers": ["ground", "part.root"]}},
            forces={"pull": pull},
            outputs={"record": names},
        )

    moving = sidtool.simulate(scene("spherical", part | spin))
    resting = sidtool.static_equilibrium(scene("fixed", part))
    found = [[moving[n][0] for n in names], [resting[n] for n in names]]
    return np.array(found).reshape(2, len(sections), 6)


def assert_same(found: Array, expected: Array) -> None:
    """Of the largest force and the largest moment in motion and at rest."""
    for a, b in zip(found, expected, strict=True):
        for kinds in (slice(0, 3), slice(3, 6)):
            size = np.abs(b[:, kinds]).max()
            assert size > 1e-5
            assert np.abs(a[:, kinds] - b[:, kinds]).max() < ALLOWED * size


def any_turn(seed: int) -> Array:
    random = np.random.default_rng([41, seed])
    return np.asarray(Rotation.random(random_state=random).as_matrix())


# Beams by stations -------------------------------------------------------------------

#: Elements end at whole metres.
STATIONS = [0.0, 2.0, 5.0, LENGTH]
UNITS: dict[str, tuple[str, float]] = {
    "position": ("mm", 1e3),
    "mass_per_length": ("g/mm", 1.0),
    "EA": ("MN", 1e-6),
    "EI_y": ("kN m^2", 1e-3),
    "EI_z": ("N mm^2", 1e6),
    "GJ": ("kN m^2", 1e-3),
    "GA_y": ("kN", 1e-3),
    "twist": ("deg", 180 / np.pi),
    "tension_y": ("mm", 1e3),
    "mass_z": ("cm", 1e2),
    "inertia_y": ("g m", 1e3),
}


def random_table(seed: int) -> dict[str, list[float]]:
    rng = np.random.default_rng([42, seed])
    table = {
        name: (column[0] * rng.uniform(0.6, 1.4, len(STATIONS))).tolist()
        for name, column in eccentric().items()
        if name != "position"
    }
    twist = rng.uniform(-0.5, 0.5, len(STATIONS)).tolist()
    return table | {"position": STATIONS, "twist": twist}


def by_matrices(table: dict[str, list[float]]) -> Data:
    return matrices(table) | {"twist": table["twist"]}


def blade(sections: Any, turn: Array, back: bool = False, **geometry: Any) -> ModelFile:
    ends = [turn[:, 0] * (LENGTH if end else 0.0) for end in (back, not back)]
    return ModelFile.checked(
        {
            "format": "sidtool model",
            "version": 1,
            "geometry": {
                "type": "beam",
                "start": ends[0].tolist(),
                "end": ends[1].tolist(),
                "y_axis": turn[:, 1].tolist(),
                "sections": sections,
            }
            | geometry,
            "discretisation": {"type": "beam", "elements": 8, "theory": "timoshenko"},
            "frame": {"type": "buckens"},
            "markers": {
                "root": {"node": 1, "edge": "end" if back else "start"},
                "tip": {"node": 2, "edge": "start" if back else "end"},
            },
            "reduction": {"method": "modal", "modes": 4},
            "section_forces": {
                "stations": [0.0, 0.25, 0.625, 1.0] if back else [0.0, 0.375, 0.75, 1.0]
            },
        },
        "blade",
    )


def about_tangent(angle: float) -> Array:
    return np.asarray(Rotation.from_rotvec([angle, 0.0, 0.0]).as_matrix())


def refined(table: Data) -> Data:
    """Rows at all whole metres, on the lines between the stations."""
    x = np.arange(LENGTH + 1.0)
    new = {
        name: np.array(
            [
                np.interp(x, STATIONS, entries)
                for entries in np.array(column).reshape(len(STATIONS), -1).T
            ]
        ).T.reshape(len(x), *np.shape(column)[1:])
        for name, column in table.items()
    }
    return {name: values.tolist() for name, values in new.items()} | {
        "position": x.tolist()
    }


def in_units(table: Data, folder: Path) -> str:
    """A file with its columns from the last to the first, in other units."""
    names = list(table)[::-1]
    units = {name: UNITS.get(name, ("", 1.0)) for name in names}
    heads = [f"{name} [{u}]" if u else name for name, (u, _) in units.items()]
    rows = zip(*(np.array(table[name]) * units[name][1] for name in names), strict=True)
    lines = [";".join(heads), *(";".join(repr(float(v)) for v in r) for r in rows)]
    (folder / "blade.csv").write_text("\n".join(lines), encoding="utf-8")
    return str(folder / "blade.csv")


def reversed_table(table: Data) -> Data:
    """From the tip to the root: x and z of the sections turn round, the twist too."""
    new = {name: list(column)[::-1] for name, column in table.items()}
    new["position"] = [LENGTH - x for x in new["position"]]
    for name in ("twist", "mass_z", "tension_z", "shear_z", "inertia_yz"):
        if name in new:
            new[name] = [-v for v in new[name]]
    velocities = np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0])
    for name, signs in (("stiffness", REVERSED), ("mass", velocities)):
        if name in new:
            new[name] = (np.array(new[name]) * np.outer(signs, signs)).tolist()
    return new


def in_order(table: Data, order: str) -> Data:
    """Matrices with the rows of another program: x and y of its section, z along."""
    rows = [1, 2, 0, 4, 5, 3]
    new = {n: np.array(table[n])[:, rows][:, :, rows] for n in ("stiffness", "mass")}
    return table | {n: m.tolist() for n, m in new.items()} | {"order": order}


def turned_matrices(table: Data, angle: float) -> Data:
    """In section axes that are turned about the tangent, with the opposite twist."""
    both = np.kron(np.eye(2), about_tangent(angle))
    new = {n: both.T @ np.array(table[n]) @ both for n in ("stiffness", "mass")}
    twist = [v + angle for v in table["twist"]]
    return table | {n: m.tolist() for n, m in new.items()} | {"twist": twist}


@pytest.mark.parametrize("kind", ["columns", "matrices"])
def test_equivalent_blades_by_stations_move_alike(tmp_path: Path, kind: str) -> None:
    seed = 0 if kind == "columns" else 1
    table = random_table(seed) if kind == "columns" else by_matrices(random_table(seed))
    one, turn = np.eye(3), any_turn(seed)
    sections = ["s1", "s2", "s3", "s4"]
    expected = carried(blade(table, one), one, sections)
    twisted = table | {"twist": [v - 0.4 for v in table["twist"]]}
    axis = {"y_axis": about_tangent(0.4)[:, 1].tolist()}
    ways = {
        "turned, with more stations": (blade(refined(table), turn), turn),
        "twist of the axis": (blade(twisted, one, **axis), one),
        "from the tip": (blade(reversed_table(table), one, back=True), one),
    }
    if kind == "columns":
        ways["units"] = blade(in_units(table, tmp_path), one), one
    else:
        ways["order"] = blade(in_order(table, "becas"), one), one
        ways["turned matrices"] = blade(turned_matrices(table, 0.3), one), one
    for name, (model, axes) in ways.items():
        found = carried(model, axes, sections)
        if name == "from the tip":
            found = found[:, ::-1] * REVERSED
        if name == "turned matrices":
            found = found @ np.kron(np.eye(2), about_tangent(0.3)).T
        assert_same(found, expected)


# Frames of beams ---------------------------------------------------------------------

MEMBERS = {
    "post": ("foot", "knee"),
    "boom": ("knee", "head"),
    "strut": ("foot", "head"),
    "arm": ("head", "tip"),
}
PLACES = (0.0, 0.25, 0.5, 1.0)


def crane(
    turn: Array,
    back: bool = False,
    order: int = 1,
    parted: bool = False,
    halves: bool = False,
) -> ModelFile:
    """A ring of three members and an arm, with a release, an offset, a mass and a
    spring.

    back : members from their ends to their starts
    order : of points, members and sections, 1 or -1
    parted : the arm is two members, elements are the same
    halves : the mass is two
    """
    points = {
        "foot": [0.0, 0.0, 0.0],
        "knee": [0.3, 0.2, 1.5],
        "head": [1.4, -0.3, 1.8],
        "middle": [2.0, 0.0, 1.9],
        "tip": [2.6, 0.3, 2.0],
    }
    if not parted:
        del points["middle"]
    sections: Data = {
        "box": {"shape": "box", "height": 0.06, "width": 0.04, "thickness": 0.004},
        "tee": {"shape": "T", "height": 0.07, "width": 0.06, "web": 0.005}
        | {"flange": 0.007, "fillet": 0.004},
    }
    more: dict[str, Data] = {
        "post": {"section": "box", "y_axis": [0.9, 0.1, 0.0]},
        "boom": {"section": "tee", "y_axis": [0.0, 0.2, 1.0]},
        "strut": {"section": "box", "y_axis": [0.0, 1.0, 0.0]}
        | {"releases": {"end": ["ry"]}},
        "arm": {"section": "tee", "y_axis": [0.0, 0.1, 0.9]}
        | {"offsets": {"start": [0.1, 0.0, 0.05]}, "elements": 8},
    }
    members = {name: (*ends, more[name]) for name, ends in MEMBERS.items()}
    if parted:
        start, end, entries = members["arm"]
        rest = {k: v for k, v in entries.items() if k != "offsets"}
        members["arm"] = (start, "middle", entries | {"elements": 4})
        members["arm2"] = ("middle", end, rest | {"elements": 4})
        points["middle"] = (
            (np.array(points["head"]) + [0.1, 0.0, 0.05] + points["tip"]) / 2
        ).tolist()
    opposite = {"start": "end", "end": "start"}
    for name, (start, end, entries) in members.items():
        entries["y_axis"] = (turn @ entries["y_axis"]).tolist()
        if "offsets" in entries:
            arm = entries["offsets"]["start"]
            entries["offsets"] = {"start": (turn @ arm).tolist()}
        if back:
            for key in ("releases", "offsets"):
                own = entries.get(key, {})
                if own:
                    entries[key] = {opposite[k]: v for k, v in own.items()}
            members[name] = (end, start, entries)
    mass: Data = {"point": "head", "offset": (turn @ [0.1, 0.2, 0.3]).tolist()}
    share = 0.5 if halves else 1.0
    mass |= {"mass": 9.0 * share, "inertia": [0.4 * share] * 3}
    masses = [mass] * (2 if halves else 1)
    points = {name: (turn @ x).tolist() for name, x in points.items()}
    places = [1.0 - x for x in PLACES[::-1]] if back else list(PLACES)

    def ordered(entries: Data) -> Data:
        return dict(list(entries.items())[::order])

    return frame(
        ordered(points),
        ordered(members),
        geometry={
            "sections": ordered(sections),
            "masses": masses,
            "springs": {"tie": {"points": ["knee", "tip"], "stiffness": 2e4}},
        },
        discretisation={"type": "beam", "elements": 4},
        frame={"type": "buckens"},
        markers={
            "root": {"node": 1, "point": "foot"},
            "tip": {"node": 2, "point": "tip"},
        },
        reduction={"method": "attachment", "interfaces": ["root", "tip"], "modes": 3},
        section_forces={"stations": places},
    )


def test_equivalent_frames_carry_the_same_section_forces() -> None:
    """Also from the ends of its members, and with a member in two.

    Sections in rings are exact for small deformations.
    """
    one, turn, small = np.eye(3), any_turn(2), 1e-5
    sections = [f"{name}.s{k}" for name in MEMBERS for k in range(1, 5)]
    expected = carried(crane(one), one, sections, small)
    found = carried(crane(turn, order=-1, halves=True), turn, sections, small)
    assert_same(found, expected)
    back = [f"{name}.s{k}" for name in MEMBERS for k in range(4, 0, -1)]
    found = carried(crane(one, back=True), one, back, small)
    assert_same(found * REVERSED, expected)
    parts = [*sections[:-3], "arm.s3", "arm2.s1", "arm2.s4"]
    found = carried(crane(one, parted=True), one, parts, small)
    assert_same(found, expected)


# Cuts of solids ----------------------------------------------------------------------


def cut_bar(turn: Array, cut: Data) -> ModelFile:
    model = solid(SOLIDS["hex8"], frame={"type": "buckens"})
    data = model.file_data()
    points = np.array(data["geometry"]["control_points"])
    data["geometry"]["control_points"] = (points @ turn.T).tolist()
    vectors = {key: (turn @ vector).tolist() for key, vector in cut.items()}
    return ModelFile.checked(data | {"section_forces": {"cuts": {"s": vectors}}}, "bar")


def test_equivalent_cuts_of_a_solid_carry_the_same() -> None:
    """Turned in space, by another point, by other axes, and from the other side."""
    one, turn = np.eye(3), any_turn(3)
    normal = np.array([0.9, 0.3, -0.2])
    point, y = np.array([0.37, 0.0, 0.0]), np.array([0.1, 1.0, 0.2])
    cut = {"point": point, "normal": normal, "y_axis": y}
    expected = carried(cut_bar(one, cut), one, ["s"])
    moved = cut | {"point": point + np.cross(normal, [0.3, -0.1, 0.7])}
    assert_same(carried(cut_bar(turn, moved), turn, ["s"]), expected)
    found = carried(cut_bar(one, cut | {"normal": -normal}), one, ["s"])
    assert_same(found * REVERSED, expected)
    n = normal / np.linalg.norm(normal)
    y = y - (y @ n) * n
    axes = Rotation.from_rotvec(0.7 * n).apply(y)
    found = carried(cut_bar(one, cut | {"y_axis": axes}), one, ["s"])
    turned = np.kron(np.eye(2), about_tangent(0.7))
    assert_same(found @ turned.T, expected)
