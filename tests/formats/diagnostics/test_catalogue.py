"""The catalogue of diagnostics is complete, and agrees with the places that use it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import pytest

from sidtool.formats.diagnostics import WARNING, Entry, count_by_severity, diagnose
from sidtool.formats.diagnostics.entry import Value, fill, per_cent
from sidtool.formats.diagnostics.identities import IDENTITY_TEXTS
from sidtool.formats.diagnostics.record import CATALOGUE, GROUPS, example_of, find_code
from sidtool.formats.text import WIDTH
from sidtool.report.diagnostics import diagnostic_line, explain, list_codes

ROOT = Path(__file__).parents[3]
#: What an explanation of a warning names: a threshold, a formula or a quantity of one.
_MEASURE = re.compile(
    r"\d|=|eigenvalue|singular|null space|positive definite|norm|rtol|rank|residual|"
    r"max|finite",
    re.IGNORECASE,
)


def fields(template: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(template) if name}


def calls(code: str = "diagnose") -> Iterator[tuple[str, ast.Call]]:
    """Calls of `diagnose` in the source, with the file that holds them."""
    for folder in ("formats", "solver", "sidtool"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            for node in ast.walk(ast.parse(text)) if f"{code}(" in text else ():
                is_call = isinstance(node, ast.Call)
                if is_call and getattr(node.func, "id", "") == code:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", node


@pytest.mark.parametrize("entry", CATALOGUE.values(), ids=list(CATALOGUE))
def test_an_entry_is_complete(entry: Entry) -> None:
    assert re.fullmatch(r"N\d{3}", entry.code) and entry.code[:2] in GROUPS
    example = example_of(entry)
    assert not re.search(r"\{\w*\}", example.message + example.remedy)
    assert len(diagnostic_line(example).splitlines()[0]) <= WIDTH
    assert len(f"{example.severity} {example.message_line}") <= WIDTH
    assert "{" not in entry.explanation, "explanations have no values to fill in"
    assert not example.message.endswith(".") and len(entry.explanation) > 40
    if entry.severity == WARNING:
        assert _MEASURE.search(entry.explanation), "names neither formula nor threshold"
    for line in explain(entry.code).splitlines():
        assert len(line) <= WIDTH


def test_every_code_is_used_with_the_values_that_it_names() -> None:
    used, constants = set[str](), {"CHANGING_EQUATIONS": "N713"}
    for where, call in calls():
        first = call.args[0]
        if isinstance(first, ast.Constant):
            code = first.value
        elif isinstance(first, ast.Name) and first.id in constants:
            code = constants[first.id]
        else:  # chosen between codes of the same values
            continue
        used.add(code)
        entry = CATALOGUE[code]
        given = {keyword.arg for keyword in call.keywords}
        if None in given:  # more values by a mapping
            continue
        wanted = fields(entry.message) | fields(entry.remedy)
        assert wanted <= given, f"{where}: {code} lacks {wanted - given}"
        assert set(entry.units) <= given, f"{where}: {code}"
    text = "".join(
        path.read_text(encoding="utf-8")
        for folder in ("formats", "solver", "sidtool")
        for path in (ROOT / folder).rglob("*.py")
        if path.parent != ROOT / "formats/diagnostics"
    )
    rest = {code for code in set(CATALOGUE) - used if f'"{code}"' not in text}
    assert not rest - {"N103"} - {each.code for each in IDENTITY_TEXTS.values()}


def test_every_code_is_asked_for_by_a_test() -> None:
    own = Path(__file__).resolve()
    files = [p for p in (ROOT / "tests").rglob("test_*.py") if p.resolve() != own]
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    of_identities = {each.code for each in IDENTITY_TEXTS.values()}  # by a parameter
    assert {code for code in CATALOGUE if code not in text} <= of_identities


def test_codes_are_found_however_they_are_written() -> None:
    assert [find_code(text) for text in ("N411", "n411", " 411 ")] == ["N411"] * 3
    with pytest.raises(KeyError):
        find_code("N999")
    listed = list_codes()
    assert all(code in listed for code in CATALOGUE)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.28123, "m", "0.281 m"),
        (9810.0, "m/s2", "9810 m/s2"),
        (3e-4, "s", "0.0003 s"),
        (0.2812, "%", "28.1 %"),
        (1e-9, "%", "< 1e-06 %"),
        (2.5, "%", "250 %"),
        (3, "", "3"),
        (("a", "b"), "", "a, b"),
        ((0.5, 2.0), "kg m2", "0.5, 2 kg m2"),
    ],
)
def test_values_are_printed_with_few_digits_and_their_unit(
    value: Value, unit: str, text: str
) -> None:
    assert fill("{x}", {"x": value}, {"x": unit}) == text


@pytest.mark.parametrize(
    ("share", "text"), [(0.123, "12"), (0.997, "100"), (1.234, "123"), (-1.2, "-120")]
)
def test_per_cent_near_a_hundred_have_no_exponent(share: float, text: str) -> None:
    assert per_cent(share, ".2g") == text


def test_a_remedy_has_a_line_of_its_own_where_it_does_not_fit() -> None:
    name = "a_body_with_a_name_that_is_as_long_as_the_names_of_generated_models"
    lines = diagnostic_line(
        diagnose("N411", name, deflection=0.3, limit=0.1)
    ).splitlines()
    assert len(lines) > 1 and max(map(len, lines)) <= WIDTH


def test_counts_know_all_severities() -> None:
    found = [diagnose("N411", "b", deflection=0.3, limit=0.1), diagnose("N513", "m")]
    assert count_by_severity(found) == {"error": 0, "warning": 1, "info": 1}


def test_counts_agree_with_their_nouns() -> None:
    texts = [fill("{n:point mass} and {n:d}", {"n": n}, {}) for n in (0, 1, 2)]
    assert texts == [
        "0 point masses and 0",
        "1 point mass and 1",
        "2 point masses and 2",
    ]


@pytest.mark.parametrize("code", CATALOGUE)
def test_a_warning_says_what_to_do(code: str) -> None:
    """But for identities, whose causes only the writer of the SID knows."""
    entry = CATALOGUE[code]
    of_identities = {each.code for each in IDENTITY_TEXTS.values()}
    assert (
        example_of(entry).remedy or entry.severity != WARNING or code in of_identities
    )
