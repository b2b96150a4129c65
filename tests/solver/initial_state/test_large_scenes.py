"""Scenes of many constraints: sparse matrices find what dense ones find."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.diagnostics import failure_causes, result_notes
from sidtool.solver.initial_state import (
    assembly,
    constraint_jacobian,
    given_state,
    overconstraint,
    sparse_jacobian,
)
from sidtool.solver.initial_state.assembly import assemble
from sidtool.solver.initial_state.redundant_constraints import REGULARISATION
from sidtool.solver.initial_state.sparse_jacobian import (
    CLEARLY_INDEPENDENT,
    VALUE_FACTOR,
    IndependentRows,
    OrthogonalFactor,
    least_independent_combination,
)
from sidtool.solver.simulation import result
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import band_shape
from tests.codes import only
from tests.solver.scenes import compiled, scene

from .networks import LINK, hanging_chain, ladder, network

ENDS = {"a": {"position": [0.0, 0.0]}, "b": {"position": [0.7, 0.1]}}
#: Constraints.
SOME = 60
#: Of ladders that dense matrices solve, too.
CELLS = 3


def chain(links: int, apart: float = 0.0, doubled: bool = False, **more: Any) -> System:
    """Rigid links that hang on each other, placed up to `apart` from where they meet;
    the last pin of two, if doubled."""
    shifts = apart * np.random.default_rng(links).standard_normal((links, 2))
    bodies = {
        f"l{i}": {
            "mass": 1.0 + 0.1 * (i % 3),
            "inertia": 0.05,
            "centre_of_mass": [0.35, 0.05],
            "markers": ENDS,
            "initial": {"position": [0.7 * i + x, 0.1 * i + y]},
        }
        for i, (x, y) in enumerate(shifts.tolist())
    }
    names = ["ground", *(f"l{i}.b" for i in range(links))]
    joints: dict[str, Any] = {
        f"pin{i}": {"type": "revolute", "markers": [names[i], f"l{i}.a"]}
        for i in range(links)
    }
    if doubled:
        joints["again"] = joints[f"pin{links - 1}"]
    return compiled(scene(bodies, joints, **more))


@pytest.fixture(autouse=True)
def fewer_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes of 60 constraints count as large: what they show does not need more."""
    monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", SOME)
    monkeypatch.setattr(sparse_jacobian, "LARGE_SCENE_ROWS", SOME)


def dense(monkeypatch: pytest.MonkeyPatch) -> None:
    """No scene counts as large."""
    monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", 10**9)


