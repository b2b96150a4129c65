"""Reduction methods: static and dynamic exactness, rigid motion, conditioning."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.sparse.linalg import splu

from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.sid_mass import IN_PLANE, free_modal_mass
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.body_frames import FRAMES, motion_rows
from sidtool.reduction.methods import REDUCTIONS
from sidtool.reduction.reduced_basis import ReducedBasis
from sidtool.validate import check
from tests.codes import only

from ..models import rod

Q4 = {"type": "q4", "elements": [30, 3]}
IGA = {"type": "iga", "degrees": [3, 2], "elements": [10, 2]}
PINS = ["crank_pin", "piston_pin"]
METHODS: dict[str, dict[str, Any]] = {
    "modal": {"modes": 5},
    "craig_bampton": {"interfaces": PINS, "modes": 4},
    "attachment": {"interfaces": PINS, "modes": 4},
    "herting": {"interfaces": PINS, "modes": 4},
    "krylov": {"interfaces": PINS, "frequencies": [0.0, 400.0], "moments": 2},
    "user": {},
}
FRAME: dict[str, dict[str, Any]] = {
    "clamped": {"type": "tangent", "marker": "crank_pin", "clamp": "left"},
    "tangent": {"type": "tangent", "marker": "piston_pin"},
    "chord": {"type": "chord", "markers": PINS},
    "buckens": {"type": "buckens"},
}
TIES = {
    "crank_pin": {"node": 1, "tie": {"type": "distributing", "to": "left"}},
    "piston_pin": {"node": 2, "tie": {"type": "distributing", "to": "right"}},
}


@cache
def tied_rod(kind: str) -> FiniteElementModel:
    """The rod with ties; it is the same in every frame and for every reduction."""
    return finite_element_model(rod({"q4": Q4, "iga": IGA}[kind], markers=TIES))


def settings(method: str, folder: Path | None = None) -> dict[str, Any]:
    given = {"method": method, **METHODS[method]}
    if method == "user":
        assert folder is not None
        body = tied_rod("q4")
        x, y = body.positions.T
        fields = [(0 * x, x**2), (-2 * x * y, x**2), (x, 0 * x), (x, x**3), (-y, x)]
        shapes = np.array([np.stack(f, axis=1).ravel() for f in fields]).T
        np.save(folder / "shapes.npy", shapes)
        given["file"] = str(folder / "shapes.npy")
    return given


def reduced(
    method: dict[str, Any], frame: str, discretisation: dict[str, Any] = Q4
) -> tuple[FiniteElementModel, ReducedBasis]:
    model = rod(discretisation, frame=FRAME[frame], markers=TIES, reduction=method)
    body = tied_rod(discretisation["type"])
    axes = FRAMES[frame if frame != "clamped" else "tangent"](body, model.frame)
    return body, REDUCTIONS[model.reduction.method](body, axes, model.reduction)


def converted(method: dict[str, Any], frame: str) -> SID:
    return sid_from_model(rod(Q4, frame=FRAME[frame], markers=TIES, reduction=method))


@pytest.fixture(scope="module")
def free_squares() -> np.ndarray:
    """Squared circular eigenfrequencies of the whole free body."""
    body = finite_element_model(rod(Q4))
    return scipy.linalg.eigvalsh(
        body.stiffness.toarray(), body.mass.toarray(), subset_by_index=[3, 30]
    )


def test_every_method_is_tested_here() -> None:
    assert set(METHODS) == set(REDUCTIONS)
    assert {"clamped", *FRAMES} == set(FRAME)


@pytest.mark.parametrize("frame", FRAME)
@pytest.mark.parametrize("method", METHODS)
def test_every_sid_passes_every_check(method: str, frame: str, tmp_path: Path) -> None:
    """I1 to I17, for every method in every frame."""
    sid = converted(settings(method, tmp_path), frame)
    assert [(c.id, c.measured) for c in check(sid) if c.failed] == []


@pytest.mark.parametrize("frame", FRAME)
@pytest.mark.parametrize("method", METHODS)
def test_every_basis_is_orthonormal_and_reconstructs(
    method: str, frame: str, tmp_path: Path
) -> None:
    """Me is the identity and Ke diagonal, whatever the candidates were."""
    body, basis = reduced(settings(method, tmp_path), frame)
    nq = len(basis.labels)
    gram = basis.shapes.T @ (body.mass @ basis.shapes)
    assert_allclose(gram, np.eye(nq), atol=1e-10)
    projected = basis.shapes.T @ (body.stiffness @ basis.shapes)
    assert_allclose(projected, basis.stiffness, atol=1e-8 * projected.max())
    q = np.linspace(-1, 1, nq)
    assert_allclose(basis.reconstruct(q), basis.shapes @ q)
    assert_allclose(sum(basis.shares.values()), np.ones(nq), rtol=1e-10)


@pytest.mark.parametrize("discretisation", [Q4, IGA], ids=["q4", "iga"])
@pytest.mark.parametrize("method", ["attachment", "craig_bampton", "herting", "krylov"])
def test_static_loads_at_markers_are_exact_when_clamped(
    method: str, discretisation: dict[str, Any]
) -> None:
    """Forces and a moment at the pin: the full model's answer to 1e-9."""
    body, basis = reduced(settings(method), "clamped", discretisation)
    held = np.zeros(body.ndof, bool)
    held[body.dofs(body.node_sets["left"])] = True
    free = np.flatnonzero(~held)
    loads = motion_rows(body, body.marker("piston_pin")).T
    full = np.zeros_like(loads)
    full[free] = splu(sp.csc_matrix(body.stiffness[free][:, free])).solve(loads[free])
    q = np.linalg.solve(basis.stiffness, basis.shapes.T @ loads)
    error = np.abs(basis.shapes @ q - full).max(axis=0)
    assert (error < 1e-9 * np.abs(full).max(axis=0)).all()


