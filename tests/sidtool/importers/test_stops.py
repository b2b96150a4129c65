"""All reasons to refuse a deck are reported at once; content without effect is
skipped.
"""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only

from .mesh_files import BDF, cdb_text, inp_text, mesh_model, msh_2, rod_mesh

#: Cards of aerodynamics, optimisation, heat and output.
IDLE = """
    AERO AEROS CAERO1 PAERO1 SPLINE1 SPLINE2 MKAERO1 MKAERO2 FLUTTER FLFACT GUST MONPNT1
    DEFORM SLOAD RANDVAR RVDOF RVDOF1
    AESTAT AESURF AELIST TRIM TEMPRB TEMPBC CBARAO YPARAM PLOTOPT SEQGP DTI NLSTEP
    TSTEP1 DVTREL1 DMNCON DRESP DRESP2 DEQATN GROUP CHBDYE QBDY1 SET2
"""


def converted(folder: Path, name: str, text: str, **geometry: Any) -> SID:
    (folder / name).write_text(text, encoding="utf-8")
    path = mesh_model(
        folder,
        name,
        frame={"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": 10 if "rod" in name else 1}},
        reduction={"method": "modal", "modes": 2},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    data["geometry"].update(geometry)
    path.write_text(json.dumps(data), encoding="utf-8")
    return sid_from_model(path)


def test_cards_that_cannot_touch_a_body_are_listed(tmp_path: Path) -> None:
    names = IDLE.split()
    cards = "\n".join(f"{name},1" for name in names)
    text = BDF.replace("ENDDATA", f"{cards}\nENDDATA")
    sid = converted(tmp_path, "part.bdf", text)
    plain = converted(tmp_path, "plain.bdf", BDF)
    assert sid.mass == pytest.approx(plain.mass, rel=1e-14)
    keywords = only(sid, "N112").data["keywords"]
    assert isinstance(keywords, tuple) and set(names) <= set(keywords)


MESH = rod_mesh("hex8")
#: Decks with several names that are not supported.
REFUSED: dict[str, tuple[str, list[str]]] = {
    "part.bdf": (
        BDF.replace("ENDDATA", "CGAP,7,1,1,2\nRBE1,9,1,123456,2,3\nCWELD,9,1\nENDDATA"),
        ["CGAP", "RBE1", "CWELD"],
    ),
    "rod.inp": (
        "*EMBEDDED ELEMENT\n1, 2\n*SPRING, ELSET=X\n\n*WHATEVER\n3\n" + inp_text(MESH),
        ["EMBEDDED ELEMENT", "SPRING", "WHATEVER"],
    ),
    "part.cdb": (
        cdb_text() + "SECBLOCK,3\n(3i9)\n        1\nCERIG,1,2\nFOO,1\n",
        ["SECBLOCK", "CERIG", "FOO"],
    ),
    "rod.msh": (
        msh_2(MESH) + "$Foo\n1\n$EndFoo\n$Bar\n1\n$EndBar\n",
        ["Foo", "Bar"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_all_refusals_of_a_deck_are_reported_at_once(tmp_path: Path, name: str) -> None:
    text, refused = REFUSED[name]
    with pytest.raises(InputError) as caught:
        converted(tmp_path, name, text)
    message = str(caught.value)
    assert all(word in message for word in refused)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert converted(tmp_path, name, text, ignore=refused).mass > 0


def test_different_faults_of_one_deck_are_reported_together(tmp_path: Path) -> None:
    """An unknown card, a wrong number, a twice defined node, a fluid, a pin."""
    more = [
        "CGAP,7,1,1,2",
        "GRID,4,,0.,0.,2.",
        "GRID,50,,x,0.,2.",
        "PSOLID,8,5,,,,,PFLUID",
        "CORD2R,3,7,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.",
    ]
    text = BDF.replace("ENDDATA", "\n".join([*more, "ENDDATA"]))
    with pytest.raises(InputError) as caught:
        converted(tmp_path, "part.bdf", text)
    message = str(caught.value)
    assert all(word in message for word in ("CGAP", "node 4", "'x'", "PFLUID"))


def test_faults_that_differ_in_numbers_alone_are_counted(tmp_path: Path) -> None:
    rows = [f"GRID,{n},,x,0.,0." for n in range(100, 130)]
    text = BDF.replace("ENDDATA", "\n".join([*rows, "ENDDATA"]))
    with pytest.raises(InputError, match="29 more") as caught:
        converted(tmp_path, "part.bdf", text)
    assert len(str(caught.value)) < 400


def test_a_node_that_cannot_be_read_stops_its_bars_with_its_place(
    tmp_path: Path,
) -> None:
    """Its coordinates were kept and its directions were not: a traceback."""
    bars = "CBAR,8,6,1,2,0.,0.,1.\nPBAR,6,5,1.-3,1.-6,2.-6,3.-6\nENDDATA"
    text = BDF.replace("ENDDATA", bars)
    for odd in ("GRID,1,0.,0.,0.,0.", "GRID,1,,0.,0.,0.,x"):
        with pytest.raises(InputError) as caught:
            converted(tmp_path, "part.bdf", text.replace("GRID,1,,0.,0.,0.", odd))
        assert caught.value.place == "line 2"


def test_a_row_without_a_node_number_is_refused(tmp_path: Path) -> None:
    """A blank row between those of NBLOCK ended in a traceback."""
    lines = cdb_text().split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("(3i9"))
    text = "\n".join([*lines[: first + 2], " " * 90, *lines[first + 2 :]])
    with pytest.raises(InputError) as caught:
        converted(tmp_path, "part.cdb", text)
    assert caught.value.place is not None
