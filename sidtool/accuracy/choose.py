"""The cheapest model and integration that keep a request, found by measurement.

Shape functions and terms may use `MODEL` of what is allowed, integration the rest up
to `ALL`; whatever is chosen has been run and compared with the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from .candidates import FLEXIBILITY, QUADRATIC, STIFFENING, Candidate, Choice
from .candidates import shape_functions as shapes_of
from .integration import Found, cheapest
from .reference import Reference
from .runs import Runs

#: Shares of what is allowed: for rigid bodies, with shape functions, with terms, with
#: integration.
RIGID, SHAPES, MODEL, ALL = 0.2, 0.4, 0.5, 0.95
#: Of differences that are told as errors.
SAFETY = 1.01
#: A term is left out where that alone costs at most this share.
TERM = 0.1
#: Shape functions that are tried one by one after the first that has to stay.
LATER = 6


@dataclass(frozen=True, eq=False)
class Measured:
    """What leaving one thing out of the finest model does: errors (n,)."""

    candidate: Candidate
    errors: Array


@dataclass(frozen=True, eq=False)
class Chosen:
    """A model and how it is integrated.

    measured : everything that could have been left out
    errors : (n,) of the chosen run, with the uncertainty of the reference
    """

    choice: Choice
    found: Found
    measured: tuple[Measured, ...]
    errors: Array


def choose(runs: Runs, reference: Reference, stiffened: dict[str, bool]) -> Chosen:
    """Leave out what can be, then integrate as loosely as possible.

    stiffened : bodies with geometric stiffening, and whether they can do without

    Raises
    ------
    InputError : no model and no integration keeps the request.
    """
    search = _Search(runs, reference)
    choice = search.rigid_bodies(reference.choice)
    choice = search.fewer_shapes(choice)
    choice = search.fewer_terms(choice, stiffened)
    found = cheapest(runs, reference, choice, ALL)
    if found is None:
        choice = reference.choice
        found = cheapest(runs, reference, choice, ALL)
    if found is None:
        raise InputError(
            "no integrator keeps what is asked for",
            place="accuracy.wanted",
            expected="a larger error",
        )
    errors = SAFETY * found.errors + reference.doubt
    return Chosen(choice, found, tuple(search.measured), errors)


class _Search:
    """Compares models at one tight tolerance."""

    def __init__(self, runs: Runs, reference: Reference) -> None:
        self.runs, self.reference = runs, reference
        self.measured: list[Measured] = []

    def use(self, choice: Choice) -> float:
        """The share of what is allowed that a model costs."""
        finest, setting = self.reference.choice, self.reference.setting
        return self.reference.use(self.runs.difference(finest, choice, setting))

    def alone(self, candidate: Candidate) -> float:
        """The share that leaving out this alone costs; kept in `measured`."""
        finest, setting = self.reference.choice, self.reference.setting
        less = finest.without(candidate)
        errors = self.runs.difference(finest, less, setting)
        self.measured.append(Measured(candidate, errors))
        return self.reference.use(errors)

    def rigid_bodies(self, choice: Choice) -> Choice:
        """Bodies that may be rigid, those first that cost least."""
        bodies = [Candidate(n, FLEXIBILITY) for n, kept in choice.kept if kept]
        return self._together(choice, bodies, RIGID, RIGID)

    def fewer_shapes(self, choice: Choice) -> Choice:
        """The shape functions of the other bodies, those first that cost least."""
        costs = {c: self.alone(c) for c in shapes_of(choice)}
        order = sorted((c for c in costs if costs[c] <= SHAPES), key=costs.__getitem__)
        sums = accumulate((costs[c] for c in order), initial=self.use(choice))
        guess = sum(total <= SHAPES for total in sums) - 1
        count = self._longest(choice, order, max(guess, 0))
        choice = choice.without(*order[:count])
        for candidate in order[count + 1 : count + 1 + LATER]:
            less = choice.without(candidate)
            choice = less if self.use(less) <= SHAPES else choice
        return choice

    def _longest(self, choice: Choice, order: list[Candidate], guess: int) -> int:
        """How many of the first can be left out together, from a guess on."""
        fits, fails = 0, len(order) + 1
        count = guess
        while fails - fits > 1:
            if not 0 < count < fails:
                count = (fits + fails) // 2
            if self.use(choice.without(*order[:count])) <= SHAPES:
                fits, count = count, count + 1
            else:
                fails, count = count, count - 1
            if not fits < count < fails:
                count = (fits + fails) // 2
        return fits

    def fewer_terms(self, choice: Choice, stiffened: dict[str, bool]) -> Choice:
        """Terms of the bodies that stay flexible."""
        flexible = [n for n, kept in choice.kept if kept]
        terms = [Candidate(n, STIFFENING) for n in flexible if stiffened.get(n)]
        choice = self._together(choice, terms, TERM, MODEL)
        bare = [n for n in flexible if n not in stiffened or n in choice.unstiffened]
        squares = [Candidate(n, QUADRATIC) for n in bare if n in choice.quadratic]
        return self._together(choice, squares, TERM, MODEL)

    def _together(
        self, choice: Choice, candidates: list[Candidate], single: float, whole: float
    ) -> Choice:
        """Without those that cost at most `single` alone and `whole` with the rest."""
        costs = {c: self.alone(c) for c in candidates}
        for candidate in sorted(costs, key=costs.__getitem__):
            if costs[candidate] > single:
                break
            less = choice.without(candidate)
            if self.use(less) <= whole:
                choice = less
        return choice
