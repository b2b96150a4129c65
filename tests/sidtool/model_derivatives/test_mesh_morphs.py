"""Shapes of imported meshes as design variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.model_derivatives.sid_derivatives import parse_quantities
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.sidtool.importers.test_import_ties import AWAY, SIZE, Part, surface_tie
from tests.sidtool.model_derivatives.references import central_difference

#: An imaginary step that gets lost is a wrong derivative.
pytestmark = pytest.mark.filterwarnings("error::numpy.exceptions.ComplexWarning")

LENGTH, WIDTH, HEIGHT = 0.4, 0.02, 0.03
MATERIAL = [
    "*MATERIAL, NAME=STEEL",
    "*ELASTIC",
    "2.1e11, 0.3",
    "*DENSITY",
    "7850.",
]
WOOD = [
    "*MATERIAL, NAME=WOOD",
    "*ELASTIC, TYPE=ENGINEERING CONSTANTS",
    "1.2e10, 1.e9, 9.e8, 0.3, 0.25, 0.4, 5.e8, 4.e8",
    "3.e8",
    "*DENSITY",
    "600.",
    "*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL",
    "0., -0.1, -0.2, 0., -0.1, 1.",
]
#: A place in the undeformed bar -> its place.
Place = Callable[[Array], Any]
KEY = "geometry.morphs.change.amount"


def bar_deck(path: Path, place: Place, elements: tuple[int, int, int]) -> None:
    """Write a bar of C3D8I with the node sets ROOT and TIP."""
    shape = tuple(count + 1 for count in elements)
    numbers = np.arange(1, 1 + np.prod(shape)).reshape(shape)
    lines = ["*NODE"]
    for (i, j, k), number in np.ndenumerate(numbers):
        share = np.array([i, j, k]) / elements - [0, 0.5, 0.5]
        x, y, z = place(share * [LENGTH, WIDTH, HEIGHT])
        lines.append(f"{number}, {float(x)!r}, {float(y)!r}, {float(z)!r}")
    lines.append("*ELEMENT, TYPE=C3D8I, ELSET=ALL")
    for number, (i, j, k) in enumerate(np.ndindex(elements), start=1):
        low = numbers[i : i + 2, j : j + 2, k : k + 2]
        corners = [*low[:, 0, 0], *low[::-1, 1, 0], *low[:, 0, 1], *low[::-1, 1, 1]]
        lines.append(", ".join(map(str, [number, *corners])))
    for name, row in (("ROOT", 0), ("TIP", -1)):
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in numbers[row].ravel())]
    lines += [*MATERIAL, "*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plate_deck(path: Path, place: Place) -> None:
    """Write a curved plate of S4 and S3, whose end follows the reference node 99."""
    rows, columns = 5, 3
    lines = ["*NODE"]
    for i, j in np.ndindex(rows, columns):
        x, y, z = place(np.array([0.08 * i, 0.04 * j, 0.01 * np.sin(i)]))
        lines.append(f"{columns * i + j + 1}, {x!r}, {y!r}, {z!r}")
    x, y, z = place(np.array([0.35, 0.04, 0.0]))
    lines += [f"99, {x!r}, {y!r}, {z!r}", "*ELEMENT, TYPE=S4, ELSET=ALL"]
    near = [columns * i + j + 1 for i, j in np.ndindex(rows - 1, columns - 1)]
    quads = [(n, n + columns, n + columns + 1, n + 1) for n in near]
    lines += [f"{k}, {a}, {b}, {c}, {d}" for k, (a, b, c, d) in enumerate(quads[1:], 1)]
    a, b, c, d = quads[0]
    lines += [
        "*ELEMENT, TYPE=S3, ELSET=ALL",
        f"50, {a}, {b}, {c}",
        f"51, {a}, {c}, {d}",
    ]
    lines += ["*NSET, NSET=ROOT", "1, 2, 3", "*NSET, NSET=TIP", "13, 14, 15"]
    lines += ["*SURFACE, NAME=S, TYPE=NODE", "TIP"]
    lines += ["*COUPLING, CONSTRAINT NAME=C, REF NODE=99, SURFACE=S", "*KINEMATIC"]
    lines += ["1, 6", *MATERIAL, "*SHELL SECTION, ELSET=ALL, MATERIAL=STEEL", "0.004"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def bars_deck(path: Path, place: Place) -> None:
    """Write an angle of CBAR and CROD with a mass that an RBE3 holds."""
    lines = ["BEGIN BULK", "MAT1,1,2.1+11,,0.3,7850."]
    places = [0, 0, 0], [0.2, 0, 0], [0.4, 0.1, 0], [0.5, 0.3, 0.1], [0.6, 0.3, 0]
    for n, at in enumerate(places, 1):
        x, y, z = place(np.array(at, float))
        lines.append(f"GRID,{n},,{x:.12g},{y:.12g},{z:.12g}")
    lines.append("PBAR,1,1,4.-4,1.-8,2.-8,3.-8")
    lines += [f"CBAR,{n},1,{n},{n + 1},0.,0.,1." for n in (1, 2, 3)]
    lines += ["PROD,2,1,3.-4,1.-8", "CROD,4,2,1,4", "CONM2,9,5,,0.5"]
    lines += ["RBE3,8,,5,123456,1.,123,2,3,", ",4", "ENDDATA"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def model(
    file: Path, morph: Mapping[str, Any], root: Any, tip: Any, clamp: str = "ROOT"
) -> ModelFile:
    """Return a model of a mesh file with one morph, clamped at its root."""
    frame: dict[str, Any] = {"type": "tangent", "marker": "root"}
    table = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {
            "type": "mesh",
            "file": str(file),
            "morphs": {"change": dict(morph)},
        },
        "discretisation": {"type": "mesh"},
        "frame": frame | ({"clamp": clamp} if clamp else {}),
        "markers": {"root": {"node": 1, **root}, "tip": {"node": 2, **tip}},
        "reduction": {
            "method": "craig_bampton",
            "interfaces": ["tip"] if clamp else ["root", "tip"],
            "modes": 2,
        },
    }
    return validate_data(table, ModelFile)


def tie(name: str) -> dict[str, Any]:
    return {"tie": {"type": "rigid", "to": name}}


def bar(
    folder: Path,
    morph: Mapping[str, Any],
    place: Place = lambda x: x,
    elements: tuple[int, int, int] = (5, 1, 2),
) -> ModelFile:
    bar_deck(folder / "bar.inp", place, elements)
    return model(folder / "bar.inp", morph, tie("ROOT"), tie("TIP"))


def skewed(x: Array) -> Any:
    """A bar whose elements have no right angles and whose section varies."""
    return x + [2 * x[1] * x[0], 0.3 * x[0] ** 2 + x[2] * x[0], x[1] * x[0]]


def test_all_lengths_twice_as_long(tmp_path: Path) -> None:
    """Dimensions: mass ~ a^3, frequencies ~ 1/a, compliances ~ 1/a."""
    content = bar(tmp_path, {"file": str(tmp_path / "big.inp")}, skewed)
    bar_deck(tmp_path / "big.inp", lambda x: 2 * np.asarray(skewed(x)), (5, 1, 2))
    found = sidtool.sid_derivatives(content, [KEY])
    powers = {"mass": 3, "inertia(zz)": 5, "compliance(tip.y)": -1}
    powers |= {f"frequency({k})": -1 for k in (1, 2, 5, 8)}
    for name, power in powers.items():
        slope = found.derivative(name, KEY) / found.value(name)
        assert slope == pytest.approx(power, rel=1e-9)
    whole = sid_from_model(content.with_({KEY: 1.0}))
    assert whole.mass == pytest.approx(8 * found.sid.mass, rel=1e-12)


def test_sets_that_move_apart_stretch_the_mesh_evenly(tmp_path: Path) -> None:
    """Linear functions solve Laplace's equation without flux through the sides."""
    moves = {"ROOT": [0.0, 0.0, 0.0], "TIP": [1.0, 0.0, 0.0]}
    inside = lambda x: x + [0.05 * np.sin(9 * x[0]) * x[0] * (LENGTH - x[0]), 0, 0]  # noqa: E731
    content = bar(tmp_path, {"moves": moves}, inside)
    plain = finite_element_model(content).positions
    moved = finite_element_model(content.with_({KEY: 0.1})).positions
    stretch = np.array([1 + 0.1 / LENGTH, 1, 1])
    np.testing.assert_allclose(moved, plain * stretch, atol=1e-14)
    found = sidtool.sid_derivatives(content, [KEY])
    slope = found.derivative("mass", KEY) / found.value("mass")
    assert slope == pytest.approx(1 / LENGTH, rel=1e-12)


