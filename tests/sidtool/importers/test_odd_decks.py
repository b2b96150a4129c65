"""Decks that cannot be read end in a message, and they do end."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.importers.calculix_engine import read_frd
from sidtool.importers.mesh_files import read_mesh
from tests.places import posix

from .mesh_files import FORMATS, bdf_text, inp_text, rod_mesh

HUGE = "100000000000000000000"


@pytest.mark.parametrize("file", ["inp", "msh 2.2", "msh 4.1"])
@pytest.mark.parametrize("label", ["10", "1"])
def test_labels_beyond_64_bits_are_refused(
    tmp_path: Path, file: str, label: str
) -> None:
    """Node 10 is the first of each file, element 1 likewise."""
    name, writer = FORMATS[file]
    lines = writer(rod_mesh("hex8")).splitlines()
    first = lines.index("$Nodes") if "$Nodes" in lines else 0
    at = next(
        i
        for i, line in enumerate(lines)
        if i > first and line.replace(",", " ").split()[:1] == [label]
    )
    lines[at] = lines[at].replace(label, HUGE, 1)
    (tmp_path / name).write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_mesh(tmp_path / name)
    assert HUGE in caught.value.problem
    assert caught.value.place == f"line {at + 1}"


def _inp(name: str) -> str:
    return f"*INCLUDE, INPUT={name}\n"


def _bdf(name: str) -> str:
    return f"INCLUDE '{name}'\n"


@pytest.mark.parametrize(("ending", "line"), [("inp", _inp), ("bdf", _bdf)])
def test_a_cascade_of_includes_ends(
    tmp_path: Path, ending: str, line: Callable[[str], str]
) -> None:
    for i in range(8):
        (tmp_path / f"part{i}.{ending}").write_text(
            line(f"part{i + 1}.{ending}") * 9, encoding="utf-8"
        )
    (tmp_path / f"part8.{ending}").write_text(
        "** nothing\n" if ending == "inp" else "$ nothing\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match="takes in more than 1000 files"):
        read_mesh(tmp_path / f"part0.{ending}")
    (tmp_path / f"part8.{ending}").write_text(line(f"part7.{ending}"), encoding="utf-8")
    with pytest.raises(InputError, match="includes itself"):
        read_mesh(tmp_path / f"part0.{ending}")


def test_one_file_may_be_taken_in_twice(tmp_path: Path) -> None:
    (tmp_path / "words.inc").write_text("*HEADING\na rod\n", encoding="utf-8")
    (tmp_path / "rod.inp").write_text(
        _inp("words.inc") * 2 + inp_text(rod_mesh("hex8")), encoding="utf-8"
    )
    assert len(read_mesh(tmp_path / "rod.inp").mesh.positions) == 28


@posix
@pytest.mark.parametrize("ending", ["inp", "msh", "bdf", "cdb"])
def test_a_mesh_is_no_pipe(tmp_path: Path, ending: str) -> None:
    os.mkfifo(tmp_path / f"rod.{ending}")
    with pytest.raises(InputError, match="is a pipe or a device"):
        read_mesh(tmp_path / f"rod.{ending}")


def test_a_member_of_a_set_is_a_number_or_a_name(tmp_path: Path) -> None:
    text = inp_text(rod_mesh("hex8"))
    for word in ("\u00b2", "--5", HUGE):
        (tmp_path / "rod.inp").write_text(
            text.replace("=LEFT\n", f"=LEFT\n{word}, "), encoding="utf-8"
        )
        with pytest.raises(InputError, match="line"):
            read_mesh(tmp_path / "rod.inp")


#: What a deck of somebody else may name: none of it may get into a message.
SECRETS = {
    "passwd": "root:x:0:0:Carmen:/root\ndaemon:x:1:1::/\n",
    "key": "-----BEGIN PRIVATE KEY-----\nMIIEvQIBADANBgkqhkiG9w0BAQEFAASC\n",
    "word": "hunter2hunter\n",
    "settings": "[db]\npassword = Carmen\n",
    "list": "Carmen, Josefa, 7\n",
}
_NODE = "*NODE\n1, 0, 0, 0\n"
TAKING = {
    "inp alone": "{0}",
    "inp nodes": "*NODE\n{0}",
    "inp input": "*NODE, INPUT=secret.txt\n",
    "inp elements": _NODE + "*ELEMENT, TYPE=C3D8, INPUT=secret.txt\n",
    "inp set": _NODE + "*NSET, NSET=A\n{0}",
    "inp constants": _NODE + "*MATERIAL, NAME=A\n*ELASTIC\n{0}",
    "inp equation": _NODE + "*EQUATION\n{0}",
    "inp surface": _NODE + "*SURFACE, NAME=S\n{0}",
    "bdf": "BEGIN BULK\nINCLUDE 'secret.txt'\n",
    "bdf card": "BEGIN BULK\nGRID,1,,0.,0.,0.\nINCLUDE 'secret.txt'\n",
}


@pytest.mark.parametrize("secret", SECRETS)
@pytest.mark.parametrize("deck", TAKING)
def test_included_text_is_not_quoted(deck: str, secret: str, tmp_path: Path) -> None:
    (tmp_path / "secret.txt").write_text(SECRETS[secret], encoding="utf-8")
    path = tmp_path / f"deck.{deck[:3]}"
    path.write_text(TAKING[deck].format(_inp("secret.txt")), encoding="utf-8")
    with pytest.raises(InputError) as raised:
        read_mesh(path)
    message = str(raised.value).upper().replace(str(path).upper(), "")
    for word in re.findall(r"\w{4,}", SECRETS[secret].upper()):
        assert word[:6] not in message
    if "root" in SECRETS[secret]:
        assert "X:0" not in message


def test_keywords_and_numbers_of_included_files_are_quoted(tmp_path: Path) -> None:
    (tmp_path / "part.inc").write_text("*CRACKING LAW\n*NODE\n1, 2\n", encoding="utf-8")
    (tmp_path / "deck.inp").write_text(_inp("part.inc"), encoding="utf-8")
    with pytest.raises(InputError, match=r"part\.inc, line 1: \*CRACKING LAW"):
        read_mesh(tmp_path / "deck.inp")


@pytest.mark.parametrize(("ending", "include"), [("inp", _inp), ("bdf", _bdf)])
def test_files_are_found_in_the_spelling_of_windows(
    tmp_path: Path, ending: str, include: Callable[[str], str]
) -> None:
    mesh = rod_mesh("hex8")
    text = inp_text(mesh) if ending == "inp" else bdf_text(mesh)
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
    whole = tmp_path / "second" / f"rod.{ending}"
    whole.write_text(text, encoding="utf-8")
    deck = tmp_path / "first" / f"a.{ending}"
    deck.write_text(include(f"..\\second\\rod.{ending}"), encoding="utf-8")
    found, expected = read_mesh(deck).mesh, read_mesh(whole).mesh
    assert (found.positions == expected.positions).all()
    assert (found.blocks[0].nodes == expected.blocks[0].nodes).all()


@pytest.mark.parametrize(("ending", "line"), [("inp", _inp), ("bdf", _bdf)])
def test_a_file_name_with_a_zero_byte_is_refused(
    tmp_path: Path, ending: str, line: Callable[[str], str]
) -> None:
    (tmp_path / f"part.{ending}").write_text(line("a\0b"), encoding="utf-8")
    with pytest.raises(InputError, match="names the file"):
        read_mesh(tmp_path / f"part.{ending}")


def test_an_element_of_calculix_without_a_node_is_refused(tmp_path: Path) -> None:
    """CalculiX passes the number -1 of a deck on to its mesh."""
    nodes = [f" -1{n:10d}{n % 2:12.5E}{n // 2:12.5E}{0:12.5E}" for n in range(1, 4)]
    element = [f" -1{1:10d}{3:5d}    0    1", f" -2{1:10d}{2:10d}{3:10d}{-1:10d}"]
    lines = ["    2C", *nodes, " -3", "    3C", *element, " -3"]
    (tmp_path / "mesh.frd").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match="of node -1"):
        read_frd(tmp_path / "mesh.frd")
