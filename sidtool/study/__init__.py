"""Error against time and size over variants of a scene.

plan           values of the axes, points, outputs that are compared
run_study      conversions, base runs, references, all points
study_result   result of a study: tables, fronts, pictures
"""

from ..measurement.outputs import (
    RunRecord as RunRecord,
    is_hopeless as is_hopeless,
    timed_run as timed_run,
)
from ..measurement.points import (
    Point as Point,
    Reference as Reference,
    StoppedEarly as StoppedEarly,
    is_varying as is_varying,
    make_reference as make_reference,
    measure_setting as measure_setting,
    pareto_front as pareto_front,
    point_of as point_of,
    recommend_point as recommend_point,
)
from ..measurement.tasks import StudyInterrupted as StudyInterrupted
from ..measurement.variants import (
    Setting as Setting,
    default_settings as default_settings,
    parse_axes as parse_axes,
)
from .run_study import run_study as run_study
from .study_result import Study as Study