def strip_deck(path: Path, place: Place) -> None:
    """Write a plane strip of CPS4 that are numbered clockwise."""
    lines = ["*NODE"]
    for n, corner in enumerate(np.ndindex(3, 2), start=1):
        x, y = place(np.array(corner) * [0.2, 0.03])
        lines.append(f"{n}, {float(x)!r}, {float(y)!r}")
    lines += ["*ELEMENT, TYPE=CPS4, ELSET=ALL", "1, 1, 2, 4, 3", "2, 3, 4, 6, 5"]
    lines += ["*NSET, NSET=ROOT", "1, 2", "*NSET, NSET=TIP", "5, 6", *MATERIAL]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL", "0.01"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize("by", ["file", "moves"])
def test_clockwise_elements(by: str, tmp_path: Path) -> None:
    strip_deck(tmp_path / "strip.inp", lambda x: x)
    strip_deck(tmp_path / "long.inp", lambda x: x * [1.5, 1])
    moves = {"ROOT": [0.0, 0.0], "TIP": [0.2, 0.0]}
    morph = {"file": str(tmp_path / "long.inp")} if by == "file" else {"moves": moves}
    content = model(tmp_path / "strip.inp", morph, tie("ROOT"), tie("TIP"))
    plain = finite_element_model(content).positions
    moved = finite_element_model(content.with_({KEY: 1.0})).positions
    np.testing.assert_allclose(moved, plain * [1.5, 1], atol=1e-15)
    with pytest.raises(InputError):  # mirrored
        finite_element_model(content.with_({KEY: -3.0}))


