"""Odd ways in which files of the field come, and what is said about them."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from sidtool.cli.main import cli
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Taylor
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.report.sid import natural_modes
from tests.bodies import particle_body
from tests.places import posix

BODY = particle_body(3, 12, nodes=2)


def _sidtool(*words: str, **more: object) -> subprocess.CompletedProcess[bytes]:
    code = "from sidtool.cli.main import main; main()"
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, capture_output=True, **more)  # type: ignore[call-overload, no-any-return]


@posix
def test_a_sid_may_come_through_a_pipe(tmp_path: Path) -> None:
    write_sid(tmp_path / "body.SID_FEM", BODY)
    content = (tmp_path / "body.SID_FEM").read_bytes()
    found = _sidtool("info", "/dev/stdin", input=content)
    assert found.returncode == 0 and b"2 nodes, 3 modes" in found.stdout
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(content,))
    writer.start()
    result = CliRunner().invoke(cli, ["validate", str(pipe)])
    writer.join()
    assert result.exit_code == 0 and ": 0 errors" in result.output


@posix
def test_a_closed_standard_output_is_no_error(tmp_path: Path) -> None:
    write_sid(tmp_path / "body.SID_FEM", BODY)
    target = tmp_path / "body.h5"
    words = f"convert {tmp_path / 'body.SID_FEM'} -o {target}".split()
    shell = ["sh", "-c", '"$0" "$@" >&-', sys.executable, "-c"]
    code = "from sidtool.cli.main import main; main()"
    result = subprocess.run([*shell, code, *words], stderr=subprocess.PIPE)
    assert result.returncode == 0 and result.stderr == b""
    assert read_sid(target).nq == 3


def test_the_content_determines_the_format(tmp_path: Path) -> None:
    write_sid(tmp_path / "body.SID_FEM", BODY)
    (tmp_path / "body.h5").write_bytes((tmp_path / "body.SID_FEM").read_bytes())
    assert read_sid(tmp_path / "body.h5").nq == 3


@pytest.mark.parametrize("count", [2, 4, 11])
def test_a_wrong_count_of_modes_is_named_where_it_stands(
    tmp_path: Path, count: int
) -> None:
    path = tmp_path / "body.SID_FEM"
    write_sid(path, replace(BODY, labels=("", "", "")))
    lines = path.read_text(encoding="utf-8").splitlines()
    at = next(i for i, line in enumerate(lines) if "nelastq" in line)
    lines[at] = lines[at].replace("=    3", f"= {count}")
    lines = [line for line in lines if "ielastq" not in line]
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError, match="all blocks declare nq = 3") as caught:
        read_sid(path)
    assert caught.value.place == f"line {at + 1}"


@pytest.mark.parametrize("noise", [0.0, 1e-16, -3e-15])
def test_a_mode_that_only_turns_is_torsion(noise: float) -> None:
    nodes = [
        replace(n, phi=Taylor(0 * n.phi.m0), origin=Taylor(n.origin.m0))
        for n in BODY.nodes
    ]
    body = replace(BODY, nodes=tuple(nodes), Ct=Taylor(noise * np.ones((3, 3))))
    assert {mode.kind.split()[0] for mode in natural_modes(body)} == {"torsion"}


def test_the_meaning_of_sigma_can_be_given(tmp_path: Path) -> None:
    stress = Taylor(np.ones((6, 1)), np.ones((3, 6, 1)))
    nodes = [replace(node, sigma=stress) for node in BODY.nodes]
    write_sid(tmp_path / "body.SID_FEM", replace(BODY, nodes=tuple(nodes)))
    words = ["convert", str(tmp_path / "body.SID_FEM"), "--units", "mm-t-s:SI"]
    words += ["-o", str(tmp_path / "si.SID_FEM")]
    assert "--sigma stress" in str(CliRunner().invoke(cli, words).exception)
    assert CliRunner().invoke(cli, [*words, "--sigma", "stress"]).exit_code == 0
    found = read_sid(tmp_path / "si.SID_FEM").nodes[0].sigma
    assert found is not None and found.m0 == pytest.approx(1e6)
