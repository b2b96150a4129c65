"""Variants of a study: axes such as `--over mesh,modes=2:4:8`, integration settings.

Variants of bodies have other meshes, modes, reductions, frames or terms.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import integer_of_text
from sidtool.formats.base.sid import SID
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.model import ModelFile
from sidtool.formats.model.reduction import (
    AttachmentReduction,
    BuckensFrame,
    ChordFrame,
    CraigBamptonReduction,
    HertingReduction,
    KrylovReduction,
    ModalReduction,
    Stiffening,
    TangentFrame,
)
from sidtool.formats.model.refine import refine_model, requested_modes, with_modes
from sidtool.formats.scene import (
    SceneFile,
    SidBody,
    as_3d,
    is_elastic,
    is_section_force,
    is_stress,
    orientation_matrix,
    parse_output,
)

from ..pipeline.model_cache import BodyModel

#: Axes of a study, in the order of tables.
AXES = ("mesh", "modes", "reduction", "frame", "terms", "integrator")
#: Description of the values of each axis, for messages.
MEANINGS = {
    "mesh": "halvings of the elements, such as mesh=-1:0:1",
    "modes": "numbers of modes, or of shape functions of a SID, such as modes=2:4:8",
    "reduction": "methods, such as reduction=modal:craig_bampton",
    "frame": "frames, out of frame=tangent:chord:buckens",
    "terms": "terms, out of terms=all:stiffening:quadratic:none",
    "integrator": "integrators, such as integrator=radau5:radau9",
}
METHODS = ("modal", "craig_bampton", "attachment", "herting", "krylov")
FRAMES = ("tangent", "chord", "buckens")
TERMS = ("all", "stiffening", "quadratic", "none")
_WORDS = {"reduction": METHODS, "frame": FRAMES, "terms": TERMS}
#: Separator of the values of an axis.
VALUE_SEPARATOR = ":"

Values = Mapping[str, tuple[Any, ...]]
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
#: Integrators and tolerances if other axes vary, too.
FEW_SETTINGS = ("radau5", "radau9"), (1e-3, 1e-5, 1e-7)
#: Integrators and tolerances of the two references, at the tightest.
TIGHTEST_SETTINGS = (("radau13", 1e-12), ("radau9", 1e-11))
#: Tolerances of the references relative to the tightest one of a study.
FACTOR_OF_TIGHT_SETTINGS = (1e-3, 1e-2)


@dataclass(frozen=True)
class Variant:
    """A variant of a scene; None stands for the content of the files.

    Attributes
    ----------
    model : index of the model files of the bodies
    mesh : number of halvings of the element size
    modes : number of modes of each body
    """

    model: int = 0
    mesh: int = 0
    modes: int | None = None
    reduction: str | None = None
    frame: str | None = None
    terms: str | None = None


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Parse axes and their values from `--over`; no values stand for the defaults.

    Raises
    ------
    InputError : there is no such axis or value.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        name, equals, values = part.partition("=")
        if name not in AXES:
            raise InputError(
                f"found {name!r}", place="--over", expected=", ".join(AXES)
            )
        listed = [v.strip() for v in values.split(VALUE_SEPARATOR)] if equals else []
        axes[name] = tuple(dict.fromkeys(_parse_value(name, v) for v in listed))
    return {name: axes[name] for name in AXES if name in axes}


def _parse_value(axis: str, text: str) -> Any:
    if axis in _WORDS:
        if text in _WORDS[axis]:
            return text
    elif axis == "integrator":
        return text
    else:
        least, most = (-4, 4) if axis == "mesh" else (0, 1000)
        try:
            number = integer_of_text(text)
        except ValueError:
            number = most + 1
        if least <= number <= most:
            return number
    raise InputError(f"found {text!r}", place=f"--over {axis}", expected=MEANINGS[axis])


def variant_grid(
    models: int, values: Values, base: Variant, settings: Sequence[Setting]
) -> list[tuple[Variant, Setting, int]]:
    """Return all combinations, with the number of choices in which each differs from
    the base. Integrator and tolerance are one choice, and so is the model. Combinations
    with the fewest changes come first.
    """
    variants = [(base, 0)]
    names = [name for name in AXES if name in values and name != "integrator"]
    axes = {"model": tuple(range(models))} | {name: values[name] for name in names}
    for name, choices in axes.items():
        own = getattr(base, name)
        variants = [
            (with_choice(variant, name, choice), away + (choice != own))
            for variant, away in variants
            for choice in choices
        ]
    points = [
        (variant, setting, away + (setting != settings[0]))
        for variant, away in variants
        for setting in settings
    ]
    return sorted(points, key=lambda point: point[2])


def with_choice(variant: Variant, name: str, choice: Any) -> Variant:
    """Return the variant with another choice on an axis."""
    return replace(variant, **{name: choice})


@dataclass(frozen=True)
class Setting:
    """Integration of one run; a `step` [s] replaces the error control by `rtol`, which
    is then of Newton's iteration alone.
    """

    integrator: str
    rtol: float | None = None
    step: float | None = None

    @property
    def value(self) -> str:
        parts = [] if self.step is None else [f"{self.step:g} s"]
        return ", ".join(parts + ([] if self.rtol is None else [f"{self.rtol:.0e}"]))

    @property
    def key(self) -> str:
        """Return the keys of the table `[accuracy]` for this setting."""
        numbers = {"step": self.step, "rtol": self.rtol}
        given = [f"{key} = {value:g}" for key, value in numbers.items() if value]
        return ", ".join([f'integrator = "{self.integrator}"', *given])


def setting_of(scene: SceneFile) -> Setting:
    """Return the setting in the table [accuracy] of a scene."""
    accuracy = scene.accuracy
    if accuracy.step is not None:
        return Setting(accuracy.integrator, step=accuracy.step)
    return Setting(accuracy.integrator, accuracy.rtol)


def default_settings(
    integrators: Sequence[str] = (),
    tolerances: Sequence[float] = (),
    steps: Sequence[float] = (),
) -> list[Setting]:
    """Return every integrator with every tolerance and fixed step; "auto" on request.

    Raises
    ------
    InputError : an integrator is not known.
    """
    from sidtool.solver.integrators.registry import AUTO, INTEGRATORS

    known = (AUTO, *INTEGRATORS)
    for name in integrators:
        if name not in known:
            raise InputError(
                f"there is no integrator {name!r}",
                expected=f"one of {', '.join(known)}",
            )
    chosen = integrators or tuple(INTEGRATORS)
    if not tolerances and not steps:
        tolerances = TOLERANCES
    return [Setting(name, rtol=rtol) for name in chosen for rtol in tolerances] + [
        Setting(name, step=step) for name in chosen for step in steps
    ]


def tight_settings(settings: Sequence[Setting]) -> tuple[Setting, Setting]:
    """Return two settings with different methods, much tighter than those of a
    study.
    """
    least = min((s.rtol for s in settings if s.rtol is not None), default=0.0)
    first, second = (
        Setting(name, max(limit, part * least))
        for (name, limit), part in zip(
            TIGHTEST_SETTINGS, FACTOR_OF_TIGHT_SETTINGS, strict=True
        )
    )
    return first, second


#: Tolerance for the position of the origin, relative to the size of the body.
ORIGIN_TOLERANCE = 1e-9
_INTERFACES: dict[str, Any] = {
    "craig_bampton": CraigBamptonReduction,
    "attachment": AttachmentReduction,
    "herting": HertingReduction,
}


@dataclass(frozen=True)
class BodyVariants:
    """The flexible bodies of a scene.

    sids : SIDs of bodies without a model, and of the unchanged models
    sources : models by body, the same number for each
    """

    scene: SceneFile
    sids: Mapping[str, SID]
    sources: Mapping[str, Sequence[BodyModel]]

    @property
    def models(self) -> int:
        """Return the number of models per body."""
        return max(
            (len(models_of_body) for models_of_body in self.sources.values()), default=1
        )

    def title(self, number: int) -> str:
        """Return the name of the models of a number."""
        names = (models[number].path.stem for models in self.sources.values())
        return ", ".join(dict.fromkeys(names))

    def to_convert(self, variant: Variant) -> dict[str, ModelFile]:
        """Return the models of a variant that must be converted.

        Raises
        ------
        InputError : a model cannot be varied in this way.
        """
        return {
            name: make_variant(models[variant.model].model, variant, self.scene, name)
            for name, models in self.sources.items()
        }

    def as_scene(
        self, variant: Variant, converted: Mapping[str, SID]
    ) -> tuple[SceneFile, dict[str, SID]]:
        """Return the scene of a variant and its SIDs.

        Raises
        ------
        InputError : the scene does not allow the variant.
        """
        bodies, sids = dict(self.scene.bodies), dict(self.sids) | dict(converted)
        for name, body in self.scene.sid_bodies.items():
            own = name not in converted
            if variant.frame and own:
                frame = _frame_in_words(variant.frame, name, body)
                sids[name] = _sid_in_frame(sids[name], frame, body, name)
                body = body.model_copy(update={"damping": None})
            elif variant.frame and not own:
                model = self.sources[name][variant.model].model
                if variant.frame != model.frame.type:
                    sids[name] = _damped_in_frame_of(model, sids[name], body, name)
                    body = body.model_copy(update={"damping": None})
            rigid = variant.modes == 0 and not self._deforms(variant, name, sids[name])
            changed = _body_of_variant(name, body, variant, sids[name], own, rigid)
            if variant.terms:
                stiffened = own or self._is_prestressed(variant, name)
                changed = _with_terms(changed, variant.terms, sids[name], stiffened)
            bodies[name] = changed
            if variant.frame or variant.model:
                shift = _origin_shift(self.sids[name], sids[name])
                bodies[name] = _shift_initial_position(
                    name, changed, shift, self.scene.dimension
                )
        return self.scene.model_copy(update={"bodies": bodies}), sids

    def _is_prestressed(self, variant: Variant, name: str) -> bool:
        """Check whether the model stiffens its body whatever the terms of the
        variant.
        """
        stiffening = self.sources[name][variant.model].model.stiffening
        return stiffening is not None and bool(stiffening.prestress)

    def _deforms(self, variant: Variant, name: str, sid: SID) -> bool:
        """Check whether shape functions remain if no modes are requested.

        Those of interfaces remain; a SID, and a model that has only modes, retain none.
        """
        if name not in self.sources:
            return False
        own = self.sources[name][variant.model].model.reduction.method
        return sid.nq > 0 and (variant.reduction or own) != "modal"


def make_variant(
    model: ModelFile, variant: Variant, scene: SceneFile, name: str
) -> ModelFile:
    """Return the model with the mesh, shape functions, frame and terms of a variant."""
    refined = refine_model(model, variant.mesh)
    if refined is None:
        raise InputError(
            f"the mesh of {model.title or name} cannot be refined",
            place="--over mesh",
            expected="a model with elements of its own, of which each can be halved",
        )
    markers = _used_markers(refined, scene.sid_bodies[name])
    if variant.frame and variant.frame != refined.frame.type:
        frame = _frame_settings(
            variant.frame, _origin_marker_first(refined, markers), name
        )
        reduction = _without_clamps(refined)
        refined = refined.model_copy(update={"frame": frame, "reduction": reduction})
    if variant.reduction and variant.reduction != refined.reduction.method:
        reduction = _other_reduction(refined, variant.reduction, markers)
        refined = refined.model_copy(update={"reduction": reduction})
    if variant.modes is not None and requested_modes(refined) is not None:
        least = 1 if refined.reduction.method == "modal" else 0
        refined = with_modes(refined, max(least, variant.modes)) or refined
    if variant.terms is None or (refined.stiffening and refined.stiffening.prestress):
        return refined
    wanted = variant.terms in ("all", "stiffening")
    stiffening = (refined.stiffening or Stiffening()) if wanted else None
    return refined.model_copy(update={"stiffening": stiffening})


def _used_markers(model: ModelFile, body: SidBody) -> list[str]:
    """Return the markers of a model that a scene uses, in the order of the scene."""
    nodes = {str(marker.node): name for name, marker in model.markers.items()}
    return [nodes[node] for node in body.markers.values() if node in nodes] or list(
        model.markers
    )


def _without_clamps(model: ModelFile) -> Any:
    """Return the reduction for a frame that clamps nothing: clamped markers become
    interfaces. The shape functions are the same except for rigid motions.
    """
    own, held = model.reduction, model.frame.marker_names[:1]
    if not own.interface_names or model.frame.type != "tangent":
        return own
    interfaces = dict.fromkeys((*held, *own.interface_names))
    return own.model_copy(update={"interfaces": tuple(interfaces)})


def _origin_marker_first(model: ModelFile, markers: list[str]) -> list[str]:
    """Return the markers, that of the frame first, so that the frame does not move."""
    own = list(model.frame.marker_names[:1])
    return own + [name for name in markers if name not in own]


def _frame_settings(kind: str, markers: Sequence[str], name: str) -> Any:
    if kind == "tangent":
        return TangentFrame(marker=markers[0])
    if kind == "buckens":
        return BuckensFrame(marker=markers[0])
    if len(markers) < 2:
        raise _too_few_markers(name)
    return ChordFrame(markers=(markers[0], markers[1]))


def _frame_in_words(kind: str, name: str, body: SidBody) -> str:
    """Return the frame as `change_frame` takes it."""
    nodes = list(dict.fromkeys(body.markers.values()))
    if len(nodes) < (2 if kind == "chord" else 1):
        raise _too_few_markers(name)
    return f"{kind}:{','.join(nodes[: 2 if kind == 'chord' else 1])}"


def _too_few_markers(name: str) -> InputError:
    return InputError(
        f"{name} has not enough markers in the scene",
        place="--over frame",
        expected="two markers for a chord, one for another frame",
    )


def _sid_in_frame(sid: SID, frame: str, body: SidBody, name: str) -> SID:
    """Return the SID in another frame, with the damping of the scene in its
    own frame.
    """
    from sidtool.solver.system.body_data import sid_with_damping

    from ..conversion.frame_change import change_frame

    return change_frame(sid_with_damping(sid, body.damping, name), frame)


def _damped_in_frame_of(model: ModelFile, sid: SID, body: SidBody, name: str) -> SID:
    """Return the SID of a model in another frame, with the damping of the original
    frame. Damping laws depend on mass matrices or natural modes, which differ between
    frames. The damping matrix does not: it belongs to the elastic coordinates, which
    are the same in every frame.
    """
    from sidtool.solver.system.body_data import sid_with_damping

    from ..conversion.frame_change import change_frame

    law = body.damping
    if law is None or law.type == "sid":
        law = model.damping
    if law is None:
        return sid
    nodes = (str(model.markers[marker].node) for marker in model.frame.marker_names)
    original = change_frame(sid, f"{model.frame.type}:{','.join(nodes)}")
    return replace(sid, De=sid_with_damping(original, law, name).De)


def _other_reduction(model: ModelFile, method: str, markers: Sequence[str]) -> Any:
    """Return another reduction method with the same number of modes, and interfaces at
    the used markers.
    """
    own = model.reduction
    count = requested_modes(model) or 1
    if method == "modal":
        return ModalReduction(modes=max(1, count), fix=own.fix)
    held = model.frame.marker_names[:1] if model.frame.type == "tangent" else ()
    interfaces = own.interface_names or tuple(m for m in markers if m not in held)
    interfaces = interfaces or tuple(markers)
    if method == "krylov":
        loads = len(interfaces) * (3 if _is_planar(model) else 6)
        moments = max(1, round(count / loads))
        return KrylovReduction(
            interfaces=interfaces, frequencies=(0.0,), moments=moments, fix=own.fix
        )
    return _INTERFACES[method](interfaces=interfaces, modes=count, fix=own.fix)


def _is_planar(model: ModelFile) -> bool:
    return model.discretisation.type in ("q4", "iga")


def _body_of_variant(
    name: str, body: SidBody, variant: Variant, sid: SID, own: bool, rigid: bool
) -> SidBody:
    """Return a body of a scene; its SID is `own` if it has no model."""
    changes: dict[str, Any] = {"sid": body.sid or f"({name})", "model": None}
    others = variant.reduction or variant.frame or not own
    if others and body.initial.elastic is not None:
        raise InputError(
            "belongs to the shape functions of the scene",
            place=f"bodies.{name}.initial.elastic",
            expected="a start without it where these are varied",
        )
    if rigid:
        changes["rigid"] = True
    elif variant.modes is not None and own:
        numbers = body.numbers(sid.nq)[: variant.modes]
        whole = len(numbers) == sid.nq
        changes["shape_functions"] = None if whole else numbers
    return body.model_copy(update=changes)


def _with_terms(body: SidBody, terms: str, sid: SID, stiffened: bool) -> SidBody:
    """Return the body with the requested terms of its SID.

    Parameters
    ----------
    stiffened : False for a SID that was converted without geometric stiffening, from
        which nothing needs to be removed
    """
    removes_stiffening = (
        terms not in ("all", "stiffening") and stiffened and has_stiffening(sid)
    )
    quadratic = terms in ("all", "quadratic")
    changes = {
        "quadratic_inertia": quadratic,
        "geometric_stiffening": not removes_stiffening,
    }
    return body.model_copy(update=changes)


def _shift_initial_position(
    name: str, body: SidBody, shift: np.ndarray, dimension: str
) -> SidBody:
    """Shift the initial position of a body whose frame has another origin."""
    if not shift.any():
        return body
    start = body.initial
    if start.angular_velocity is not None or body.frame == "held":
        raise InputError(
            "starts in a frame whose origin moves",
            place=f"bodies.{name}",
            expected="a body without `angular_velocity` at its start, not held",
        )
    position = as_3d(start.position) + orientation_matrix(start) @ shift
    count = 2 if dimension == "planar" else 3
    changes = {"position": tuple(position[:count].tolist())}
    return body.model_copy(update={"initial": start.model_copy(update=changes)})


def _origin_shift(before: SID, after: SID) -> np.ndarray:
    """Return the vector from the old to the new origin, from a common node."""
    known = {node.id: node for node in after.nodes}
    places = np.array([node.position for node in before.nodes])
    size = np.abs(places).max(initial=0.0)
    for node in before.nodes:
        if node.id in known:
            shift = np.asarray(node.position - known[node.id].position)
            return (
                shift if np.abs(shift).max() > ORIGIN_TOLERANCE * size else np.zeros(3)
            )
    return np.zeros(3)


def with_absolute_paths(model: ModelFile) -> ModelFile:
    """Return the model with absolute paths of its files, for another process."""
    for place in ModelFile.paths:
        model = _with_absolute_path(model, place)
    return model


def _with_absolute_path(table: Any, place: tuple[str, ...]) -> Any:
    """Return a table with an absolute path at a place, if there is a path."""
    key, *inner = place
    value = getattr(table, key, None)
    if inner:
        changed = _with_absolute_path(value, tuple(inner))
    else:
        changed = os.path.abspath(value) if isinstance(value, str) else value
    if changed is value:
        return table
    return table.model_copy(update={key: changed})


def available_outputs(
    names: Sequence[str], scene: SceneFile, sids: Mapping[str, SID]
) -> tuple[str, ...]:
    """Return the outputs without elastic coordinates that a variant does not have."""
    numbers = {n: b.numbers(sids[n].nq) for n, b in scene.sid_bodies.items()}

    def has(name: str) -> bool:
        parsed = parse_output(name)
        retained = numbers.get(parsed.owner)
        if retained is None:
            return True
        if is_stress(parsed.quantity) or is_section_force(parsed):
            return bool(retained)
        if parsed.marker or not is_elastic(parsed.quantity):
            return True
        number = parsed.quantity.lstrip("vq")
        return bool(retained) if number == "*" else int(number) in retained

    return tuple(filter(has, names))


def elastic_size(scene: SceneFile, sids: Mapping[str, SID]) -> int:
    """Return the number of elastic coordinates of a scene."""
    return sum(len(b.numbers(sids[n].nq)) for n, b in scene.sid_bodies.items())
