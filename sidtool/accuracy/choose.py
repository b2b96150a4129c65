"""The cheapest model and integration that keep a request, found by measurement.

Shape functions and terms may use `MODEL` of what is allowed, integration the rest up
to `ALL`; whatever is chosen has been run and compared with the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import expanded, unit_of
from sidtool.formats.sid import Array

from .candidates import (
    FLEXIBILITY,
    QUADRATIC,
    SHAPES,
    SPACE,
    STIFFENING,
    Candidate,
    Choice,
    stiffened,
)
from .candidates import shape_functions as shapes_of
from .flat import IN_PLANE, in_plane, is_across
from .integration import Found, cheapest
from .reference import Reference
from .runs import Runs

#: Shares of what is allowed: for the plane, for rigid bodies, with groups of shape
#: functions, with single ones, with terms, with integration.
PLANE, RIGID, GROUPS, SHARE, MODEL, ALL = 0.05, 0.2, 0.25, 0.4, 0.5, 0.95
#: Shape functions of one body that are looked at one by one; of more, those of least
#: elastic energy are left out in groups first.
SINGLE = 10
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


def choose(runs: Runs, reference: Reference) -> Chosen:
    """Leave out what can be, then integrate as loosely as possible.

    Raises
    ------
    InputError : no model and no integration keeps the request.
    """
    search = _Search(runs, reference)
    runs.begin("plane")
    search.plane()
    runs.begin("rigid bodies")
    choice = search.rigid_bodies(search.base)
    runs.begin("shape functions")
    choice = search.fewer_shapes(choice)
    runs.begin("terms")
    choice = search.fewer_terms(choice)
    runs.begin("integration")
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
    errors = estimated(found.errors, reference)
    return Chosen(choice, found, tuple(search.measured), errors)


def estimated(errors: Array, reference: Reference) -> Array:
    """What is told as errors, (n,), of differences to the reference."""
    return SAFETY * errors + reference.doubt


class _Search:
    """Compares models at one tight tolerance.

    base : everything, in the plane if that does
    """

    def __init__(self, runs: Runs, reference: Reference) -> None:
        self.runs, self.reference = runs, reference
        self.base = reference.choice
        self.measured: list[Measured] = []

    def plane(self) -> None:
        """A spatial scene of which nothing leaves the plane is planar from here on."""
        scene, candidate = self.runs.scene, Candidate("", SPACE)
        if scene.dimension == "planar" or in_plane(scene) is None or self._leaves():
            return
        if self.alone(candidate) <= PLANE:
            self.base = self.base.without(candidate)

    def _leaves(self) -> bool:
        """Whether an output across the plane, which is zero there, may not be."""
        result, names = self.reference.result, self.runs.names
        scene, sids = self.runs.scene, self.runs.sids
        recorded = expanded(scene.outputs.record, scene, sids, "outputs.record")
        if any(map(is_across, set(recorded) - set(names))):
            return True
        columns = self.runs.columns(self.reference.choice, result)
        sizes = dict(zip(names, np.abs(columns).max(axis=0), strict=True))
        kinds: dict[str, float] = {}
        for name, size in sizes.items():
            unit = unit_of(name, scene)
            kinds[unit] = max(kinds.get(unit, 0.0), size)
        return any(
            size > IN_PLANE * kinds[unit_of(name, scene)]
            for name, size in sizes.items()
            if is_across(name) and name not in self.reference.left_out
        )

    def use(self, choice: Choice) -> float:
        """The share of what is allowed that a model costs."""
        finest, setting = self.reference.choice, self.reference.setting
        return self.reference.use(self.runs.difference(finest, choice, setting))

    def alone(self, candidate: Candidate, of: Choice | None = None) -> float:
        """The share that leaving out this alone costs; kept in `measured`.

        of : the model that it is left out of, default the finest one
        """
        whole = of or self.base
        less = whole.without(candidate)
        errors = self._missing(whole, less)
        if self.reference.use(errors) <= MODEL:
            errors = self.runs.difference(whole, less, self.reference.setting)
        self.measured.append(Measured(candidate, errors))
        return self.reference.use(errors)

    def _missing(self, whole: Choice, less: Choice) -> Array:
        """The errors (n,) of outputs that a model does not have, which are zero there:
        known without a run."""
        names, result = (
            self.runs.names,
            self.runs.attempt(whole, self.reference.setting),
        )
        if result is None or all(map(less.knows, names)):
            return np.zeros(len(names))
        sizes = np.abs(self.runs.columns(whole, result)).max(axis=0)
        return np.where([*map(less.knows, names)], 0.0, sizes)

    def rigid_bodies(self, choice: Choice) -> Choice:
        """Bodies that may be rigid, those first that cost least."""
        bodies = [Candidate(n, FLEXIBILITY) for n, kept in choice.kept if kept]
        return self._together(choice, bodies, RIGID, RIGID)

    def fewer_shapes(self, choice: Choice) -> Choice:
        """The shape functions of the other bodies, those first that cost least."""
        whole, choice = choice, self._without_groups(choice)
        base = None if choice == whole else choice
        costs = {c: self.alone(c, base) for c in shapes_of(choice)}
        order = sorted((c for c in costs if costs[c] <= SHARE), key=costs.__getitem__)
        sums = accumulate((costs[c] for c in order), initial=self.use(choice))
        guess = sum(total <= SHARE for total in sums) - 1
        count = self._longest(choice, order, max(guess, 0))
        choice = choice.without(*order[:count])
        for candidate in order[count + 1 : count + 1 + LATER]:
            less = choice.without(candidate)
            choice = less if self.use(less) <= SHARE else choice
        return choice

    def _without_groups(self, choice: Choice) -> Choice:
        """Bodies of many shape functions without those that hardly deform them."""
        for name, kept in choice.kept:
            waiting = self._by_energy(name, kept)
            count = len(waiting) // 2
            while len(waiting) > SINGLE and count > 1:
                numbers = tuple(sorted(waiting[:count]))
                group = Candidate(name, SHAPES, numbers=numbers)
                less = choice.without(group)
                if self.use(less) > GROUPS:
                    count //= 2
                    continue
                self.alone(group, choice)
                choice, waiting = less, waiting[count:]
                count = len(waiting) // 2
        return choice

    def _by_energy(self, name: str, kept: tuple[int, ...]) -> list[int]:
        """Shape functions by their share in the elastic energy, least first."""
        shares = self.reference.result.bodies[name].energy_shares if kept else ()
        order = sorted(zip(shares, kept, strict=True)) if len(kept) > SINGLE else []
        return [number for _, number in order]

    def _longest(self, choice: Choice, order: list[Candidate], guess: int) -> int:
        """How many of the first can be left out together, from a guess on."""
        fits, fails = 0, len(order) + 1
        count = guess
        while fails - fits > 1:
            if not 0 < count < fails:
                count = (fits + fails) // 2
            if self.use(choice.without(*order[:count])) <= SHARE:
                fits, count = count, count + 1
            else:
                fails, count = count, count - 1
            if not fits < count < fails:
                count = (fits + fails) // 2
        return fits

    def fewer_terms(self, choice: Choice) -> Choice:
        """Terms of the bodies that stay flexible."""
        flexible = [n for n, kept in choice.kept if kept]
        terms_of = stiffened(self.runs.scene, self.runs.sids, choice.flat)
        terms = [Candidate(n, STIFFENING) for n in flexible if terms_of.get(n)]
        choice = self._together(choice, terms, TERM, MODEL)
        bare = [n for n in flexible if n not in terms_of or n in choice.unstiffened]
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
