"""Curves of more points than a picture has pixels keep what is seen of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.plot import results
from sidtool.plot.curves import MOST_POINTS, extremes
from sidtool.solver.output.samples import StateSampler, interpolate_states


def test_extremes_hold_every_peak() -> None:
    """In each of a thousand parts the picture spans the same values."""
    chance = np.random.default_rng(5)
    values = np.sin(np.linspace(0.0, 40.0, 1_000_000))
    values[chance.integers(0, len(values), 30)] = 7.0
    values[chance.integers(0, len(values), 30)] = -9.0
    retained = extremes(values)
    assert len(retained) <= MOST_POINTS and (np.diff(retained) > 0).all()
    assert retained[0] == 0 and retained[-1] == len(values) - 1
    part = retained * 1000 // len(values)
    for k, row in enumerate(values.reshape(1000, -1)):
        observed = values[retained[np.abs(part - k) <= 1]]
        assert observed.min() <= row.min() and observed.max() >= row.max()


def test_short_curves_and_gaps_are_unchanged() -> None:
    assert len(extremes(np.zeros(MOST_POINTS))) == MOST_POINTS
    gap = np.full(10 * MOST_POINTS, np.nan)
    assert len(extremes(gap)) <= MOST_POINTS


@pytest.fixture(scope="module")
def long() -> sidtool.Result:
    return sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=1.0, output_step=1e-4),
        bodies={
            "stone": sidtool.RigidBody(
                mass=1.0, initial=sidtool.Initial(velocity=[2.0, 0.0])
            )
        },
        outputs=sidtool.Outputs(record=["stone.x"]),
    ).simulate()


def test_long_results_are_drawn_as_recorded(
    long: sidtool.Result, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Nothing is evaluated again where the times are closer than pixels."""

    def played(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(results, "interpolated_outputs", played)
    assert long.plot("stone.x", path=tmp_path / "p.svg") is not None
    assert (tmp_path / "p.svg").stat().st_size < 200_000
    page, notes = results.draw_result(long)
    (line,) = page.axes[0].lines
    assert len(line.get_xdata()) <= MOST_POINTS and notes == []
    np.testing.assert_allclose(line.get_ydata(), 2.0 * line.get_xdata(), atol=1e-12)


def test_outputs_that_alternate_between_output_times_are_named() -> None:
    t = np.linspace(0.0, 1.0, 10_001)
    assert results._alternates(np.sin(3.0e4 * t))
    assert not results._alternates(np.sin(300.0 * t))
    assert not results._alternates(np.zeros(3))


def test_few_states_are_interpolated_from_their_neighbours(
    long: sidtool.Result,
) -> None:
    """Of ten thousand states only those around the wanted times are looked at."""
    from sidtool.solver.simulation.replay import replay

    again = replay(long)
    observed: list[int] = []

    class Counted(StateSampler):
        def sample(self, times, z, v):  # type: ignore[no-untyped-def]
            observed.append(len(times))
            return super().sample(times, z, v)

    nodes = np.array([0.0, 0.12345, 0.99995, 1.0])
    sampler = Counted(again.system, again._sampler.closed)
    z, _ = interpolate_states(sampler, (again.t, again.z, again.v), nodes)
    assert max(observed) <= 16
    np.testing.assert_allclose(z[:, 0], 2.0 * nodes, atol=1e-12)
