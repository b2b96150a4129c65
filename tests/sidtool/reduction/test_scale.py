"""Engines for the factorisation give one result, and memory is said beforehand."""

from __future__ import annotations

import platform
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from sidtool.eigensolvers import factorisation, slepc
from sidtool.eigensolvers.eigenpairs import lowest_eigenpairs
from sidtool.eigensolvers.factorisation import (
    ENGINES,
    engine_name,
    expected_gigabytes,
    symmetric_factors,
)
from sidtool.formats.base.errors import InputError
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from ..bodies import SOLIDS, volume
from ..models import rod

#: The package of an engine, but of that which SciPy has.
PACKAGE = {
    "cholmod": "sksparse",
    "pardiso": "pypardiso",
    "slepc": "slepc4py",
    "multigrid": "pyamg",
}
INSTALLED = [
    pytest.param(name, marks=pytest.mark.needs(PACKAGE[name]))
    for name in ENGINES
    if name in PACKAGE and name != "multigrid"
] + ["superlu"]


@pytest.mark.parametrize("name", PACKAGE)
def test_an_engine_that_is_not_installed_is_named(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("SIDTOOL_FACTORS", name)
    with pytest.raises(InputError, match=name):
        symmetric_factors(sp.csr_matrix(np.diag([2.0, 3.0])))


@pytest.mark.parametrize("name", INSTALLED)
def test_every_engine_gives_the_same_modes(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    body = finite_element_model(volume(SOLIDS["hex20"]))
    free = np.setdiff1d(np.arange(body.ndof), body.dofs(body.node_sets["left"]))
    k, m = (x[free][:, free] for x in (body.stiffness, body.mass))
    monkeypatch.setenv("SIDTOOL_FACTORS", "superlu")
    expected, _ = lowest_eigenpairs(k, m, 6)
    monkeypatch.setenv("SIDTOOL_FACTORS", name)
    values, vectors = lowest_eigenpairs(k, m, 6)
    assert_allclose(values, expected, rtol=1e-7)
    assert_allclose(vectors.T @ (m @ vectors), np.eye(6), atol=1e-10)


@pytest.mark.parametrize("name", [p for p in INSTALLED if "slepc" not in str(p)])
def test_every_engine_takes_no_load_at_all(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """PARDISO ended the conversion of bodies whose markers stand still."""
    monkeypatch.setenv("SIDTOOL_FACTORS", name)
    matrix = sp.csr_matrix(np.diag([2.0, 3.0]))
    assert symmetric_factors(matrix).solve(np.zeros((2, 0))).shape == (2, 0)


@pytest.mark.parametrize("name", [p for p in INSTALLED if "slepc" not in str(p)])
def test_factors_stay_those_of_their_matrix(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Also when others were computed, and some freed, in between."""
    monkeypatch.setenv("SIDTOOL_FACTORS", name)
    chain = sp.diags_array([-1.0, 2.5, -1.0], offsets=[-1, 0, 1], shape=(60, 60))
    matrices = [sp.csr_matrix(chain + k * sp.eye_array(60)) for k in range(3)]
    factors = [symmetric_factors(matrix) for matrix in matrices]
    del factors[1], matrices[1]
    loads = np.random.default_rng(0).normal(size=(60, 5))
    for matrix, factor in zip(matrices, factors, strict=True):
        for load in (loads[:, 0], loads, loads[:, ::2], np.asfortranarray(loads)):
            assert_allclose(matrix @ factor.solve(load), load, atol=1e-13)


@pytest.mark.parametrize("name", [p for p in INSTALLED if "slepc" not in str(p)])
def test_a_matrix_without_an_inverse_is_an_error(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Its rows alike, or one empty."""
    monkeypatch.setenv("SIDTOOL_FACTORS", name)
    for matrix in (np.ones((3, 3)), np.diag([2.0, 0.0, 3.0])):
        with pytest.raises((RuntimeError, ValueError)):
            symmetric_factors(sp.csr_matrix(matrix))


def test_an_unknown_engine_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIDTOOL_FACTORS", "abacus")
    with pytest.raises(InputError, match="'abacus' is not there .*expected .*superlu"):
        engine_name()


def test_an_engine_that_cannot_be_loaded_is_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pypardiso without its MKL, say: installed, but its import fails."""
    (tmp_path / "halved.py").write_text(
        "raise ImportError('mkl_rt not found. Use X')", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("SIDTOOL_FACTORS", raising=False)
    for name in ("cholmod", "pardiso"):
        monkeypatch.setitem(ENGINES, name, ("halved", ENGINES[name][1]))
    assert engine_name() == "superlu"
    monkeypatch.setenv("SIDTOOL_FACTORS", "pardiso")
    with pytest.raises(InputError, match=r"not there \(mkl_rt not found\); expected"):
        engine_name()


def test_expected_memory_is_printed_before_the_work() -> None:
    heard: list[str] = []
    sid_from_model(rod(), heard.append)
    assert any("GB" in text for text in heard)
    assert heard.index(next(t for t in heard if "GB" in t)) == 1


def test_the_time_of_a_large_solid_is_printed_before_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And that of the library that pip could install, where it could."""
    monkeypatch.setenv("SIDTOOL_FACTORS", "superlu")
    monkeypatch.setattr(factorisation, "_SLOW", 500)
    monkeypatch.setattr(factorisation, "_LARGE", 500)
    for machine, there in (("x86_64", True), ("arm64", False)):
        monkeypatch.setattr(platform, "machine", lambda machine=machine: machine)
        heard: list[str] = []
        sid_from_model(volume(SOLIDS["hex20"]), heard.append)
        text = next(t for t in heard if t.startswith("factorising"))
        assert " s" in text and ("sidtool[fast]" in text) is there


def test_progress_comes_from_inside_the_solution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is factorised, and how many blocks of vectors were solved for."""
    monkeypatch.setattr(slepc, "_REPORT_INTERVAL", -1.0)  # clocks may stand still
    heard: list[str] = []
    settings = {"type": "q4", "elements": [60, 4]}
    sid_from_model(rod(settings), heard.append, engine="superlu")
    first = heard.index("factorising 600 equations by superlu")
    counts = [text for text in heard if text.startswith("eigenvectors: ")]
    assert counts[:2] == [f"eigenvectors: {i} blocks of solutions" for i in (1, 2)]
    assert first < heard.index(counts[0]) < heard.index("integrating the inertia")


def corners(*size: float) -> np.ndarray:
    return np.array(list(product(*((0.0, length) for length in size))))


def test_memory_grows_with_the_size() -> None:
    """Nested dissection: n log n in the plane, n^(4/3) in space."""
    for place, least in ((corners(1, 1), 6.0), (corners(1, 1, 1), 15.0)):
        few, many = (expected_gigabytes(place, n) for n in (10**5, 10**6))
        assert least < many / few < 25
    assert expected_gigabytes(corners(1, 1, 1), 1000) < 0.5


@pytest.mark.parametrize(
    ("elements", "unknowns", "measured"),
    [
        ((22, 22, 22), 36501, 0.798),
        ((60, 24, 8), 41175, 0.839),
        ((120, 12, 8), 42471, 0.769),
    ],
)
def test_expected_memory_equals_the_measured_one(
    elements: tuple[int, ...],
    unknowns: int,
    measured: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Herting on hex8 by SuperLU; the estimate for slender parts was up to 30 % too
    large.
    """
    monkeypatch.setenv("SIDTOOL_FACTORS", "superlu")
    assert expected_gigabytes(corners(*elements), unknowns) == pytest.approx(
        measured, rel=0.1
    )


def test_a_dense_eigenproblem_is_announced() -> None:
    """LAPACK reports no progress: a third of all modes took minutes without a
    message.
    """
    heard: list[str] = []
    n = 330
    stiffness = sp.diags_array(np.arange(1.0, n + 1), format="csr")
    with slepc.use_engine(progress=heard.append):
        values, _ = lowest_eigenpairs(stiffness, sp.eye_array(n, format="csr"), 120)
    assert heard == ["eigenvectors: 120 of 330 equations at once, by LAPACK"]
    assert_allclose(values, np.arange(1.0, 121.0), rtol=1e-12)
