"""Plan of a study: values of its axes, its points, the outputs that it compares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.model.refine import refine_model, requested_modes
from sidtool.formats.scene import SceneFile, is_elastic, is_stress, parse_output
from sidtool.solver.system.sid_terms import has_quadratic_inertia
from sidtool.solver.system.stiffening import can_remove_stiffening

from ..measurement.variants import (
    AXES,
    FEW_SETTINGS,
    FRAMES,
    METHODS,
    TERMS,
    BodyVariants,
    Setting,
    Values,
    Variant,
    default_settings,
    setting_of,
    variant_grid,
    with_choice,
)

#: Default of the largest number of points of a study.
MAX_POINTS = 300


@dataclass(frozen=True)
class StudyPlan:
    """The points of a study.

    values : values of each varied axis
    base : the unchanged scene
    points : variants and settings, ordered by their number of changes
    differ : largest number of choices in which they differ from the scene
    whole : number of points of the full grid
    """

    bodies: BodyVariants
    values: Values
    base: Variant
    settings: tuple[Setting, ...]
    points: tuple[tuple[Variant, Setting], ...]
    differ: int
    whole: int

    @property
    def varied(self) -> tuple[str, ...]:
        """Return the axes with several values, including the models."""
        models = ("model",) if self.bodies.models > 1 else ()
        return models + tuple(n for n in AXES if len(self.values.get(n, ())) > 1)

    def labels(self, variant: Variant) -> dict[str, str]:
        """Return the labels of a variant in tables."""
        label_of = {"model": self.bodies.title(variant.model)}
        for name in self.varied:
            if name not in ("model", "integrator"):
                value = getattr(variant, name)
                label_of[name] = "own" if value is None else str(value)
        return {name: label_of[name] for name in self.varied if name in label_of}

    def finest_variants(self) -> list[Variant]:
        """Return the finest variants of each model, those with all terms first."""
        variants = [replace(self.base, model=k) for k in range(self.bodies.models)]
        for name in ("mesh", "modes"):
            known = [v for v in self.values.get(name, ()) if v is not None]
            if known:
                variants = [with_choice(v, name, max(known)) for v in variants]
        for name in ("reduction", "terms"):
            choices = self.values.get(name, (getattr(self.base, name),))
            order = [c for c in TERMS if c in choices] if name == "terms" else choices
            variants = [
                with_choice(v, name, c) for c in order or choices for v in variants
            ]
        return variants


def make_plan(
    bodies: BodyVariants,
    requested: Values,
    settings: Sequence[Setting] | None,
    differ: int | None,
) -> StudyPlan:
    """Return the values of all axes, with defaults, and the points.

    Raises
    ------
    InputError : an axis does not fit the scene.
    """
    if not requested and bodies.models == 1:
        requested = {"integrator": ()}
    values: dict[str, tuple[Any, ...]] = {}
    base = Variant()
    for name in AXES:
        if name in requested and name != "integrator":
            own, default = _AXES[name](bodies)
            values[name] = requested[name] or default
            base = with_choice(base, name, own if own in values[name] else None)
            if getattr(base, name) is None and None not in values[name]:
                base = with_choice(base, name, values[name][0])
    chosen = _integration_settings(bodies.scene, requested, settings)
    if "integrator" in requested or len(chosen) > 1:
        values["integrator"] = tuple(chosen)
    points = variant_grid(bodies.models, values, base, chosen)
    most = points[-1][2] if differ is None else differ
    if differ is None:
        while most > 1 and sum(away <= most for *_, away in points) > MAX_POINTS:
            most -= 1
    return StudyPlan(
        bodies,
        values,
        base,
        tuple(chosen),
        tuple((v, s) for v, s, away in points if away <= most),
        most,
        len(points),
    )


def _integration_settings(
    scene: SceneFile, requested: Values, settings: Sequence[Setting] | None
) -> list[Setting]:
    """Return the given settings, those of the axis, or that of the scene."""
    if settings is not None:
        return list(settings)
    if "integrator" not in requested:
        return [setting_of(scene)]
    names = requested["integrator"]
    if set(requested) == {"integrator"}:
        return default_settings(names)
    return default_settings(names or FEW_SETTINGS[0], FEW_SETTINGS[1])


def _mesh_values(bodies: BodyVariants) -> tuple[Any, tuple[Any, ...]]:
    if not bodies.sources:
        raise InputError(
            "no body of the scene is given by a model",
            place="--over mesh",
            expected='`model = "rod.toml"` of a body in the scene, or --model '
            "BODY=MODEL.toml",
        )
    models = [
        source.model
        for models_of_body in bodies.sources.values()
        for source in models_of_body
    ]
    levels = [
        k for k in (-1, 0, 1) if all(refine_model(m, k) is not None for m in models)
    ]
    if len(levels) == 1:
        raise InputError(
            "the meshes of the models are as they are",
            place="--over mesh",
            expected="models with elements of their own, of which each can be halved",
        )
    return 0, tuple(levels)


def _mode_values(bodies: BodyVariants) -> tuple[Any, tuple[Any, ...]]:
    counts = [bodies.sids[n].nq for n in bodies.scene.flexible if n in bodies.sids]
    counts += [requested_modes(f[0].model) or 0 for f in bodies.sources.values()]
    if not counts:
        raise InputError(
            "the scene has no flexible body", place="--over modes", expected="one"
        )
    most = max(counts)
    few = (max(1, most // 2), most, 2 * most) if most else (0, 2, 4)
    if not bodies.sources:
        few = (max(1, most // 4), max(1, most // 2), most)
    own = most if len(set(counts)) == 1 else None
    return own, tuple(dict.fromkeys(few if own is not None else (*few, None)))


def _reduction_values(bodies: BodyVariants) -> tuple[Any, tuple[Any, ...]]:
    methods = {s.model.reduction.method for f in bodies.sources.values() for s in f}
    if not methods:
        raise InputError(
            "no body of the scene is given by a model, and a SID is reduced already",
            place="--over reduction",
            expected="--model BODY=MODEL.toml",
        )
    own = methods.pop() if len(methods) == 1 else None
    return own, METHODS if own in METHODS else (None, *METHODS)


def _frame_values(bodies: BodyVariants) -> tuple[Any, tuple[Any, ...]]:
    kinds = {s.model.frame.type for f in bodies.sources.values() for s in f}
    own = kinds.pop() if len(kinds) == 1 and not bodies.sids else None
    return own, FRAMES if own else (None, *FRAMES)


def _term_values(bodies: BodyVariants) -> tuple[Any, tuple[Any, ...]]:
    """Return the terms that can be varied; some SIDs do not define a body without
    stiffening.
    """
    scene, sids = bodies.scene, bodies.sids
    planar = scene.dimension == "planar"
    known = [
        b.geometric_stiffening and has_stiffening(sids[n])
        for n, b in scene.sid_bodies.items()
        if n in sids
    ]
    models = [f[0].model.stiffening is not None for f in bodies.sources.values()]
    stiffened = any(known) or any(models)
    quadratic = any(
        has_quadratic_inertia(b, sids[n], planar)
        for n, b in scene.sid_bodies.items()
        if n in sids
    )
    own = {(True, True): "all", (True, False): "stiffening", (False, True): "quadratic"}
    if not bodies.sources and not any(known):
        return own.get((stiffened, quadratic), "none"), ("quadratic", "none")
    if not all(can_remove_stiffening(sid, planar) for sid in sids.values()):
        return own.get((stiffened, quadratic), "none"), ("all", "stiffening")
    return own.get((stiffened, quadratic), "none"), TERMS


_AXES = {
    "mesh": _mesh_values,
    "modes": _mode_values,
    "reduction": _reduction_values,
    "frame": _frame_values,
    "terms": _term_values,
}


def comparable_outputs(
    names: Sequence[str], scene: SceneFile, varied: Sequence[str], named: bool
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Separate outputs that are comparable in all variants from the others.

    Elastic coordinates belong to shape functions; the position of the body frame, and
    quantities relative to it, to the frame. Elastic coordinates that are `named` count
    if only mesh and number of modes vary.
    """
    shapes = (
        {"reduction", "frame"} if named else {"model", "mesh", "reduction", "frame"}
    )
    comparable_names: list[str] = []
    others: list[str] = []
    for name in names:
        parsed = parse_output(name)
        body = parsed.owner in scene.flexible
        elastic = body and not parsed.marker and is_elastic(parsed.quantity)
        if elastic:
            bad = bool(shapes & set(varied))
        elif body and "frame" in varied and not is_stress(parsed.quantity):
            bad = not parsed.marker or parsed.quantity in ("ux", "uy", "uz")
        else:
            bad = False
        (others if bad else comparable_names).append(name)
    return tuple(comparable_names), tuple(others)