def forbid_dense(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a dense matrix of all constraints")

    monkeypatch.setattr(constraint_jacobian, "dense_jacobian", refuse)
    monkeypatch.setattr(failure_causes, "dense_jacobian", refuse)
    monkeypatch.setattr(result_notes, "dense_jacobian", refuse)


def test_a_large_scene_is_assembled_without_dense_matrices(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The same place as with them: the nearest one in the metric."""
    system = chain(SOME // 2 + 7, apart=0.02)
    with monkeypatch.context() as only_sparse:
        forbid_dense(only_sparse)
        found, start = assembly.assemble(system)
    dense(monkeypatch)
    _, expected = assembly.assemble(system)
    assert found.redundant == () and found.inactive_rows == ()
    assert start.z == pytest.approx(expected.z, abs=1e-8)
    assert start.v == pytest.approx(expected.v, abs=1e-8)


def test_an_open_chain_that_falls_passes_nothing_singular(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its constraints are independent wherever it is, though by less than what is near
    for few bodies. The run is made to ask about its last state."""
    forbid_dense(monkeypatch)
    told = []

    def crossings(system: System, kernels: Any, control: Any, *more: Any) -> list[str]:
        control.n_crossings = 1
        states = [control.z, control.v]
        control.crossing_steps[0] = np.concatenate(
            [[control.time, 1e-4], *states, *states]
        )
        told.append(
            list(failure_causes.singular_passage_notes(system, kernels, control, *more))
        )
        return told[-1]

    monkeypatch.setattr(result, "singular_passage_notes", crossings)
    system = chain(250, gravity=[0.0, -9.81], end=0.01)
    assert not simulate(system, integrator="radau5", rtol=1e-4).diagnostics
    assert told == [[]]


def test_a_large_chain_that_hangs_says_why_nothing_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    forbid_dense(monkeypatch)
    links = SOME // 2 + 9
    result = simulate(chain(links, gravity=[7.0, 1.0], end=1e-3), rtol=1e-4)
    assert only(result, "N324").data["free"] == links


def test_a_dependent_constraint_of_a_large_scene_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    system = chain(SOME // 2 + 3, doubled=True)
    found, _ = assembly.assemble(system)
    dense(monkeypatch)
    expected, _ = assembly.assemble(system)
    assert len(found.redundant) == len(expected.redundant) == 2
    assert_equally_redundant(found, expected)
    last = np.flatnonzero(found.arrays.regularisation)
    owners = constraint_jacobian.row_names(found, tuple(map(int, last)))
    assert set(owners) == {"again", f"pin{SOME // 2 + 2}"}


def assert_equally_redundant(found: System, expected: System) -> None:
    """The same rows have a part in it; which of them are left is a matter of choice."""
    assert len(found.redundant) == len(expected.redundant)
    assert found.arrays.regularisation == pytest.approx(
        expected.arrays.regularisation, rel=1e-6
    )


def sprinkled(rng: np.random.Generator) -> np.ndarray:
    """Forty independent rows, a tenth full."""
    values = rng.random((40, 90))
    return np.where(rng.random((40, 90)) < 0.1, values, 0.0) + np.eye(40, 90)


@pytest.mark.parametrize("seed", range(3))
def test_smallest_solutions_and_singular_values(seed: int) -> None:
    rng = np.random.default_rng(seed)
    B = csr_array(sprinkled(rng))
    unit = B.toarray() / np.linalg.norm(B.toarray(), axis=1)[:, None]
    sizes = np.linalg.svd(unit, compute_uv=False)
    rows = IndependentRows(B)
    assert (
        0.1 * sizes[-1] < rows.smallest_singular_value * max(1.0, sizes[0]) < sizes[-1]
    )
    right = rng.standard_normal(40)
    expected = np.linalg.lstsq(B.toarray(), right, rcond=None)[0]
    assert rows.minimum_norm_solution(right) == pytest.approx(
        expected, rel=1e-9, abs=1e-10
    )


def test_the_least_independent_rows_but_for_redundant_ones() -> None:
    rng = np.random.default_rng(2)
    B = rng.standard_normal((30, 50))
    B[:4] = 0.5 * (B[4:8] + B[8:12])
    left, sizes, _ = np.linalg.svd(B, full_matrices=False)
    direction, size = least_independent_combination(csr_array(B), 4)
    assert size == pytest.approx(sizes[25], rel=1e-5)
    assert abs(direction @ left[:, 25]) == pytest.approx(1.0, abs=1e-5)


def of_sizes(rng: np.random.Generator, sizes: list[float]) -> csr_array:
    """Rows of a band with some left singular vectors that have these values, times
    lengths of rows that nothing depends on."""
    count = 40
    left = np.linalg.qr(rng.standard_normal((count, count)))[0]
    right = np.linalg.qr(rng.standard_normal((70, count)))[0]
    values = np.concatenate([np.linspace(0.5, 1.5, count - len(sizes)), sizes])
    return csr_array(left * values @ right.T)


def unit(B: csr_array) -> np.ndarray:
    return B.toarray() / np.linalg.norm(B.toarray(), axis=1)[:, None]


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9])
def test_the_factor_has_the_digits_of_the_rows(size: float) -> None:
    """The least singular value; a factor of B B^T would lose half of its digits."""
    B = of_sizes(np.random.default_rng(3), [size])
    sizes = np.linalg.svd(unit(B), compute_uv=False)
    rows = IndependentRows(B)
    least = (
        rows.smallest_singular_value
        * VALUE_FACTOR
        * max(1.0, abs(unit(B) @ unit(B).T).sum(1).max() ** 0.5)
    )
    assert least == pytest.approx(sizes[-1], rel=0.05)
    G = unit(B) @ unit(B).T
    right = G @ np.ones(40)
    solved = OrthogonalFactor(csr_array(unit(B))).solve(right)
    assert G @ solved == pytest.approx(right, rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("sizes", [[1e-6], [3e-5, 1e-7, 2e-9], [1e-5] * 9])
def test_what_hardly_differs_need_not_be_met(sizes: list[float]) -> None:
    """Smallest solutions without the singular values below a bound, as of lstsq."""
    rng = np.random.default_rng(8)
    B, right = of_sizes(rng, sizes), rng.standard_normal(40)
    lengths = np.linalg.norm(B.toarray(), axis=1)
    rows = IndependentRows(B)
    without = rows.small_singular_vectors(1e-4)
    assert without is not None and without.shape == (40, len(sizes))
    expected = np.linalg.lstsq(unit(B), right / lengths, rcond=1e-4)[0]
    assert rows.minimum_norm_solution(right, without) == pytest.approx(
        expected, abs=1e-8
    )
    assert rows.small_singular_vectors(1e-12) is None or rows.small_singular_vectors(
        1e-12
    ).shape == (40, 0)


@pytest.mark.parametrize("seed", range(3))
def test_rows_that_follow_from_others_are_met_with_them(seed: int) -> None:
    """Smallest solutions as of lstsq with rows of length 1, where there are any, and
    where the rows contradict each other."""
    rng = np.random.default_rng(seed)
    B = sprinkled(rng)
    B[7], B[30] = -2.0 * B[3], B[11] + 0.5 * B[20]
    rows, right = IndependentRows(csr_array(B)), B @ rng.standard_normal(90)
    assert rows.smallest_singular_value == 0.0 and np.flatnonzero(
        rows.dependent
    ).tolist() == [7, 30]
    lengths = np.linalg.norm(B, axis=1)
    for contradiction in (0.0, 1e-6, 0.5):
        right[30] += contradiction
        expected = np.linalg.lstsq(unit(csr_array(B)), right / lengths, rcond=1e-9)[0]
        found = rows.least_squares(right, 1e-9)
        assert found == pytest.approx(expected, rel=1e-8, abs=1e-9)
    B[30, 5] += 1e-6
    nearly = IndependentRows(csr_array(B))
    assert nearly.least_squares(B @ np.ones(90), 1e-4) is None


def test_a_stretched_loop_at_its_dead_point_hides_no_rounding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A straight chain between two pins: what depends there is no matter of rounding,
    and the message that of dense matrices."""
    made = stretched_chain(SOME // 2 + 5)
    told = []
    for prepare in (refuse_svds, dense):
        with monkeypatch.context() as changed:
            prepare(changed)
            with pytest.raises(InputError, match="rests in a singular pos") as error:
                assemble(compile_scene(made))
            told.append(str(error.value))
    assert unnamed(told[0]) == unnamed(told[1])


@pytest.mark.parametrize("count", [11, 23, 44])
def test_a_stretched_chain_is_no_redundant_one(
    monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """No place beside it closes, and rounding decided whether a pin was left out."""
    dense(monkeypatch)
    with pytest.raises(InputError, match="rests in a singular position"):
        assemble(compile_scene(stretched_chain(count)))


def stretched_chain(count: int) -> SceneFile:
    pin = {"position": [count * LINK, 0.0]}
    end = {"type": "revolute", "markers": ["ground.pin", f"l{count - 1}.b"]}
    return hanging_chain(count, joints={"end": end}, ground={"markers": {"pin": pin}})


def unnamed(text: str) -> str:
    """Without the joints in brackets."""
    return re.sub(r"\(.*?\)", "()", text)


def refuse_svds(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("singular values of all constraints")

    monkeypatch.setattr(overconstraint, "_scaled_decomposition", refuse)


@pytest.mark.parametrize("cells", [15, 80])
def test_rows_of_a_long_ladder_stand_apart(cells: int) -> None:
    """Its singular values fall with the square of its length, below what counts as
    rounding, but no constraint nearly follows from the others: each keeps more."""
    system = ladder(cells)
    state = constraint_jacobian.InitialState(
        system, given_state.initial_estimate(system)
    )
    C = sparse_jacobian.scaled_sparse_jacobian(system, state.work.C)
    rows, inverse = IndependentRows(C), np.linalg.inv(unit(C) @ unit(C).T)
    kept = 1.0 / np.sqrt(np.diag(inverse).max())
    assert rows.have_remainder(0.9 * kept) and not rows.have_remainder(1.1 * kept)
    assert kept > 5.0 * rows.smallest_singular_value


@pytest.mark.parametrize("cells", [100, 500])
def test_no_constraint_of_a_long_ladder_is_left_out(
    monkeypatch: pytest.MonkeyPatch, cells: int
) -> None:
    """100 cells have a singular value of 8e-5, and 500 keep less than that of their
    rows, measured by the size of the whole; and yet no constraint is too many."""
    forbid_dense(monkeypatch)
    found, start = assembly.assemble(ladder(cells))
    assert found.inactive_rows == () and found.redundant == ()
    assert np.abs(start.v).max() == 0.0


def ladder_that(kind: str, space: bool) -> System:
    """A ladder whose joints and struts have dependencies of one kind."""
    once = ladder(CELLS, space).scene
    bodies: Any = {n: b.file_data() for n, b in once.bodies.items()}
    joints: Any = {n: j.file_data() for n, j in once.joints.items()}
    ground: Any = once.ground.file_data()
    across = [0.0] * space
    if kind == "said twice":
        joints["again"] = joints["p4"]
    if kind in ("meets its end", "never meets its end"):
        place = CELLS if kind == "meets its end" else 2 * CELLS - 1
        ground["markers"]["end"] = {"position": [float(place), 0.0, *across]}
        ends = ["ground.end", f"low{CELLS - 1}.b"]
        joints["end"] = {"type": "revolute", "markers": ends}
    if kind.startswith("strut"):
        # Beside the rungs, and off their direction: redundant but for that.
        off = float(kind.split()[1])
        for name, x in (("low2", 0.1), ("up2", 0.1 + off)):
            more = {"strut": {"position": [x, 0.0, *across]}}
            bodies[name]["markers"] = bodies[name]["markers"] | more
        ends = ["low2.strut", "up2.strut"]
        joints["strut"] = {"type": "distance", "markers": ends, "length": 1.0}
    dimension = "spatial" if space else "planar"
    return compiled(scene(bodies, joints, ground=ground, dimension=dimension))


@pytest.mark.parametrize(
    ("kind", "plane", "space"),
    [
        ("is plain", (0, 0), (3 * CELLS, 0)),
        ("said twice", (2, 0), (3 * CELLS + 5, 0)),
        ("strut 1e-6", (1, 1), None),  # in space it takes seconds
        ("strut 1e-2", (0, 0), (3 * CELLS, 0)),
        ("meets its end", "rests in a singular", "rests in a singular"),
        ("never meets its end", "ground.end and low2.b", "ground.end and low2.b"),
    ],
)
def test_ladders_have_the_verdicts_of_dense_matrices(
    monkeypatch: pytest.MonkeyPatch, kind: str, plane: Any, space: Any
) -> None:
    """Redundant constraints, those left out, the start; or why it is refused."""
    for is_spatial, expected in ((False, plane), (True, space)):
        if expected is None:
            continue
        found = []
        for many in (1, 10**9):
            monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", many)
            found.append(verdict(ladder_that(kind, is_spatial)))
        np.testing.assert_equal(found[0], found[1])
        told = found[0][0] if isinstance(expected, str) else found[0][:2]
        assert expected in told if isinstance(expected, str) else told == expected


def verdict(system: System) -> tuple[Any, ...]:
    """Redundant constraints, those that are left out, the start; or an error."""
    try:
        found, start = assembly.assemble(system)
    except InputError as error:
        return (unnamed(str(error)),)
    return len(found.redundant), len(found.inactive_rows), start.z.round(8)


@pytest.mark.parametrize("space", [False, True])
def test_random_networks_have_the_verdicts_of_dense_matrices(
    monkeypatch: pytest.MonkeyPatch, space: bool
) -> None:
    """What is redundant, left out or refused, and where they start; of rows that depend
    on each other it is a matter of choice which are named."""

    def verdict(seed: int) -> tuple[Any, ...]:
        try:
            found, start = assembly.assemble(network(seed, space))
        except InputError as error:
            return (unnamed(str(error)),)
        slack = (found.arrays.regularisation / REGULARISATION).round(6)
        states = start.z.round(9), start.v.round(9)
        return len(found.redundant), found.inactive_rows, slack, *states

    monkeypatch.setattr(constraint_jacobian, "LARGE_SCENE_ROWS", 1)
    sparse = [verdict(seed) for seed in range(8)]
    dense(monkeypatch)
    for seed in range(8):
        np.testing.assert_equal(sparse[seed], verdict(seed))
    redundant = [bool(found[0]) and len(found) > 1 for found in sparse]
    assert any(redundant) and not all(redundant)


@pytest.mark.parametrize("share", [0.0, 1e-12, 0.1 * CLEARLY_INDEPENDENT])
def test_rows_that_hardly_differ_are_not_clear(share: float) -> None:
    rng = np.random.default_rng(5)
    B = rng.standard_normal((6, 9))
    B[3] = B[1] - 2.0 * B[4] + share * rng.standard_normal(9)
    assert IndependentRows(csr_array(B)).smallest_singular_value == 0.0


@pytest.mark.parametrize("rows, width", [(1, 3), (4, 1), (9, 3), (9, 30), (50, 7)])
def test_entries_of_a_band_have_places_of_their_own(rows: int, width: int) -> None:
    """A third of the band stands left of the diagonal, as in factors with pivoting."""
    shape = band_shape(rows, width)
    places = [
        i * shape[1] + j
        for i in range(rows)
        for j in range(max(0, i - width // 3), min(rows, i + width - width // 3 + 1))
    ]
    assert len(set(places)) == len(places)
    assert max(places) < shape[0] * shape[1] <= max(rows * rows, rows * (width + 2) + 1)


def test_no_band_of_nothing() -> None:
    assert band_shape(0, 0) == (0, 0)
