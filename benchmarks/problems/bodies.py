"""Frequencies, mass terms and stiffening of single bodies."""

from __future__ import annotations

import tempfile
import tomllib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import sidtool
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.reference import read_reference
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.examples import example_folder
from tests.references import (
    slender,
    test_interface_beam,
    test_rotor,
    test_tight_string as strings,
    test_tower as towers,
    test_wind_turbine as turbines,
)
from tests.sidtool.conversion import test_beam_stiffening as cantilever
from tests.sidtool.elements.test_frontend_patches import FV32, hertz, membrane

from . import Problem, Row

RECOMPUTED = "another program, all digits"


def _rod_frequencies() -> Iterator[Row]:
    """The founding rod (Hz).

    Clamped at its left edge; A. Held, A. Hildebrandt. The published bending frequencies
    f1 to f4 of IGA are 0.7 to 1.4 % above the converged values of the exact geometry,
    the longitudinal one f5 0.05 %.
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
        frequencies = slender.hertz(sidtool.convert(folder / f"{file}.toml"))
        for name in names:
            source = known[name].source.partition(":")[0] + f": {name}"
            for i, value in enumerate(known[name].hertz):
                yield Row(f"{file} f{i + 1}", source, value, frequencies[i])
    meshed = sidtool.convert(folder / "rod_q4.toml")
    turned = float(meshed.J.m0.ravel()[2])
    yield Row("rod_q4 mass [kg]", "computed: Q4 150x10", 3.1400697778, meshed.mass)
    yield Row("rod_q4 J [kg m^2]", "computed: Q4 150x10", 1.0995077456, turned)


def _membrane() -> Iterator[Row]:
    """NAFEMS FV32: a tapered membrane (Hz).

    Plane stress, clamped at its wide end; IGA of degree 6.
    """
    frequencies = hertz(
        membrane({"type": "iga", "degrees": [6, 6], "elements": [12, 8]})
    )
    published = (44.623, 130.03, 162.70, 246.05, 379.90, 391.44)
    for name, values in (("published", published), ("computed: converged", FV32)):
        for i, value in enumerate(values):
            yield Row(f"f{i + 1}", name, value, float(frequencies[i]))


def _tower() -> Iterator[Row]:
    """Tower of the NREL 5 MW wind turbine.

    Ten elements with mass and bending stiffness linear in each, or averaged, as in the
    tests of E. Branlard's welib; imported as matrices. One mode in either plane, scaled
    to one at the top. Bodies from matrices have no stress, and so no geometric
    stiffness. K0omega, stiffening by rotation, is therefore that of a beam of 80
    elements with polynomials of degree 10 through the stations, so that only two or
    three digits can agree.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = towers.quantities(towers.tower(Path(folder), towers.linear))
        means = towers.quantities(towers.tower(Path(folder), towers.averaged))
        smooth = towers.smooth_tower(80)
    for name, value in towers.LINEAR.items():
        yield Row(name, RECOMPUTED, value, found[name])
    for name, value in towers.AVERAGED.items():
        yield Row(f"{name}, averaged", RECOMPUTED, value, means[name])
    for name, value in towers.STIFFENED.items():
        yield Row(f"K0omega, {name}", RECOMPUTED, value, towers.stiffened(smooth))


