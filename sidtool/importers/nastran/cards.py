"""Cards of Nastran bulk data: small, large and free fields, and continuations.

Cards of former NASTRAN as the cards that replaced them.

CQUAD1 and CTRIA1 have a membrane, a moment of inertia and a shear thickness of their
own; CQUAD2 and CTRIA2 one homogeneous thickness, all of which shears; CQDMEM, CQDMEM1,
CQDMEM2 and CTRMEM a membrane alone (NASTRAN User's Manual, NASA SP-222).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_label, is_plain
from sidtool.formats.toml.reading import LARGEST_NUMBER

from ...mesh.deck_text import (
    NAME_LINES,
    IncludedFiles,
    check_label,
    joined_name,
    located_line,
    named_file,
    parse_integers,
    parse_numbers,
    read_lines,
)
from ...mesh.imported_mesh import MOST_MEMBERS

_MEMBRANES = ("PQDMEM", "PQDMEM1", "PQDMEM2", "PTRMEM")
#: Former element -> its replacement, with fields in the same order.
_ELEMENTS = {
    **dict.fromkeys(("CQUAD1", "CQUAD2", "CQDMEM", "CQDMEM1", "CQDMEM2"), "CQUAD4"),
    **dict.fromkeys(("CTRIA1", "CTRIA2", "CTRMEM"), "CTRIA3"),
    "CTUBE": "CROD",
}
#: Cards that hold two elements or two properties of four fields each.
_TWO = (
    "CROD",
    "CTUBE",
    "PQUAD2",
    "PTRIA2",
    *_MEMBRANES,
)

#: Blanks behind a sign or before an exponent, which Nastran skips.
_BLANKS = re.compile(r"(?<=^[+-]) +|(?<=[\d.]) +(?=[EeDd+-])|(?<=[EeDd]) +")
#: A real number whose exponent has no letter, as in 2.1+11.
_EXPONENT = re.compile(r"^([+-]?(?:\d++\.?+\d*+|\.\d++))([+-]\d++)$")
#: Name of the card that represents case control.
CASE_CONTROL = "CASE CONTROL"
#: Card of formulas, whose commas separate no fields.
_EQUATION = "DEQATN"
#: How lines may begin that are no cards: BEGIN, ENDDATA, INCLUDE.
_COMMAND_STARTS = frozenset(" BbEeIi")
_MPC = re.compile(r"MPC ?= ?(\d{1,18})$", re.ASCII)
_TEMPERATURE = re.compile(r"TEMP(ERATURE)? ?(\(.*\))? ?=")
#: Mark of a case control that selects temperatures.
HEATED = "TEMPERATURE"
#: Commands of case control without an equals sign.
_CONTROL = ("SUBCASE", "SUBCOM", "SUBSEQ", "SYM", "REPCASE", "OUTPUT", "ECHO")


def current_cards(card: Card) -> Iterator[Card]:
    """Yield the present cards of a card that may be a former one.

    Raises
    ------
    InputError : a tube is no tube, or has two diameters.
    """
    for part in _halves(card):
        if part.name in _ELEMENTS:
            yield replace(part, name=_ELEMENTS[part.name])
        elif part.name in ("PQUAD1", "PTRIA1"):
            yield _general_shell(part)
        elif part.name in ("PQUAD2", "PTRIA2"):
            yield _homogeneous_shell(part)
        elif part.name in _MEMBRANES:
            label, material, t, extra = (part.word(i) for i in range(4))
            words = [label, material, t, "", "", "", "", extra]
            yield replace(part, name="PSHELL", words=words)
        elif part.name == "PTUBE":
            yield _rod_of_tube(part)
        else:
            yield part


def _halves(card: Card) -> list[Card]:
    if card.name not in _TWO or not any(card.words[4:8]):
        return [card]
    return [replace(card, words=card.words[i : i + 4]) for i in (0, 4)]


def _general_shell(card: Card) -> Card:
    """PID, MID1, T1, MID2, I, MID3, T3, NSM."""
    t, inertia, across = (card.real(i, "a number") for i in (2, 4, 6))
    if t <= 0:
        raise InputError(
            f"{card.name} {card.word(0)} has no membrane",
            place=card.place,
            expected="MID1, and T1 above zero",
        )
    bending = card.word(3) if inertia else ""
    ratio = repr(12 * inertia / t**3) if inertia else ""
    shear = card.word(5) if across else ""
    words = [card.word(0), card.word(1), card.word(2), bending, ratio, shear]
    words += [repr(across / t) if shear else "", card.word(7)]
    return replace(card, name="PSHELL", words=words)


def _homogeneous_shell(card: Card) -> Card:
    """PID, MID, T, NSM."""
    label, material, t, extra = (card.word(i) for i in range(4))
    words = [label, material, t, material, "", material, "1.0", extra]
    return replace(card, name="PSHELL", words=words)


def _rod_of_tube(card: Card) -> Card:
    """PID, MID, OD, T, NSM, OD2."""
    outer, t = card.real(2, "a diameter"), card.real(3, "a thickness")
    inner = outer - 2 * t if t else 0.0
    if outer <= 0 or not 0 <= inner < outer or card.real(5, "", outer) != outer:
        raise InputError(
            f"PTUBE {card.word(0)} has OD = {outer:g}, T = {t:g} and OD2 = "
            f"{card.word(5) or outer}",
            place=card.place,
            expected="one outer diameter, and a thickness up to half of it",
        )
    area = np.pi / 4 * (outer**2 - inner**2)
    torsion = np.pi / 32 * (outer**4 - inner**4)
    words = [card.word(0), card.word(1), repr(float(area)), repr(float(torsion))]
    return replace(card, name="PROD", words=[*words, "", card.word(4)])


#: Columns of the fields of a line: its name, the data, the mark at its end.
_NARROW, _WIDE = (
    [slice(8), *(slice(s, s + width) for s in range(8, 72, width)), slice(72, 80)]
    for width in (8, 16)
)

#: How the lines of a card GRID begin, in small and in large fields, and the columns of
#: its number, its system and its coordinates.
_GRID_HEADS = {False: ("GRID    ",), True: ("GRID*   ", "*       ")}
_GRID_FIELDS = {1: (_NARROW[1:6],), 2: (_WIDE[1:5], _WIDE[1:2])}
#: How cards of solids begin, in small fields, and their continuations.
_SOLIDS = ("CTETRA  ", "CHEXA   ", "CPENTA  ", "CPYRAM  ")
_CONTINUATIONS = ("        ", "+       ")
_RUN_STARTS = ("GRID", *_SOLIDS)
#: Where the field with the mark of a continuation begins.
_MARK_START = 72
#: Lines of cards of one kind that are read at once.
_MOST_IN_RUN = 20_000


@dataclass(slots=True)
class Card:
    """One card with all its continuations.

    Attributes
    ----------
    name : in capitals, without the star of large fields
    words : the data fields, "" for a blank one
    after : mark at the end of its last line, to find the continuation
    """

    name: str
    place: str
    words: list[str] = field(default_factory=list)
    after: str = ""

    def word(self, i: int) -> str:
        """Data field i from 0, "" beyond the last."""
        return self.words[i] if i < len(self.words) else ""

    def integer(self, i: int, what: str, default: int | None = None) -> int:
        """A whole number.

        Raises
        ------
        InputError : there is none, and no default.
        """
        word = self.words[i] if i < len(self.words) else ""
        if not word and default is not None:
            return default
        if is_label(word):  # nearly all of a large mesh
            return int(word)
        return parse_integers([word], self.place, f"{self.name}: {what}")[0]

    def label(self, i: int, what: str) -> int:
        """The number of a node or an element.

        Raises
        ------
        InputError : it is no integer above zero.
        """
        label = self.integer(i, f"{what} number")
        if label < 1:
            check_label(label, self.place, f"{self.name}: {what}")
        return label

    def real(self, i: int, what: str, default: float = 0.0) -> float:
        """A real number, as Nastran writes it.

        Raises
        ------
        InputError : it is none.
        """
        word = self.words[i] if i < len(self.words) else ""
        if not word:
            return default
        try:
            value = float(word)
            if "." in word and is_plain(word) and abs(value) <= LARGEST_NUMBER:
                return value
        except ValueError:
            pass
        return real_number(word, f"{self.name}: {what}", self.place)


@dataclass(slots=True)
class GridRun(Card):
    """Many cards GRID behind each other, without directions, supports and marks.

    Attributes
    ----------
    labels : numbers of the nodes, all different
    positions : coordinates
    systems : of the coordinates, -1 for that of GRDSET
    places : locations of the cards
    """

    labels: Sequence[int] = ()
    positions: Sequence[tuple[float, float, float]] = ()
    systems: Sequence[int] = ()
    places: Sequence[str] = ()


@dataclass(slots=True)
class SolidRun(Card):
    """Many cards of solid elements with as many fields, all of them whole numbers.

    Attributes
    ----------
    fields : of every card
    places : locations of the cards
    """

    fields: Sequence[Sequence[int]] = ()
    places: Sequence[str] = ()


def real_number(word: str, what: str, place: str) -> float:
    """A real number, as Nastran writes it.

    Raises
    ------
    InputError : it is none.
    """
    closed = _BLANKS.sub("", word)
    if is_label(closed.lstrip("+-")) and closed.strip("+-0"):
        raise InputError(
            f"found {word.strip()!r}",
            place=place,
            expected=f"{what}, with a decimal point",
        )
    return parse_numbers([_EXPONENT.sub(r"\1E\2", closed)], place, what)[0]


def is_real(word: str) -> bool:
    """Whether Nastran reads a field as a real number: it has a decimal point."""
    return "." in word


def read_cards(path: Path, included: IncludedFiles | None = None) -> list[Card]:
    """The cards of the bulk data; without BEGIN BULK the whole file is bulk data.

    Raises
    ------
    InputError : the file is not valid; the error names file and line.
    """
    included = included or IncludedFiles()
    included.enter(path)
    lines = list(enumerate(read_lines(path), start=1))
    start, control = _split_case_control(path, lines, included)
    collector = _CardCollector()
    cards = collector.cards
    nested = path.name if len(included.open) > 1 else ""
    i = by_card = start
    while i < len(lines):
        number, raw = lines[i]
        if i >= by_card and raw.startswith(_RUN_STARTS):
            read_run = _grid_run if raw.startswith("GRID") else _solid_run
            run, by_card = read_run(lines, i, nested)
            if run is not None:
                cards.append(run)
                i = by_card
                continue
        i += 1
        text = raw.split("$", 1)[0].rstrip()
        if not text:
            continue
        if "\t" in text:
            text = text.expandtabs(8)
        place = located_line(number, nested)
        if text[0] not in _COMMAND_STARTS:  # nearly all lines of a large mesh
            collector.add(text, place)
            continue
        first = text.split(None, 1)[0].split(",", 1)[0].upper()
        if first == "ENDDATA":
            break
        if first == "BEGIN":
            raise _superelement_error(text, place)
        if first == "INCLUDE":
            further = [text for _, text in lines[i : i + NAME_LINES]]
            file, count = _included_file(path, text, further, place)
            cards += read_cards(file, included)
            i += count
            continue
        collector.add(text, place)
    included.open.pop()
    # parameters of case control take precedence over those of the bulk data
    return control[:1] + collector.finish() + control[1:]


def _grid_run(
    lines: list[tuple[int, str]], first: int, nested: str
) -> tuple[GridRun | None, int]:
    """Return the cards GRID from a line on, and the number of the line behind them.

    They are None if one of them has other fields than a number, a system and plain
    coordinates: then the cards are read one by one.
    """
    heads = _GRID_HEADS[lines[first][1].startswith(_GRID_HEADS[True][0])]
    columns, behind = _uniform_columns(lines, first, heads, _GRID_FIELDS[len(heads)])
    if columns is None:
        return None, behind
    labels, systems, *axes = columns
    if any("".join(axis).count(".") < len(axis) for axis in axes):
        return None, behind
    try:
        numbers = list(map(int, labels))
        known = {x: int(x) if x.strip() else -1 for x in set(systems)}
        positions = list(zip(*(map(float, x) for x in axes), strict=True))
    except ValueError:
        return None, behind
    is_usual = (np.abs(positions) <= LARGEST_NUMBER).all() and min(numbers) > 0
    is_usual = is_usual and all("-" not in x for x in known)
    if not is_usual or len(set(numbers)) < len(numbers):
        return None, behind
    places = [located_line(n, nested) for n, _ in lines[first : behind : len(heads)]]
    chosen = [known[x] for x in systems]
    run = GridRun("GRID", places[0], [], "", numbers, positions, chosen, places)
    return run, behind


def _solid_run(
    lines: list[tuple[int, str]], first: int, nested: str
) -> tuple[SolidRun | None, int]:
    """Return the cards of solids from a line on, and the number of the line behind
    them; None if one of them has other fields than whole numbers.
    """
    heads = [lines[first][1][:8]]
    for _, text in lines[first + 1 : first + 4]:
        if text[:8] not in _CONTINUATIONS:
            break
        heads.append(text[:8])
    ending = lines[first + len(heads) - 1][1].rstrip()
    fields = [_NARROW[1:9]] * (len(heads) - 1) + [_NARROW[1 : (len(ending) + 7) // 8]]
    columns, behind = _uniform_columns(lines, first, tuple(heads), fields)
    if columns is None:
        return None, behind
    try:
        rows = list(zip(*(map(int, x) for x in columns), strict=True))
    except ValueError:
        return None, behind
    places = [located_line(n, nested) for n, _ in lines[first : behind : len(heads)]]
    return SolidRun(heads[0].rstrip(), places[0], [], "", rows, places), behind


def _uniform_columns(
    lines: list[tuple[int, str]],
    first: int,
    heads: Sequence[str],
    fields: Sequence[Sequence[slice]],
) -> tuple[list[list[str]] | None, int]:
    """Return the fields of cards of one form from a line on, and the number of the line
    behind them; None if one has further fields.

    The last of the cards is omitted, since it may have continuations or be replicated.

    Parameters
    ----------
    heads : how the lines of a card begin
    fields : columns of the fields in each of its lines
    """
    size = len(heads)
    texts = [text for _, text in lines[first : first + _MOST_IN_RUN]]
    others = (i for i, x in enumerate(texts) if x[:8] != heads[i % size])
    count = size * (next(others, len(texts)) // size - 1)
    if count <= 0:
        return None, first + size
    parts = [[x.rstrip() for x in texts[i:count:size]] for i in range(size)]
    for i, own in enumerate(fields):
        end = own[-1].stop if own else 8
        text = "".join(parts[i])
        if "\t" in text or "," in text or not is_plain(text):
            return None, first + count
        if i < size - 1:  # marks of continuations that follow at once mean nothing
            parts[i] = [x[:_MARK_START] for x in parts[i]]
        if max(map(len, parts[i])) > end:
            return None, first + count
    pairs = zip(parts, fields, strict=True)
    columns = [[x[field] for x in part] for part, own in pairs for field in own]
    return columns, first + count


def _split_case_control(
    path: Path, lines: list[tuple[int, str]], included: IncludedFiles
) -> tuple[int, list[Card]]:
    """Return where bulk data begin, and the case control before them as cards.

    They begin after BEGIN BULK, or without it after the case control that follows CEND,
    or without that at the start of the file. The first card holds the sets that MPC
    selects, and as its mark whether there are temperatures. PARAM WTMASS may follow.
    """
    begin = _first_line(lines, "BEGIN BULK", "BULK")
    end = _first_line(lines[:begin], "CEND", "CEND")
    if begin is None and end is None:
        return 0, []
    own = [_without_blanks(text.split("$")[0]) for _, text in lines[:begin]]
    start = len(own)
    if begin is None and end is not None:
        rest = range(end + 1, len(own))
        start = next((i for i in rest if not _is_control(own[i])), start)
    if not any(own[:start]):
        return start + (begin is not None), []
    first = 0 if end is None else end + 1
    texts = list(_control_texts(path, lines[first:start], included))
    named = [_MPC.match(text) for text, _ in texts]
    words = [match.group(1) for match in named if match]
    is_heated = any(_TEMPERATURE.match(text) for text, _ in texts)
    mark = HEATED if is_heated else ""
    split = [(text.replace(",", " ").split(), place) for text, place in texts]
    return start + (begin is not None), [
        Card(CASE_CONTROL, f"line {start}", words, mark),
        *(
            Card("PARAM", place, words[1:])
            for words, place in split
            if words[:2] == ["PARAM", "WTMASS"]
        ),
    ]


def _control_texts(
    path: Path, lines: list[tuple[int, str]], included: IncludedFiles
) -> Iterator[tuple[str, str]]:
    """The commands of case control and of the files that it includes, with places."""
    nested = path.name if len(included.open) > 1 else ""
    for i, (number, raw) in enumerate(lines):
        text, place = raw.split("$")[0].strip(), located_line(number, nested)
        if text.split(None, 1)[:1] and text.split(None, 1)[0].upper() == "INCLUDE":
            further = [line for _, line in lines[i + 1 : i + 1 + NAME_LINES]]
            file, _ = _included_file(path, text, further, place)
            included.enter(file)
            numbered = list(enumerate(read_lines(file), start=1))
            yield from _control_texts(file, numbered, included)
            included.open.pop()
        elif text[:6].upper() == "BEGIN ":
            raise _superelement_error(text, place)
        else:
            yield _without_blanks(text), place


def _superelement_error(text: str, place: str) -> InputError:
    return InputError(
        f"holds {text.strip()}, which is not supported",
        place=place,
        expected="bulk data without superelements",
    )


def _first_line(lines: list[tuple[int, str]], command: str, part: str) -> int | None:
    """The first line that is a command, of those with a part of it."""
    likely = (i for i, (_, text) in enumerate(lines) if part in text.upper())
    return next(
        (i for i in likely if _without_blanks(lines[i][1].split("$")[0]) == command),
        None,
    )


def _is_control(text: str) -> bool:
    return not text or "=" in text or text.split()[0] in _CONTROL


def _without_blanks(text: str) -> str:
    return " ".join(text.upper().split())


def _included_file(
    path: Path, text: str, following: Sequence[str], place: str
) -> tuple[Path, int]:
    """The file that a line includes, and how many lines continue its name."""
    name, count = joined_name(text.strip()[len("INCLUDE") :], following)
    if not name:
        raise InputError(
            "names no file",
            place=place,
            expected="INCLUDE 'FILE'",
        )
    return named_file(path, name), count


class _CardCollector:
    """Lines as cards; continuations with a mark may stand apart from their card."""

    def __init__(self) -> None:
        self.cards: list[Card] = []
        self._apart: list[tuple[str, list[str], str, str, str]] = []
        self._changes: list[str] = []

    def add(self, text: str, place: str) -> None:
        """Add a line as a new card, or as a continuation."""
        if text[0] in "Dd " and text[:8].strip().upper() == _EQUATION:
            self.cards.append(Card(_EQUATION, place))
            return
        if text[0] in " +*" and self.cards and self.cards[-1].name == _EQUATION:
            return
        name, words, after = _split_fields(text, place)
        if name[:1] == "=":
            self._replicate(name, words, place)
            return
        if name and name[0] not in "+*":
            self.cards.append(Card(name.rstrip("* "), place, words, after))
            return
        mark = name.lstrip("+*")
        if self.cards and (not mark or _matches(self.cards[-1].after, mark)):
            _continue(self.cards[-1], words, after)
        else:
            self._apart.append((mark, words, after, text, place))

    def _replicate(self, name: str, words: list[str], place: str) -> None:
        """Add the card before with other fields, or do so COUNT times again (=COUNT).

        Raises
        ------
        InputError : there is no such card, or it has continuations.
        """
        count = 1
        if name != "=":
            (count,) = parse_integers([_in_parentheses(name)], place, "=COUNT")
            words = self._changes
        last = self.cards[-1] if self.cards else Card("", place)
        if not words or len(last.words) > len(words) or not 0 < count <= MOST_MEMBERS:
            raise InputError(
                f"repeats {last.name or 'no card'} {count} times",
                place=place,
                expected="a line of = behind a card of one line, and =COUNT behind it",
            )
        self._changes = words
        for _ in range(count):
            last = Card(last.name, place, _changed_fields(last, words, place))
            self.cards.append(last)

    def finish(self) -> list[Card]:
        """Return the cards with all continuations.

        Raises
        ------
        InputError : a continuation belongs to no card, or to several.
        """
        waiting = self._apart
        while waiting:
            left = []
            for line in waiting:
                mark, words, after, _, _ = line
                owners = [c for c in self.cards if mark and _matches(c.after, mark)]
                if len(owners) == 1:
                    _continue(owners[0], words, after)
                else:
                    left.append(line)
            if len(left) == len(waiting):
                *_, text, place = left[0]
                raise InputError(
                    f"continues no card, or several: {text[:30]!r}",
                    place=place,
                    expected="continuations right behind their card, or a mark that "
                    "one card has at its end",
                )
            waiting = left
        return self.cards


def _in_parentheses(word: str) -> str:
    """The number of a field of replication: =8, =(8), *1, *(0.5)."""
    return word[1:].strip().removeprefix("(").removesuffix(")")


def _changed_fields(card: Card, changes: list[str], place: str) -> list[str]:
    """Return the fields of a replicated card.

    = copies a field, == all that follow, and *STEP adds to it (blank is zero); others
    replace it. Decimal numbers are added exactly.
    """
    fields: list[str] = []
    for i, change in enumerate(changes):
        if change == "==":
            return fields + card.words[i:]
        if change[:1] != "*":
            fields.append(card.word(i) if change == "=" else change)
            continue
        own, step = (
            _EXPONENT.sub(r"\1E\2", word)
            for word in (card.word(i) or "0", _in_parentheses(change))
        )
        try:
            if not is_plain(own + step):
                raise ValueError
            text = str(Decimal(own) + Decimal(step))
            lacks_point = is_real(own + step) and is_label(text.lstrip("-"))
            fields.append(f"{text}." if lacks_point else text)
        except (ArithmeticError, ValueError):
            raise InputError(
                f"adds {step!r} to the field {own!r} of {card.name}",
                place=place,
                expected="numbers",
            ) from None
    return fields


def _matches(after: str, mark: str) -> bool:
    """Return whether marks are the same; the first character at the end is any."""
    return mark in (after.lstrip("+*"), after[1:])


def _continue(card: Card, words: list[str], after: str) -> None:
    card.words += words
    card.after = after


def _split_fields(text: str, place: str) -> tuple[str, list[str], str]:
    """Name, data fields (8, or 4 large ones) and the mark at the end."""
    if "," in text[:_MARK_START]:
        fields = [word.strip() for word in text.rstrip(" ,").split(",")]
        count = 4 if "*" in fields[0] else 8
        if len(fields) > count + 2:
            raise InputError(
                f"has {len(fields)} fields", place=place, expected=f"{count + 2}"
            )
    else:
        columns = _WIDE if "*" in text[:8] else _NARROW
        name, *words, after = map(str.strip, map(text.__getitem__, columns))
        return name.upper(), words, after.upper()
    words = fields[1 : count + 1]
    words += [""] * (count - len(words))
    after = fields[count + 1] if len(fields) > count + 1 else ""
    return fields[0].upper(), words, after.upper()


def parse_members(words: list[str], place: str) -> Iterator[int]:
    """Numbers and ranges `a THRU b`.

    Raises
    ------
    InputError : they are none.
    """
    for labels in parse_member_groups(words, place):
        yield from labels


def parse_member_groups(words: list[str], place: str) -> Iterator[Sequence[int]]:
    """Yield the members as tuples of one number, or ranges.

    Raises
    ------
    InputError : they are none.
    """
    given = [word.upper() for word in words if word]
    i = 0
    while i < len(given):
        if given[i + 1 : i + 2] == ["THRU"]:
            ends = parse_integers([given[i], *given[i + 2 : i + 3]], place)
            if len(ends) < 2 or not 0 <= ends[1] - ends[0] < MOST_MEMBERS:
                text = " ".join(given[i : i + 3])
                raise InputError(f"found {text!r}", place=place, expected="a THRU b")
            yield range(ends[0], ends[1] + 1)
            i += 3
            continue
        yield tuple(parse_integers([given[i]], place))
        i += 1