def _bend(x: Array) -> Any:
    return x * [1.3, 0.8, 1.5] + [0, 0.1 * x[0], 0.2 * x[0] ** 2]


def _plate(folder: Path) -> ModelFile:
    for name, place in (("one", lambda x: x), ("other", _bend)):
        plate_deck(folder / f"{name}.inp", lambda x, f=place: np.asarray(f(x)).tolist())
    morph = {"file": str(folder / "other.inp")}
    return model(folder / "one.inp", morph, {"mesh_node": 2}, {"mesh_node": 99})


def _bars(folder: Path) -> ModelFile:
    for name, place in (("one", lambda x: x), ("other", _bend)):
        bars_deck(folder / f"{name}.bdf", place)
    morph = {"file": str(folder / "other.bdf")}
    own = {"mesh_node": 1}, {"mesh_node": 3}
    return model(folder / "one.bdf", morph, *own, clamp="")


def _sets(folder: Path) -> ModelFile:
    moves = {"ROOT": [0.0, 0.0, 0.0], "TIP": [0.2, 0.1, 0.3]}
    return bar(folder, {"moves": moves}, skewed)


def _tied(folder: Path) -> ModelFile:
    """Two bars with cylindrical axes of their material, which a tie joins; one slides
    on the other and grows.
    """
    for name, slide in (("one", 0.0), ("other", 0.02)):
        first, last = Part((2, 1, 1), 0, 0), Part((1, 2, 2), SIZE[0], AWAY, (0.3,) * 3)
        places = np.array(last.points) * [1, 0.4 + 2 * slide, 0.3]
        last.points = [tuple(p) for p in (places + [0, slide - 0.035, -0.03]).tolist()]
        lines = ["*NSET, NSET=ROOT", *(f"{n}," for n in first.left), "*NSET, NSET=TIP"]
        lines += [*(f"{n}," for n in last.right), *WOOD]
        lines += ["*SOLID SECTION, ELSET=E, MATERIAL=WOOD, ORIENTATION=O", ""]
        text = first.text() + last.text() + surface_tie((first, last))
        (folder / f"{name}.inp").write_text(text + "\n".join(lines), encoding="utf-8")
    morph = {"file": str(folder / "other.inp")}
    return model(folder / "one.inp", morph, tie("ROOT"), tie("TIP"))


