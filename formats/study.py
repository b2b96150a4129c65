"""Study files (JSON): cost and error of each variant of a scene."""

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from .file_names import check_ending
from .scene.base import Table
from .storage.atomic import atomic_path
from .toml.reading import load


class StudyPoint(Table):
    """One setting; `step` [s] replaces the error control by `rtol`."""

    integrator: str
    rtol: float | None = None
    step: float | None = None
    error: float | None = Field(
        default=None, description="relative, of the worst output; none if it failed"
    )
    seconds: float | None = None
    steps: int
    message: str = Field(default="", description="why it failed")
    told: bool = Field(
        default=True, description="false: less than the reference's own error"
    )
    choices: dict[str, str] = Field(
        default_factory=dict, description="model, mesh, modes, ... as far as they vary"
    )
    size: int = Field(default=0, description="elastic coordinates of all bodies")
    dofs: int = Field(default=0, description="degrees of freedom of the meshes")
    conversion: float = Field(default=0.0, description="of the models [s]")
    errors: dict[str, float] = Field(
        default_factory=dict, description="relative, of single outputs"
    )
    diagnostics: tuple[dict[str, Any], ...] = Field(
        default=(), description="errors and warnings of the run, as in JSON of a run"
    )


class StudyFile(Table):
    """All settings that were tried on a scene."""

    format: Literal["sidtool study"] = "sidtool study"
    version: Literal[1] = 1
    title: str = ""
    outputs: tuple[str, ...] = Field(description="that were compared")
    uncertainty: float = Field(description="of the reference, relative")
    reference: str = Field(default="", description="what it is a run of")
    varied: tuple[str, ...] = Field(
        default=("integrator",), description="axes with several values"
    )
    diagnostics: tuple[dict[str, Any], ...] = Field(
        default=(), description="of the study and its reference, as in JSON of a run"
    )
    points: tuple[StudyPoint, ...]


def read_study(path: str | Path) -> StudyFile:
    """Read a study.

    Raises
    ------
    InputError : the file cannot be read or is no study.
    """
    return load(path, StudyFile)


def write_study(path: str | Path, content: StudyFile) -> None:
    """Write a study, wholly or not at all.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """
    check_ending(path, "study")
    with atomic_path(path) as temporary:
        temporary.write_text(content.model_dump_json(indent=1) + "\n", encoding="utf-8")