@pytest.mark.parametrize("method", ["attachment", "craig_bampton", "herting", "krylov"])
def test_static_loads_on_a_free_body_are_exact_where_the_method_has_them(
    method: str,
) -> None:
    """Two opposite forces at the pins pull the rod; in mean axes it just stretches."""
    body, basis = reduced(settings(method), "buckens")
    pull = [body.marker(name).displacement.toarray()[0] for name in PINS]
    load = pull[1] - pull[0]
    rigid = body.rigid_body_modes()
    springs = body.stiffness + sp.csr_matrix(rigid @ rigid.T * 1e8)
    full = np.linalg.solve(springs.toarray(), load)
    momentum = body.mass @ rigid
    full -= rigid @ np.linalg.solve(rigid.T @ momentum, momentum.T @ full)
    q = np.linalg.solve(basis.stiffness, basis.shapes.T @ load)
    assert np.abs(basis.shapes @ q - full).max() < 1e-8 * np.abs(full).max()


@pytest.mark.parametrize("frame", ["tangent", "chord", "buckens"])
def test_craig_bampton_has_the_frequencies_of_the_free_body(
    frame: str, free_squares: np.ndarray
) -> None:
    """Below half the cut-off within 1 %; no rigid motion is counted twice."""
    method = {"method": "craig_bampton", "interfaces": PINS, "modes": 6}
    sid = converted(method, frame)
    found = scipy.linalg.eigvalsh(sid.Ke.m0, free_modal_mass(sid, IN_PLANE[2]))
    exact = free_squares
    cut_off = np.diag(fixed_interface(method)).max()
    below = exact[exact < cut_off / 4]
    assert below.size >= 3
    assert_allclose(np.sqrt(found[: below.size]), np.sqrt(below), rtol=0.01)
    assert sid.nq == 2 * 3 - 3 + 6
    assert found[0] > 0.5 * exact[0]


