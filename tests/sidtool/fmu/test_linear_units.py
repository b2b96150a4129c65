"""Linearised scenes as units: matrices in model exchange, the matrix exponential."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

import numpy as np
import pytest
from scipy.linalg import expm

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from tests.codes import unwrapped
from tests.sidtool.fmu.conftest import slider_crank
from tests.sidtool.fmu.importer import ERROR, OK, Instance, Library, Real, Size

pytestmark = pytest.mark.needs("cc")

LOAD = 40.0


@pytest.fixture(scope="module")
def space() -> sidtool.StateSpace:
    """The slider-crank at an instant of its motion: rates are not 0."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sidtool.DiagnosticWarning)
        return slider_crank().state_space(
            about=0.2, outputs=["piston.x", "piston.ax", "rod.q1"]
        )


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def library(
    request: pytest.FixtureRequest,
    space: sidtool.StateSpace,
    tmp_path_factory: pytest.TempPathFactory,
) -> Library:
    folder = tmp_path_factory.mktemp("linear")
    space.fmu(folder / "plant.fmu", version=request.param)
    return Library(folder / "plant.fmu", folder / "unpacked")


def motion(space: sidtool.StateSpace, times: np.ndarray, load: float) -> np.ndarray:
    """Outputs (times, outputs) with a constant load, by the exponential of
    x' = A x + w, w' = 0."""
    n = len(space.A)
    constant = space.B[:, 0] * (load - space.inputs[0]) + space.state_rates
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = space.A, constant
    states = np.array([expm(whole * t)[:n, n] for t in times])
    direct = space.D[:, 0] * (load - space.inputs[0])
    return space.outputs + states @ space.C.T + direct


@pytest.mark.parametrize("length", [1e-4, 1e-3, 2e-2])
def test_co_simulation_is_exact_for_held_inputs(
    library: Library, space: sidtool.StateSpace, length: float
) -> None:
    """Whatever the communication step is."""
    instance = Instance(library)
    assert instance.set("load", LOAD) == OK
    rows = np.array(instance.run(0.1, length))
    expected = motion(space, length * np.arange(len(rows)), LOAD)
    error = np.abs(rows - expected).max(axis=0) / np.abs(expected).max(axis=0)
    assert error.max() < 1e-9
    instance.close()


def test_model_exchange_has_the_rates_and_all_derivatives(
    library: Library, space: sidtool.StateSpace
) -> None:
    instance = Instance(library, start=3.0, exchange=True)
    assert instance.set("load", LOAD) == OK
    x = np.random.default_rng(0).standard_normal(len(space.A))
    u = np.array([LOAD]) - space.inputs
    rates = space.state_rates + space.A @ x + space.B @ u
    assert instance.rates(x) == pytest.approx(rates, rel=1e-12)
    outputs = space.outputs + space.C @ x + space.D @ u
    assert instance.get(space.output_names) == pytest.approx(outputs, rel=1e-12)
    assert instance.get(["time"]) == [3.0]
    states = [f"states.{name}" for name in space.state_names]
    unknowns = [*(f"der({name})" for name in states), *space.output_names]
    whole = np.block([[space.B, space.A], [space.D, space.C]])
    for column, known in zip(whole.T, ["load", *states], strict=True):
        assert (np.array(instance.derivative(unknowns, known)) == column).all()
    instance.close()


def test_states_have_their_sizes(library: Library, space: sidtool.StateSpace) -> None:
    """What a load of 5 N, or the motion at the start, does to them: from (s - A)^-1."""
    n = len(space.A)
    nominals = (Real * n)()
    instance = Instance(library, exchange=True)
    call = "GetNominalsOfContinuousStates"
    assert instance.call(call, nominals, Size(n)) == OK
    listed = library.description.find("ModelVariables")
    assert listed is not None
    described = [
        float(str(real.get("nominal")))
        for variable in listed
        for real in (variable, *variable)
        if real.get("nominal")
    ]
    assert list(nominals) == described
    driven = np.column_stack([5.0 * space.B, space.state_rates])
    for rate in (1.0, np.abs(space.eigenvalues).max()):
        moved = np.linalg.solve(rate * np.eye(n) - space.A, driven)
        assert np.all(np.abs(moved).max(axis=1) <= np.array(nominals) * (1.0 + 1e-9))
    assert max(nominals[: n // 2]) < 1.0
    instance.close()


def test_states_are_restored_and_reset(library: Library) -> None:
    one, other = Instance(library), Instance(library)
    assert one.set("load", LOAD) == OK
    start = one.get()
    one.run(0.02, 1e-3)
    assert other.deserialise(one.serialised()) == OK
    assert one.step(0.02, 1e-3) == other.step(0.02, 1e-3) == OK
    assert one.get() == other.get() != start
    one.reset()
    assert one.set("load", LOAD) == OK and one.get() == start
    assert one.step(5e-3, 1e-3) == ERROR  # not the end of the step before


def base_units(root: Element, unit: str | None) -> dict[str, int]:
    """Exponents of the base units of a unit in a description."""
    (base,) = root.findall(f"UnitDefinitions/Unit[@name='{unit}']/BaseUnit")
    return {name: int(exponent) for name, exponent in base.attrib.items()}


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_rates_have_the_units_of_states_per_second(
    version: str, without_library: None, tmp_path: Path
) -> None:
    """A mass on a rail has the states x [m] and vx [m/s]."""
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"m": {"mass": 1.0}},
        "joints": {"rail": {"type": "prismatic", "markers": ["ground", "m"]}},
    }
    space = sidtool.Scene.checked(data, "test").state_space(outputs=["m.x"])
    space.fmu(tmp_path / "plant.fmu", version=version)
    with zipfile.ZipFile(tmp_path / "plant.fmu") as archive:
        root = fromstring(archive.read("modelDescription.xml"))
    variables = root.find("ModelVariables")
    assert variables is not None
    found = {}
    for variable in variables:
        kind = variable[0] if version == "2.0" else variable
        found[variable.get("name")] = kind.get("unit")
    for state, exponent in (("x", -1), ("vx", -2)):
        rate = found[f"der(states.m.{state}_body)"]
        assert base_units(root, rate) == {"m": 1, "s": exponent}


