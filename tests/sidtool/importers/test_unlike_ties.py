"""*TIE of sides whose elements are of other kinds: quadratic ones on each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.mesh.reference_elements import shape_of
from tests.metamorphic.parts.meshes import split, with_middles

from .decks import MATERIAL, STEEL, Block, body, frequencies, listed
from .test_import_ties import AWAY, SECTIONS, SIZE, discretised, stretched

NAMES = {"tet10": "C3D10", "hex20": "C3D20", "wedge15": "C3D15", "hex8": "C3D8I"}
#: The corners of the faces S1, S2, ... of an element, from 1.
FACES = {
    "tet": ("123", "142", "243", "341"),
    "hex": ("1234", "5876", "1562", "2673", "3784", "4851"),
    "wedge": ("123", "465", "1452", "2563", "3641"),
}


class Part:
    """A block of one kind of element from x = start on; its planes x = const."""

    def __init__(
        self,
        kind: str,
        counts: tuple[int, int, int],
        start: float,
        first: int,
        shaken: float = 0.0,
    ) -> None:
        block = Block(counts, SIZE)
        points = np.array(block.points)
        step = np.array(SIZE) / counts
        inner = (points > 1e-9) & (points < np.array(SIZE) - 1e-9)
        shift = np.random.default_rng(first + 1).uniform(-shaken, shaken, points.shape)
        points = points + shift * step * inner
        cells = [[n - 1 for n in cell] for cell in block.elements]
        points, rows = split(points, cells, shape_of(kind))
        self.points, self.rows = with_middles(points, rows, kind)
        self.points[:, 0] += start
        self.kind, self.first = kind, first

    def plane(self, x: float) -> list[int]:
        there = np.flatnonzero(np.abs(self.points[:, 0] - x) < 1e-9)
        return [int(n) + self.first + 1 for n in there]

    def surface(self, name: str, x: float) -> str:
        lines = [f"*SURFACE, NAME={name}"]
        for i, row in enumerate(self.rows, self.first + 1):
            for k, face in enumerate(FACES[shape_of(self.kind)], 1):
                corners = self.points[[row[int(c) - 1] for c in face]]
                if np.all(np.abs(corners[:, 0] - x) < 1e-9):
                    lines.append(f"{i}, S{k}")
        return "\n".join([*lines, ""])

    def text(self) -> str:
        lines = ["*NODE"]
        for i, point in enumerate(self.points.tolist(), self.first + 1):
            lines.append(f"{i}, " + ", ".join(map(repr, point)))
        lines.append(f"*ELEMENT, TYPE={NAMES[self.kind]}, ELSET=E")
        for i, row in enumerate(self.rows, self.first + 1):
            words = [str(i), *(str(n + self.first + 1) for n in row)]
            pieces = [", ".join(words[k : k + 8]) for k in range(0, len(words), 8)]
            lines.append(",\n".join(pieces))
        return "\n".join([*lines, ""])


def tied(left: Part, right: Part, slave: int) -> str:
    names = "A, B" if slave == 0 else "B, A"
    end = float(right.points[:, 0].max())
    return "".join(
        [
            left.text(),
            right.text(),
            left.surface("A", SIZE[0]),
            right.surface("B", SIZE[0]),
            f"*TIE, NAME=T\n{names}\n",
            listed("START", left.plane(0.0)),
            listed("END", right.plane(end)),
            MATERIAL.format(**STEEL),
            SECTIONS,
        ]
    )


@pytest.mark.parametrize("slave", [0, 1])
@pytest.mark.parametrize(
    ("kinds", "counts"),
    [
        (("tet10", "hex20"), ((1, 1, 1), (1, 2, 1))),
        (("hex20", "tet10"), ((1, 2, 3), (1, 3, 1))),
        (("tet10", "tet10"), ((1, 1, 2), (1, 2, 1))),
        (("wedge15", "hex20"), ((1, 2, 1), (1, 1, 2))),
        (("hex8", "tet10"), ((2, 2, 2), (1, 1, 3))),
    ],
)
def test_a_uniform_stress_passes_a_tie_of_other_elements(
    kinds, counts, slave: int, tmp_path: Path
) -> None:
    """Exactly: the displacement under unit tension is linear."""
    parts = Part(kinds[0], counts[0], 0.0, 0), Part(kinds[1], counts[1], SIZE[0], AWAY)
    found, exact = stretched(discretised(tmp_path, tied(*parts, slave)))
    assert_allclose(found, exact, atol=1e-8 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("kinds", "slave"), [(("tet10", "hex20"), 1), (("hex20", "tet10"), 1)]
)
def test_a_tie_of_other_elements_on_skew_faces(kinds, slave: int, tmp_path) -> None:
    """Skew faces map their functions to no polynomials of the common parts, whose
    integrals then are as good as their quadrature."""
    parts = (
        Part(kinds[0], (1, 2, 2), 0.0, 0, 0.25),
        Part(kinds[1], (1, 3, 3), SIZE[0], AWAY, 0.25),
    )
    found, exact = stretched(discretised(tmp_path, tied(*parts, slave)))
    assert_allclose(found, exact, atol=2e-4 * np.abs(exact).max())


def test_a_bar_that_is_tied_of_other_elements_bends_as_a_whole_one(tmp_path) -> None:
    """Reference: the bar without a tie, finer. Frequencies come down to its own, as
    cubically as those of quadratic elements do, whichever side is the slave."""
    one = Part("hex20", (12, 2, 2), 0.0, 0)
    one.points[:, 0] *= 2
    text = one.text() + MATERIAL.format(**STEEL) + SECTIONS
    exact = frequencies(body(tmp_path, text))
    errors = []
    for n, slaves in ((2, (0, 1)), (4, (0,))):
        parts = (
            Part("tet10", (n, n // 2, 1 + n // 2), 0.0, 0),
            Part("hex20", (n, 1 + n // 2, n // 2), SIZE[0], AWAY),
        )
        for slave in slaves:
            found = frequencies(body(tmp_path, tied(*parts, slave)))
            errors.append(found / exact - 1)
    coarse, other, fine = errors
    assert_allclose(other, coarse, atol=3e-3)
    assert np.all(coarse < 0.1)
    assert np.all((fine > -2e-4) & (fine < coarse / 8))