def fixed_interface(method: dict[str, Any]) -> np.ndarray:
    pinned = {"method": "modal", "modes": method["modes"], "fix": PINS}
    _, basis = reduced(pinned, "chord")
    return basis.stiffness


def test_craig_bampton_is_well_conditioned() -> None:
    """Me to rounding; Ke spans no more than the frequencies themselves."""
    method = {"method": "craig_bampton", "interfaces": PINS, "modes": 6}
    sid = converted(method, "buckens")
    assert np.linalg.cond(sid.Me.m0) < 1 + 1e-9
    squares = np.diag(sid.Ke.m0)
    assert np.linalg.cond(sid.Ke.m0) == pytest.approx(squares.max() / squares.min())


@pytest.mark.parametrize("moments", [1, 2])
def test_krylov_matches_transfer_functions_at_its_frequencies(moments: int) -> None:
    """Value and first 2 m - 1 derivatives by w^2, and no more."""
    expansion = 300.0
    method = {
        "method": "krylov",
        "interfaces": ["piston_pin"],
        "frequencies": [expansion],
        "moments": moments,
    }
    body, basis = reduced(method, "clamped")
    count = 2 * moments + 1
    full = full_derivatives(body, expansion, count)
    small = reduced_derivatives(body, basis, expansion, count)
    errors = [
        np.abs(a - b).max() / np.abs(a).max() for a, b in zip(full, small, strict=True)
    ]
    assert max(errors[:-1]) < 1e-9
    assert errors[-1] > 1e-8


#: Frequencies between the resonances of the clamped rod [Hz].
BETWEEN = np.array([5.0, 90.0, 380.0, 800.0])
#: Sizes of each method, and the error of the frequency response at the largest one.
RESPONSES: dict[str, tuple[list[dict[str, Any]], float]] = {
    "modal": ([{"modes": n} for n in (3, 6, 24)], 1e-2),
    "craig_bampton": ([{"modes": n} for n in (3, 9, 24)], 1e-5),
    "attachment": ([{"modes": n} for n in (3, 9, 24)], 1e-7),
    "herting": ([{"modes": n} for n in (3, 9, 24)], 1e-7),
    "krylov": (
        [{"frequencies": np.linspace(0, 900, n).tolist()} for n in (1, 2, 5)],
        1e-8,
    ),
}


@pytest.mark.parametrize("method", RESPONSES)
def test_the_frequency_response_converges_with_the_shape_functions(method: str) -> None:
    """Against the full model at markers; `benchmarks/reduction_methods.py` plots it."""
    sizes, last = RESPONSES[method]
    pin = {} if method == "modal" else {"interfaces": ["piston_pin"]}
    errors = []
    for size in sizes:
        body, basis = reduced({"method": method, **pin, **size}, "clamped")
        errors.append(max(transfer_error(body, basis, f) for f in BETWEEN))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < last


def full_derivatives(
    body: FiniteElementModel, frequency: float, count: int
) -> list[np.ndarray]:
    """Receptance at the pin and its derivatives by w^2, each over the factorial of its
    order: B^T (D^-1 M)^k D^-1 B with D = K - w^2 M.
    """
    held = body.dofs(body.node_sets["left"])
    free = np.setdiff1d(np.arange(body.ndof), held)
    square = (2 * np.pi * frequency) ** 2
    loads = motion_rows(body, body.marker("piston_pin")).T[free]
    mass = body.mass[free][:, free]
    dynamic = splu(sp.csc_matrix(body.stiffness[free][:, free] - square * mass))
    return _derivatives(dynamic.solve, mass, loads, count)


def reduced_derivatives(
    body: FiniteElementModel, basis: ReducedBasis, frequency: float, count: int
) -> list[np.ndarray]:
    """The same of the reduced body."""
    inputs = basis.shapes.T @ motion_rows(body, body.marker("piston_pin")).T
    unit = np.eye(len(basis.labels))
    dynamic = basis.stiffness - (2 * np.pi * frequency) ** 2 * unit
    factors = scipy.linalg.lu_factor(dynamic)
    return _derivatives(
        lambda x: scipy.linalg.lu_solve(factors, x), unit, inputs, count
    )