@pytest.mark.parametrize("make", [_plate, _bars, _sets, _tied])
def test_derivatives_are_those_of_neighbours(
    make: Callable[[Path], ModelFile], tmp_path: Path
) -> None:
    content = make(tmp_path)
    names = ["mass", "compliance(tip.y)", "inertia(xx)"]
    names += [f"frequency({k})" for k in (1, 2, 3, 7)]
    nodes = {name: str(marker.node) for name, marker in content.markers.items()}

    def values(sid: SID) -> dict[str, Any]:
        found = parse_quantities(names, sid, nodes)
        return {one.text: np.array(one.evaluate(sid, sid)[0]) for one in found}

    found = sidtool.sid_derivatives(content, [KEY])
    neighbours = central_difference(
        content, KEY, lambda one: values(sid_from_model(one)), relative=0.1
    )
    for name, slope in neighbours.items():
        assert found.derivative(name, KEY) == pytest.approx(float(slope), rel=1e-6)


MOVES = {"ROOT": [0.0, 0.0, 0.0], "TIP": [1.0, 0.0, 0.0]}


@pytest.mark.parametrize(
    ("morph", "place"),
    [
        ({"moves": MOVES | {"LID": [0.0, 0.0, 0.0]}}, ".moves"),
        ({"moves": MOVES | {"TIP": [1.0, 0.0]}}, ".moves.TIP"),
        ({"moves": MOVES | {"ALL": [1.0, 0.0, 0.0]}}, ".moves.ALL"),
        ({"file": "coarse.inp"}, ".file"),
        ({"file": "bar.inp"}, ""),
        ({"moves": {"ROOT": [0.0, 0.0, 0.0]}}, ""),
    ],
)
def test_morphs_that_do_not_fit(
    morph: dict[str, Any], place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bar_deck(tmp_path / "coarse.inp", lambda x: x, (4, 1, 2))
    with pytest.raises(InputError) as caught:
        finite_element_model(bar(tmp_path, morph))
    assert caught.value.place == f"geometry.morphs.change{place}"


@pytest.mark.parametrize("morph", [{}, {"file": "other.inp", "moves": MOVES}])
def test_a_morph_has_one_direction(morph: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        bar(tmp_path, morph)
    assert caught.value.place == "geometry.morphs.change"


def test_elements_that_fold_name_the_morphs(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        finite_element_model(bar(tmp_path, {"moves": MOVES, "amount": -2 * LENGTH}))
    assert caught.value.place == "mesh with geometry.morphs"


def test_parts_without_a_moved_set(tmp_path: Path) -> None:
    """Two bars that a tie joins: Laplace's equation does not cross the tie."""
    content = bar(tmp_path, {"moves": {"ROOT": [1.0, 0.0, 0.0]}, "amount": 0.01})
    deck = tmp_path / "bar.inp"
    text = deck.read_text(encoding="utf-8").replace("*NODE\n", "*NODE\n900,9,9,9\n", 1)
    lines = ["*NODE", "901,5,0,0", "902,6,0,0", "903,5,1,0", "904,5,0,1"]
    lines += ["*ELEMENT, TYPE=C3D4, ELSET=ALL", "900, 901, 902, 903, 904"]
    deck.write_text(text + "\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        finite_element_model(content)
    assert caught.value.place == "geometry.morphs.change.moves"