def _turbine() -> Iterator[Row]:
    """The parked NREL 5 MW wind turbine (Hz).

    Example `wind_turbine`: blades and tower by stations, shaft tilt, precone, flexible
    drivetrain and yaw bearing, gravity. J. Jonkman et al., NREL/TP-500-38060, 2009,
    table 9-1: MSC.ADAMS has beams, as sidtool does; FAST has two flapwise modes and one
    edgewise mode of each blade and four modes of the tower, without torsion. The two
    programs differ from each other by up to 17 %.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = turbines.parked_frequencies(example_folder("wind_turbine"))
    for k, program in enumerate(("FAST", "ADAMS")):
        for name, values in turbines.PUBLISHED.items():
            yield Row(name, f"published: {program}", values[k], float(found[name]))


def _analytic_beam() -> Iterator[Row]:
    """A uniform beam with the exact shapes of a cantilever.

    L = 60 m, EI = 2e10 N m^2, 500 kg/m, `test_flexibility.py` of welib. It integrates
    by the trapezoidal rule at 30 points, which causes the deviations; the exact Me is
    m L / 4. Signs are those of the shapes.
    """
    section = {"area": 1.0, "iy": 2e-5, "iz": 1e-5}
    shapes = {"method": "modal", "modes": 6}
    tables = {"frame": slender.CLAMPED, "reduction": shapes}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sid = slender.beam(60.0, section, (2e15, 0.3, 500.0), 60, tables)
    tip = sid.node(2).phi.m0
    modes = np.flatnonzero(np.abs(tip[1]) > 1e-3 * np.abs(tip[2]).max())[:3]
    for k, mode in enumerate(modes):
        top = tip[1, mode]
        for name, published, value in (
            ("Ct", _CT[k], sid.Ct.m0[mode, 1] / top),
            ("Cr", _CR[k], -sid.Cr.m0[mode, 2] / top),
            ("Me", _ME[k], sid.Me.m0[mode, mode] / top**2),
            ("Ke", _KE[k], sid.Ke.m0[mode, mode] / top**2),
        ):
            yield Row(f"{name}{k + 1}", "published", published, float(value))
        yield Row(f"Me{k + 1}", "exact", 7500.0, float(sid.Me.m0[mode, mode] / top**2))


_CT = (11748.96793, -6494.82063, 3839.68233)
_CR = (-512010.35981, 81016.00516, -30396.91796)
_ME = (7508.18374, 7528.42330, 7546.66429)
_KE = (286478.07306, 11281454.27909, 88662737.01300)


def _interface_beam() -> Iterator[Row]:
    """Craig and Bampton's reduction of one beam element (Hz).

    `test_reduction.py` of welib. The static mode is the deformation by a rotation of
    the upper end, with the lower end pinned.
    """
    problem = test_interface_beam
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        whole = problem.element(slender.AT_END, problem.CONSTRAINT_AND_MODES).mass
        yield Row("mass [kg]", "published", problem.WHOLE_MASS, whole)
        pairs = zip(problem.END_HELD, problem.end_held(), strict=True)
        for i, (value, found) in enumerate(pairs):
            name = f"upper end held, lower end free, f{i + 1}"
            yield Row(name, "published", value, found)
        found = problem.static_mode(Path(folder))
        yield Row("pinned, static mode", "published", problem.PINNED, found)
        found = problem.pinned_and_held()
        name = "pinned, upper end held"
        yield Row(name, "published", problem.PINNED_END_HELD, found)
        exact = np.sqrt(420 * problem.STIFFNESS / problem.MASS) / problem.LENGTH**2
        yield Row(name, "exact", float(exact / (2 * np.pi)), found)


def _rotor() -> Iterator[Row]:
    """A rotor on two bearings (rad/s).

    Friswell, Penny, Garvey and Lees, Dynamics of Rotating Machines, example 5.9.1:
    frequencies of backward and forward whirl at rest and at 4000 rpm, 24 Timoshenko
    elements. sidtool reduces the shaft to 48 fixed-interface modes, which causes the
    deviations.
    """
    found = test_rotor.whirl(0.0)[::2]
    for i, value in enumerate(test_rotor.AT_REST):
        yield Row(f"at rest, {i + 1}", RECOMPUTED, value, float(found[i]))
    found = test_rotor.whirl(test_rotor.SPEED)
    for i, value in enumerate(test_rotor.AT_SPEED):
        sense = ("backward", "forward")[i % 2]
        name = f"4000 rpm, {sense} {i // 2 + 1}"
        yield Row(name, RECOMPUTED, value, float(found[i]))


def _tight_string() -> Iterator[Row]:
    """A prestressed slender bar (Hz).

    Regression case BeamModes of the FEDEM solver: 100 elements, 54.6 MN, transverse
    ends held. FEDEM lengthens the bar by the force, has no bending stiffness and lumps
    the mass. The same assumptions in sidtool give its numbers. Its Young's modulus is
    not printed in the source; it is taken as 2.1e11 Pa. The bar of the string has a
    small bending stiffness, which changes the fifth frequency by 5e-6.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        limp = strings.tight(strings.LIMP, False, "consistent")
        stiff = strings.tight(strings.ROUND, False, "consistent")
        longer = strings.tight(strings.LIMP, True, "lumped")
    for name, source, values, found in (
        ("string", "exact: string", strings.STRING, limp),
        (
            "bar with bending",
            "exact: tension and bending",
            strings.with_bending(),
            stiff,
        ),
        ("stretched bar of particles", "published: FEDEM", strings.FEDEM, longer),
    ):
        for i, value in enumerate(values):
            yield Row(f"{name} f{i + 1}", source, float(value), float(found[i]))


