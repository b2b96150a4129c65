"""``python -m benchmarks.validation``: reference problems, as docs/validation.md.

Problems are set up as the tests do it, so that page and tests are of one source. Every
number stands beside where it comes from; nothing is left out because it deviates.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

import sidtool
from sidtool.demo import KNOWN
from sidtool.formats.reference import read_reference
from sidtool.formats.sid import SID
from sidtool.solver import compile_scene, simulate
from sidtool.starting import example_folder
from tests.references import test_andrews as andrews
from tests.references import test_bricard as bricard
from tests.references import test_four_bars as four_bars
from tests.references import test_rigid_benchmarks as rigid
from tests.references import test_simeon as simeon
from tests.sidtool.test_frontend_patches import FV32, hertz, membrane

PAGE = Path(__file__).parents[1] / "docs" / "validation.md"


class Row(NamedTuple):
    """A quantity, what it should be by which source, and what it is."""

    quantity: str
    source: str
    reference: float
    found: float


def main() -> None:
    """Compute all problems and write the page."""
    parts = [
        "# Validation\n",
        "Reference problems with their deviations, written by `python -m "
        "benchmarks.validation`. *Published* numbers are printed in the source that is "
        "named, *computed* ones come from another method. Thirty more motions, every "
        "integrator and tolerance: [error asked for and error found]"
        "(../benchmarks/results/results.md).\n",
    ]
    for problem in PROBLEMS:
        title, *text = (problem.__doc__ or "").split("\n\n")
        parts += [f"## {title.rstrip('.')}\n", *(" ".join(t.split()) for t in text), ""]
        parts += ["| quantity | source | reference | sidtool | deviation |"]
        parts += ["|---|---|---|---|---|", *map(_line, problem()), ""]
        print(title)
    versions = f"numpy {np.__version__}, sidtool {sidtool.__version__}"
    PAGE.write_text("\n".join([*parts, f"({versions})"]) + "\n", encoding="utf-8")


def _line(row: Row) -> str:
    deviation = row.found - row.reference
    told = f"{deviation:+.1e}"
    if row.reference:
        told = f"{deviation / abs(row.reference):+.1e} relative"
    numbers = f"{row.reference:.10g} | {row.found:.10g} | {told}"
    return f"| {row.quantity} | {row.source} | {numbers} |"


def _rod_frequencies() -> Iterator[Row]:
    """Frequencies of the founding rod (Hz).

    Clamped at its left edge; A. Held, A. Hildebrandt. The published row of IGA lies 0.7
    to 1.4 % above the converged values of the exact geometry.
    """
    folder = example_folder("slider_crank")
    known = {
        row.name: row for row in read_reference(folder / "frequencies.toml").frequencies
    }
    pairs = {
        "rod_q4": ("paper, ANSYS", "Q4 150x10"),
        "rod_iga": ("paper, IGA", "IGA 25x8", "converged"),
    }
    for file, names in pairs.items():
        found = _hertz(sidtool.convert(folder / f"{file}.toml"))
        for name in names:
            source = known[name].source.partition(":")[0] + f": {name}"
            for i, value in enumerate(known[name].hertz):
                yield Row(f"{file} f{i + 1}", source, value, found[i])


def _hertz(sid: SID) -> np.ndarray:
    return np.sqrt(np.diag(sid.Ke.m0) / np.diag(sid.Me.m0)) / (2 * np.pi)


def _founding_motion() -> Iterator[Row]:
    """Motion of the founding slider-crank.

    Against minimal coordinates and DOP853 at 1e-10.
    """
    scene = example_folder("slider_crank") / "slider_crank.toml"
    result = sidtool.simulate(scene, rtol=1e-10)
    for (name, at), value in KNOWN.items():
        found = result[name][np.searchsorted(result.t, at - 1e-9)]
        yield Row(f"{name} at {at} s", "computed", value, float(found))


def _simeon() -> Iterator[Row]:
    """Slider-crank of the IVP test set (flexible rod, index 2).

    B. Simeon, at 0.1 s. The place of the piston carries a fixed offset of 2e-10 from
    the rounded start of the source.
    """
    result = simeon.run(quadratic_inertia=True)
    for name, value in simeon.END.items():
        yield Row(name, "published", value, simeon.end(result, name))


def _andrews() -> Iterator[Row]:
    """Andrews' squeezing mechanism (seven rigid bodies).

    Angles at 0.03 s; published digits are good to 1e-10.
    """
    result = simulate(
        compile_scene(andrews.squeezer()), integrator="radau9", rtol=1e-11
    )
    k1, k2, k3, k4, k5, k6, k7 = (
        float(result[f"{name}.angle"][-1]) for name in andrews.BODIES
    )
    names = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
    angles = (k1, k2 - k1, k3, k4 - k5, k5, k6 - k7, k7)
    for name, value, found in zip(names, andrews.END, angles, strict=True):
        yield Row(name, "published", value, found)


def _rigid() -> Iterator[Row]:
    """Rigid benchmarks of the IFToMM library.

    A01: simple pendulum; A02: linked four-bars that pass singular positions; A04:
    Bricard's mechanism with a redundant hinge, whose energy is constant.
    """
    pendulum = simulate(rigid.massless_rod_pendulum(), rtol=1e-11)
    yield Row("A01 x(10 s)", "exact", -0.2750874625761169, float(pendulum["bob.x"][-1]))
    yield Row("A01 y(10 s)", "exact", -0.9614192050991251, float(pendulum["bob.y"][-1]))
    loops = simulate(four_bars.four_bars(2, 10.0), integrator="radau9", rtol=1e-9)
    for axis, value, found in zip(
        "xy", four_bars.PUBLISHED, loops.values[-1], strict=True
    ):
        yield Row(f"A02 {axis}(10 s), N = 2", "published", value, float(found))
    result = simulate(bricard.bricard(), integrator="radau9", rtol=1e-10)
    energy = result["energy.kinetic"] + result["energy.potential"]
    share = float(np.ptp(energy) / result["energy.kinetic"].max())
    yield Row("A04 variation of energy in 10 s, of its largest", "exact", 0.0, share)


def _membrane() -> Iterator[Row]:
    """NAFEMS FV32: a tapered membrane (Hz).

    Plane stress, clamped at its wide end; IGA of degree 6.
    """
    found = hertz(membrane({"type": "iga", "degrees": [6, 6], "elements": [12, 8]}))
    published = (44.623, 130.03, 162.70, 246.05, 379.90, 391.44)
    for name, values in (("published", published), ("computed: converged", FV32)):
        for i, value in enumerate(values):
            yield Row(f"f{i + 1}", name, value, float(found[i]))


def _blade() -> Iterator[Row]:
    """A beam that spins up (geometric stiffening).

    Kane, Ryan and Banerjee's beam, example `spinning_blade`, three bending shapes:
    tip deflection against a geometrically exact beam, and against a floating frame with
    the centrifugal term; lead-lag and flapping frequency at the speed parameter 6
    against a spectral method. A SID with few shapes errs by 0.1 to 0.2 %.
    """
    folder = example_folder("spinning_blade")
    sid = sidtool.convert(folder / "blade.toml")
    with tempfile.TemporaryDirectory() as temporary:
        sidtool.write(Path(temporary) / "blade.SID_FEM", sid)
        for name in ("scene.toml", "steady.toml"):
            (Path(temporary) / name).write_text((folder / name).read_text())
        result = sidtool.simulate(Path(temporary) / "scene.toml")
        modes = sidtool.linearise(Path(temporary) / "steady.toml", about="start")
    least = float(result["blade.tip.uy"].min())
    yield Row("least v [m]", "computed: exact beam", -0.5737868, least)
    yield Row("least v [m]", "computed: three modes", -0.574443, least)
    unit = np.sqrt(1.4e4 / (1.2 * 10.0**4)) / (2 * np.pi)
    found = np.sort(modes.frequencies)[:2] / unit
    yield Row("lead-lag", "computed: spectral", 4.263225, float(found[0]))
    flap = float(np.hypot(4.263225, 6.0))
    yield Row("flapping", "computed: spectral", flap, float(found[1]))


def _beam() -> Iterator[Row]:
    """Frequencies of a clamped bar (Hz).

    The example `beam` against Euler and Bernoulli's beam.
    """
    found = _hertz(sidtool.convert(example_folder("beam") / "beam.toml"))
    unit = np.sqrt(2.1e11 * 0.01**2 / 12 / 7850.0) / (2 * np.pi)
    roots = (1.8751040687, 4.6940911330, 7.8547574382)
    for name, mode, root in zip(("f1", "f3", "f5"), (0, 2, 4), roots, strict=True):
        yield Row(name, "exact", float(root**2 * unit), float(found[mode]))


PROBLEMS: tuple[Callable[[], Iterator[Row]], ...] = (
    _rod_frequencies,
    _founding_motion,
    _simeon,
    _andrews,
    _rigid,
    _membrane,
    _blade,
    _beam,
)


if __name__ == "__main__":
    main()