def _derivatives(
    solve: Callable[[np.ndarray], np.ndarray], mass: Any, loads: np.ndarray, count: int
) -> list[np.ndarray]:
    found = [solve(loads)]
    for _ in range(count - 1):
        found.append(solve(mass @ found[-1]))
    return [loads.T @ x for x in found]


def transfer_error(
    body: FiniteElementModel, basis: ReducedBasis, frequency: float
) -> float:
    """Of the receptance at the pin, relative to the static one."""
    (full,) = full_derivatives(body, frequency, 1)
    (small,) = reduced_derivatives(body, basis, frequency, 1)
    (static,) = reduced_derivatives(body, basis, 0.0, 1)
    return float(np.abs(small - full).max() / np.abs(static).max())


def test_dependent_shapes_are_omitted_and_named(tmp_path: Path) -> None:
    """Four independent fields of five in a frame; the fifth is a rigid rotation."""
    _, basis = reduced(settings("user", tmp_path), "buckens")
    assert len(basis.labels) == 4
    note = only(basis, "N164")
    assert note.data == {"omitted": 1, "count": 5, "names": ("user shape 5",)}


def test_modes_fixed_where_the_user_says_do_not_move_there() -> None:
    body, basis = reduced({"method": "modal", "modes": 3, "fix": PINS}, "chord")
    for name in PINS:
        motion = motion_rows(body, body.marker(name)) @ basis.shapes
        assert np.abs(motion[:2]).max() < 1e-9


@pytest.mark.parametrize("kind", ["npy", "npz", "mtx", "h5", "sparse.npz"])
def test_shapes_come_from_any_matrix_file(kind: str, tmp_path: Path) -> None:
    import h5py
    from scipy.io import mmwrite

    expected = converted(settings("user", tmp_path), "buckens")
    shapes, path = np.load(tmp_path / "shapes.npy"), tmp_path / f"other.{kind}"
    if kind == "npy":
        np.save(path, shapes)
    elif kind == "npz":
        np.savez(path, phi=shapes, other=np.eye(2))
    elif kind == "sparse.npz":
        sp.save_npz(path, sp.csr_matrix(shapes))
    elif kind == "mtx":
        mmwrite(path, shapes, precision=17)
    else:
        with h5py.File(path, "w") as file:
            file["phi"] = shapes
    method = {"method": "user", "file": str(path)}
    if kind == "npz":
        method["name"] = "phi"
    assert_allclose(converted(method, "buckens").Ke.m0, expected.Ke.m0, rtol=1e-9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (np.ones((7, 2)), "7 x 2; expected a finite matrix with 248 rows"),
        (np.full((248, 2), np.nan), "not finite"),
        (np.zeros((248, 2)), "no deformation is left"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(
    content: np.ndarray, message: str, tmp_path: Path
) -> None:
    np.save(tmp_path / "wrong.npy", content)
    with pytest.raises(InputError, match=message):
        converted({"method": "user", "file": str(tmp_path / "wrong.npy")}, "buckens")


def test_files_that_are_no_matrix_are_refused(tmp_path: Path) -> None:
    for name, message in (("a.npy", "cannot be read"), ("a.txt", "no kind of matrix")):
        (tmp_path / name).write_text("nonsense", encoding="utf-8")
        with pytest.raises(InputError, match=message):
            converted({"method": "user", "file": str(tmp_path / name)}, "buckens")


def test_names_that_do_not_exist_are_refused() -> None:
    with pytest.raises(InputError, match="reduction.interfaces: there is no marker"):
        rod(Q4, reduction={"method": "herting", "interfaces": ["hub"]})
    with pytest.raises(InputError, match="reduction.fix: there is no edge"):
        rod(Q4, reduction={"method": "modal", "modes": 2, "fix": "nowhere"})