def test_the_description_names_states_and_their_rates(
    library: Library, space: sidtool.StateSpace
) -> None:
    root, is_2 = library.description, library.version == "2.0"
    assert root.find("ModelExchange") is not None
    listed = root.find("ModelVariables")
    assert listed is not None
    variables = {str(v.get("name")): v for v in listed}
    order = list(variables)
    assert set(space.state_units) == {""}
    for name in space.state_names:
        rate = variables[f"der(states.{name})"]
        kind = rate[0] if is_2 else rate
        number = int(kind.get("derivative", ""))
        by_number = order[number - 1] if is_2 else order[number]
        assert by_number == f"states.{name}"
        assert base_units(root, kind.get("unit")) == {"s": -1}
    structure = root.find("ModelStructure")
    assert structure is not None
    kinds = ("Derivatives/Unknown",) if is_2 else ("ContinuousStateDerivative",)
    assert [len(structure.findall(kind)) for kind in kinds] == [len(space.A)]


@pytest.mark.needs("fmpy")
@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
def test_fmpy_integrates_the_unit(
    library: Library, space: sidtool.StateSpace, kind: str
) -> None:
    """It finds no problem in the description, and moves as the exponential says.

    In model exchange with an absolute tolerance that is scaled by nominals.
    """
    from fmpy import simulate_fmu
    from fmpy.validation import validate_fmu

    file = library.path.parents[3] / "plant.fmu"
    assert validate_fmu(str(file)) == []
    found = simulate_fmu(
        str(file),
        fmi_type=kind,
        stop_time=0.05,
        output_interval=1e-3,
        relative_tolerance=1e-6,
        start_values={"load": LOAD},
        output=["rod.q1"],
    )
    expected = motion(space, found["time"], LOAD)[:, 2]
    error = np.abs(found["rod.q1"] - expected).max() / np.abs(expected).max()
    assert error < 1e-5


def test_the_command_writes_the_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(
        """format = "sidtool scene"
version = 1
dimension = "planar"
gravity = [0.0, 0.0]
inputs.load.initial = 0.0
bodies.block.mass = 2.0
time.end = 1.0

[joints.guide]
type = "point_on_line"
markers = ["ground", "block"]

[forces.spring]
type = "spring_damper"
markers = ["ground", "block"]
rest = 0.0
stiffness = 50.0

[forces.load]
type = "force"
marker = "block"
force = [1.0, 0.0]
function = { type = "input", name = "load" }

[outputs]
record = ["block.x"]
""",
        encoding="utf-8",
    )
    target = tmp_path / "plant.fmu"
    assert run(["linearise", str(scene), "-o", str(target), "--fmi", "3.0"]) == 0
    assert Library(target, tmp_path / "unpacked").version == "3.0"
    for option in ("--fmi", "--platforms"):
        value = {"--fmi": "2.0", "--platforms": "linux64"}[option]
        wrong = ["linearise", str(scene), "-o", str(tmp_path / "plant.npz")]
        assert run([*wrong, option, value]) == 2
        assert option in unwrapped(capsys.readouterr().err)
    assert not (tmp_path / "plant.npz").exists()


def test_a_version_that_does_not_exist_is_refused(
    space: sidtool.StateSpace, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=r"1\.0"):
        space.fmu(tmp_path / "plant.fmu", version="1.0")
    assert not [*tmp_path.iterdir()]