def _stiffening_terms() -> Iterator[Row]:
    """Stiffening terms of a uniform cantilever.

    L = m = EI = 1, first bending mode with Me = 1; extrapolated from 20, 40 and 80
    elements.
    """
    terms = np.array(
        [cantilever.published(cantilever.slender(n, 1)) for n in (20, 40, 80)]
    )
    limit = terms[2] + (terms[2] - terms[1]) / 3
    names = ("K0omega", "K0t,x", "phi m1", "phi at the tip")
    values = (1.19334, -1.57088, -4.64778, 2.0)
    for name, value, found in zip(names, values, limit, strict=True):
        yield Row(name, "computed: exact shapes", value, float(found))


def _beam() -> Iterator[Row]:
    """Frequencies of a clamped bar (Hz).

    The example `beam` against Euler and Bernoulli's beam.
    """
    frequencies = slender.hertz(sidtool.convert(example_folder("beam") / "beam.toml"))
    unit = np.sqrt(2.1e11 * 0.01**2 / 12 / 7850.0) / (2 * np.pi)
    roots = (1.8751040687, 4.6940911330, 7.8547574382)
    for name, mode, root in zip(("f1", "f3", "f5"), (0, 2, 4), roots, strict=True):
        yield Row(name, "exact", float(root**2 * unit), float(frequencies[mode]))


def _derivatives() -> Iterator[Row]:
    """Derivatives with respect to parameters.

    Of the example `beam`, by central differences of 1e-4 of the parameter, times
    parameter over value. Bending frequencies are proportional to the height and to the
    root of Young's modulus, the mass to the height.
    """
    folder = example_folder("beam")
    data = tomllib.loads((folder / "beam.toml").read_text(encoding="utf-8"))
    for table, key, name, exact in (
        (data["geometry"]["section"], "height", "f1 by height", 1.0),
        (data["geometry"]["section"], "height", "mass by height", 1.0),
        (data["material"], "youngs_modulus", "f1 by E", 0.5),
        (data["material"], "youngs_modulus", "f3 by E", 0.5),
    ):
        value, found = table[key], []
        for share in (-1e-4, 0.0, 1e-4):
            table[key] = value * (1 + share)
            found.append(
                _measured(name, sidtool.convert(validate_data(data, ModelFile)))
            )
        table[key] = value
        slope = (found[2] - found[0]) / (2e-4 * found[1])
        yield Row(name, "exact", exact, slope)


def _measured(name: str, sid: SID) -> float:
    frequencies: Array = slender.hertz(sid)
    kind = name.split()[0]
    return sid.mass if kind == "mass" else float(frequencies[int(kind[1:]) - 1])


PROBLEMS: tuple[Problem, ...] = (
    _rod_frequencies,
    _membrane,
    _beam,
    _tower,
    _turbine,
    _analytic_beam,
    _interface_beam,
    _rotor,
    _tight_string,
    _stiffening_terms,
    _derivatives,
)
