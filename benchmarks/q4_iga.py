"""The founding question: Q4 against IGA at equal error."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

from sidtool.formats.base.sid import SID
from sidtool.formats.model import read_model
from sidtool.formats.model.refine import refine_model
from sidtool.formats.reference import read_reference
from sidtool.formats.scene import read_scene
from sidtool.measurement.tasks import ConversionOutcome, convert_model
from sidtool.study import Point, Setting, Study, run_study

from .machine import describe_machine
from .report import Report, Table

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank"
MODELS = {"Q4": "rod_q4.toml", "IGA": "rod_iga.toml"}
#: Halvings of the elements of the models, for frequencies and for the motion.
LEVELS, MESHES = {"Q4": (-2, -1, 0, 1, 2), "IGA": (-2, -1, 0, 1)}, (-2, -1, 0, 1)
MODES = (1, 3, 5)
OUTPUTS = ("piston.x", "rod.q1", "rod.q2")
SETTING = Setting("radau9", rtol=1e-8)
#: Requested relative errors.
WANTED = (1e-1, 1e-2, 1e-3, 1e-4)
#: Half of the last digit of the converged frequencies.
DIGITS = 2e-5


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    """Frequencies beside the converged ones, and the motion beside its richest run."""
    exact = converged()
    bodies = [
        (kind, level, created)
        for kind, file in MODELS.items()
        for level, created in conversions(EXAMPLE / file, LEVELS[kind], say)
    ]
    errors = [deviation(created.sid, exact) for *_, created in bodies if created.sid]
    with tempfile.TemporaryDirectory() as retained:
        motion = run_study(
            read_scene(EXAMPLE / "slider_crank.toml"),
            {"mesh": MESHES, "modes": MODES},
            models={"rod": [EXAMPLE / file for file in MODELS.values()]},
            settings=[SETTING],
            outputs=OUTPUTS,
            differ=3,
            keep=Path(retained),
            jobs=1,
            say=lambda text, done, count, _: say(f"{done} of {count}: {text}"),
        )
    reference = motion.reference
    return Report(
        "The founding question: Q4 against IGA at equal error",
        [
            frequencies(bodies, errors),
            equal_frequencies(bodies, errors),
            motions(motion),
            equal_motions(motion),
        ],
        [
            "Piston rod of the founding slider-crank. Frequencies: the first five, "
            "clamped at the left edge, beside 31.475, 199.121, 556.673, 1074.370 and "
            f"1254.901 Hz (IGA of degree 8, refined until the digits stand; {DIGITS:g} "
            "is what these digits tell). Motion: the worst of "
            f"{', '.join(OUTPUTS)} over 3 s, `sidtool study --over mesh,modes`, beside "
            f"{reference.model}, good to {reference.uncertainty:.0e}. Conversion: all "
            "of it, in seconds of the processor, one BLAS thread."
        ],
        machine=describe_machine(),
    )


def converged() -> np.ndarray:
    """The frequencies of the rod whose digits stand [Hz]."""
    rows = read_reference(EXAMPLE / "frequencies.toml").frequencies
    return np.array(next(row.hertz for row in rows if row.name == "converged"))


def conversions(
    path: Path, levels: Iterable[int], say: Callable[[str], None]
) -> Iterable[tuple[int, ConversionOutcome]]:
    for level in levels:
        model = refine_model(read_model(path), level)
        assert model is not None
        created = convert_model(model)
        say(f"{path.stem} {level:+d}: {created.dofs} dofs, {created.seconds:.2f} s")
        yield level, created


def deviation(sid: SID, exact: np.ndarray) -> float:
    """The largest relative error of the first frequencies."""
    squares = eigh(sid.Ke.m0, sid.Me.m0, eigvals_only=True)
    hertz = np.sqrt(squares[: len(exact)]) / (2.0 * np.pi)
    return float(np.abs(hertz / exact - 1.0).max())


def frequencies(
    bodies: Sequence[tuple[str, int, ConversionOutcome]], errors: Sequence[float]
) -> Table:
    rows = [
        [
            kind,
            f"{level:+d}",
            str(created.dofs),
            f"{created.seconds:.2f}",
            error_text(error),
        ]
        for (kind, level, created), error in zip(bodies, errors, strict=True)
    ]
    header = ["model", "halvings", "dofs", "conversion [s]", "worst of f1 to f5"]
    return Table("Frequencies over the mesh", header, rows, summary=True)


def equal_frequencies(
    bodies: Sequence[tuple[str, int, ConversionOutcome]], errors: Sequence[float]
) -> Table:
    rows = []
    for wanted in WANTED:
        cells = [f"{wanted:.0e}"]
        for kind in MODELS:
            good = [
                created
                for (found, _, created), error in zip(bodies, errors, strict=True)
                if found == kind and error <= wanted
            ]
            best = min(good, key=lambda created: created.dofs, default=None)
            cells += [str(best.dofs), f"{best.seconds:.2f}"] if best else ["-", "-"]
        rows.append(cells)
    header = [
        "error of f1 to f5",
        *(f"{k}: {w}" for k in MODELS for w in ("dofs", "s")),
    ]
    return Table(
        "The smallest mesh that keeps an error of frequencies",
        header,
        rows,
        summary=True,
    )


def motions(motion: Study) -> Table:
    rows = [
        [
            p.choices["model"],
            p.choices["mesh"],
            p.choices["modes"],
            str(p.dofs),
            f"{p.conversion:.2f}",
            f"{p.seconds:.3f}",
            f"{p.error:.1e}" if p.is_resolved else f"<{p.error:.1e}",
        ]
        for p in sorted(motion.points, key=_order)
    ]
    header = ["model", "halvings", "shape functions", "dofs", "conversion [s]"]
    return Table(
        "The motion over 3 s", [*header, "solve [s]", "error"], rows, summary=True
    )


def equal_motions(motion: Study) -> Table:
    rows = []
    for wanted in WANTED:
        cells = [f"{wanted:.0e}"]
        for file in MODELS.values():
            good = [
                p
                for p in motion.points
                if p.choices["model"] == Path(file).stem and p.error <= wanted
            ]
            best = min(good, key=lambda p: (p.dofs, p.size), default=None)
            cells += (
                [str(best.dofs), f"{best.conversion:.2f}", str(best.size)]
                if best
                else ["-", "-", "-"]
            )
        rows.append(cells)
    costs = ("dofs", "s", "shape functions")
    header = ["error of the motion", *(f"{k}: {w}" for k in MODELS for w in costs)]
    return Table(
        "The smallest model that keeps an error of the motion",
        header,
        rows,
        summary=True,
    )


def _order(point: Point) -> tuple[str, int, int]:
    choices = point.choices
    return choices["model"], int(choices["mesh"]), int(choices["modes"])


def error_text(error: float) -> str:
    return f"{error:.1e}" if error > DIGITS else f"<{DIGITS:.0e}"
