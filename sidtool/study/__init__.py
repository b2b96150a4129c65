"""Error against time and size over variants of a scene.

plan           values of the axes, points, outputs that are compared
run_study      conversions, base runs, references, all points
study_result   result of a study: tables, fronts, pictures
"""

from ..measurement.outputs import RunRecord, is_hopeless, timed_run
from ..measurement.points import (
    Point,
    Reference,
    StoppedEarly,
    is_varying,
    make_reference,
    measure_setting,
    pareto_front,
    point_of,
    recommend_point,
)
from ..measurement.tasks import StudyInterrupted
from ..measurement.variants import Setting, default_settings, parse_axes
from .run_study import run_study
from .study_result import Study

__all__ = [
    "RunRecord",
    "StudyInterrupted",
    "Point",
    "Reference",
    "Setting",
    "StoppedEarly",
    "Study",
    "default_settings",
    "pareto_front",
    "is_hopeless",
    "make_reference",
    "measure_setting",
    "is_varying",
    "parse_axes",
    "point_of",
    "recommend_point",
    "run_study",
    "timed_run",
]
