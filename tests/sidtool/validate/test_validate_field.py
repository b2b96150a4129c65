"""The verdicts and deviations of four files that other tools wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.formats.sid_files import read_sid
from sidtool.validate import check, guess_units, verdict
from sidtool.validate.checks import Check

BEAM_3M, BALKEN, BEAM, EXAMPLE = (
    "Beam_3m.SID_FEM",
    "balken1m.SID_FEM",
    "beam.SID_FEM",
    "example.sid_fem",
)


@pytest.fixture(scope="module")
def judged(field_data: Path) -> dict[str, dict[str, Check]]:
    names = (BEAM_3M, BALKEN, BEAM, EXAMPLE)
    return {
        name: {c.id: c for c in check(read_sid(field_data / "sid" / name))}
        for name in names
    }


def _named(checks: dict[str, Check], verdict: str) -> set[str]:
    return {c.id for c in checks.values() if c.verdict == verdict}


@pytest.mark.parametrize(
    ("file", "failed", "not_applicable"),
    [
        (BEAM_3M, {"I11", "I12", "I14"}, {"I20"}),
        (BALKEN, {"I12", "I14"}, {"I17", "I20"}),
        (BEAM, {"I10", "I11", "I12"}, {"I20"}),
        (EXAMPLE, {"I8", "I9", "I12", "I15"}, {"I10", "I16", "I20"}),
    ],
)
def test_verdicts(
    judged: dict[str, dict[str, Check]],
    file: str,
    failed: set[str],
    not_applicable: set[str],
) -> None:
    assert _named(judged[file], "failed") == failed
    assert _named(judged[file], "not applicable") == not_applicable


# Two digits each, as an independent evaluation of the same identities printed them.
@pytest.mark.parametrize(
    ("file", "name", "expected"),
    [
        (BEAM_3M, "I5", 2e-14),
        (BALKEN, "I5", 1e-14),
        (BEAM, "I5", 3e-12),
        (BEAM_3M, "I6", 1.0e-12),
        (BALKEN, "I6", 9.4e-13),
        (BEAM, "I6", 9.7e-13),
        (BEAM_3M, "I7", 1.0e-12),
        (BALKEN, "I7", 5e-13),
        (BEAM, "I7", 2.0e-12),
        (EXAMPLE, "I7", 1.1e-12),
        (EXAMPLE, "I8", 0.03),
        (BEAM_3M, "I9", 1e-15),
        (BEAM, "I9", 1e-14),
        (EXAMPLE, "I9", 0.07),
        (BEAM_3M, "I10", 2e-2),
        (BALKEN, "I10", 4e-2),
        (BEAM, "I10", 0.50),
        (BEAM_3M, "I11", 1.0),
        (BEAM, "I11", 1.0),
        (BEAM_3M, "I12", 0.98),
        (BALKEN, "I12", 0.15),
        (BEAM_3M, "I14", 0.44),
        (BALKEN, "I14", 1.74),
        (BEAM_3M, "I15", 3.5e-5),
        (BALKEN, "I15", 3.4e-5),
        (BEAM, "I15", 6e-6),
    ],
)
def test_deviations(
    judged: dict[str, dict[str, Check]], file: str, name: str, expected: float
) -> None:
    digits = len(f"{expected:e}".split("e")[0].rstrip("0").replace(".", ""))
    measured = judged[file][name].measured
    assert measured is not None
    # One printed digit may stand for a rounding or a cut after it.
    assert measured == pytest.approx(expected, rel=0.06 if digits > 1 else 0.5)


@pytest.mark.parametrize(
    ("file", "name"),
    [
        *((file, name) for file in (BEAM_3M, BALKEN) for name in ("I2", "I3", "I4")),
        *((EXAMPLE, name) for name in ("I2", "I3", "I4", "I5", "I6")),
        *((BEAM, name) for name in ("I2", "I3")),
    ],
)
def test_exact_copies(
    judged: dict[str, dict[str, Check]], file: str, name: str
) -> None:
    assert judged[file][name].measured == 0.0


@pytest.mark.parametrize(
    ("file", "name", "text"),
    [
        (BEAM_3M, "I6", "mode-major; the other layout would give 1.0e+00"),
        (BEAM, "I6", "mode-major; the other layout would give 9.1e-01"),
        (EXAMPLE, "I6", "axis-major; the other layout would give 6.8e-02"),
        (BEAM_3M, "I7", "axis-major; the other layout would give 1.0e+00"),
        (BEAM, "I7", "axis-major; the other layout would give 1.8e+00"),
        (BEAM_3M, "I5", "exchanged 9.9e-01"),
        (BALKEN, "I5", "exchanged 9.2e-01"),
        (BEAM, "I5", "exchanged 9.7e-01"),
        (BEAM, "I4", "both sides are zero"),
        (BALKEN, "I9", "rounding noise only"),
        (EXAMPLE, "I14", "smallest relative eigenvalue 1.20e-01 in its plane"),
        (BEAM_3M, "I17", "De = 2.13 Me + 4e-05 Ke"),
        (BEAM, "I17", "De = 0.01 Ke"),
        (EXAMPLE, "I17", "zeta = 0.02 for every coordinate"),
    ],
)
def test_details(
    judged: dict[str, dict[str, Check]], file: str, name: str, text: str
) -> None:
    assert text in judged[file][name].detail


def test_two_bodies_are_impossible(judged: dict[str, dict[str, Check]]) -> None:
    good = {name: verdict(list(checks.values())) for name, checks in judged.items()}
    assert good == {BEAM_3M: False, BALKEN: False, BEAM: True, EXAMPLE: True}
    assert "cannot move freely" in judged[BALKEN]["I14"].meaning


@pytest.mark.parametrize(
    ("file", "system"),
    [
        (BEAM_3M, "m-kg-s"),
        (BALKEN, "m-kg-s"),
        (BEAM, "m-kg-s"),
        (EXAMPLE, "mm-kg-s"),
    ],
)
def test_units(field_data: Path, file: str, system: str) -> None:
    guess = guess_units(read_sid(field_data / "sid" / file))
    assert guess.system == system
    assert bool(guess.warnings) == (system != "m-kg-s")
