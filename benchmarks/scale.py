"""Time and memory from a geometry to a SID, by the number of degrees of freedom.

    python benchmarks/scale.py [--plane N] [--solid N] [--engine NAME ...]

Every case runs in a process of its own, so that its peak memory is its own. Below the
plane cases stands how time and memory grow: beside n log n, the least that nested
dissection needs for the factors of a plane mesh. CPU seconds say more than seconds
where other programs run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

MODES = 10


def plane_case(ndof: int) -> dict[str, Any]:
    """The piston rod by Q4 with about that many degrees of freedom."""
    rows = max(4, round((ndof / 2 / 15) ** 0.5))
    return _model({"type": "q4", "elements": [15 * rows, rows]}, plane=True)


def solid_case(ndof: int) -> dict[str, Any]:
    """A block of 4 x 1 x 1 by hex8 with about that many degrees of freedom."""
    side = max(3, round((ndof / 3 / 4) ** (1 / 3) - 0.75))
    elements = [4 * side, side, side]
    return _model({"type": "hex8", "elements": elements}, plane=False)


def _model(discretisation: dict[str, Any], *, plane: bool) -> dict[str, Any]:
    outline = [[[x, -h], [x, h]] for x, h in ((0.0, 0.03), (0.5, 0.0), (1.0, 0.03))]
    block = [
        [[[x, y, -0.125], [x, y, 0.125]] for y in (-0.125, 0.125)] for x in (0.0, 1.0)
    ]
    geometry: dict[str, Any] = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": block,
    }
    if plane:
        geometry = {
            "type": "nurbs",
            "degrees": [2, 1],
            "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1]],
            "control_points": outline,
            "thickness": 0.01,
        }
    at = 0.5 if plane else [0.5, 0.5]
    return {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": 2.1e11,
            "poissons_ratio": 0.3,
            "density": 7850.0,
        },
        "geometry": geometry,
        "discretisation": discretisation,
        "frame": {"type": "tangent", "marker": "foot", "clamp": "left"},
        "markers": {
            "foot": {"node": 1, "edge": "left", "at": at},
            "tip": {"node": 2, "edge": "right", "at": at},
        },
        "reduction": {"method": "modal", "modes": MODES},
    }


def run(data: dict[str, Any]) -> dict[str, Any]:
    """Convert one model in this process; seconds, peak memory and frequencies."""
    import numpy as np

    from sidtool.formats.model import ModelFile
    from sidtool.formats.toml.reading import validate_data
    from sidtool.pipeline.model_to_sid import sid_from_model

    stages: list[tuple[float, str]] = []
    start = time.perf_counter()
    sid = sid_from_model(
        validate_data(data, ModelFile),
        lambda text: stages.append((time.perf_counter() - start, text)),
    )
    seconds = time.perf_counter() - start
    processor = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    hertz = np.sqrt(np.diag(sid.Ke.m0)) / (2 * np.pi)
    return {
        "seconds": seconds,
        "processor_seconds": processor,
        "ndof": _ndof(stages),
        "gigabytes": peak,
        "stages": stages,
        "frequencies": hertz[:3].tolist(),
    }


def _ndof(stages: list[tuple[float, str]]) -> int:
    text = next(text for _, text in stages if text.startswith("reducing"))
    return int(text.split()[1])


def _begins(stages: list[list[Any]]) -> str:
    """When the stages began, by their first word; without the counts inside them."""
    first: dict[str, float] = {}
    for at, text in stages:
        first.setdefault(str(text).split()[0].rstrip(":"), float(at))
    return "; ".join(f"{word} {at:.1f}" for word, at in first.items())


def growth(found: list[dict[str, Any]]) -> str:
    """How the CPU time of some plane cases grows with their size n.

    The exponent is that of the least-squares line through log time over log n.
    """
    import numpy as np

    n = np.array([case["ndof"] for case in found], float)
    rows = []
    for name, key in (("CPU time", "processor_seconds"), ("memory", "gigabytes")):
        values = np.array([case[key] for case in found])
        share = values / (n * np.log(n))
        exponent = np.polyfit(np.log(n), np.log(values), 1)[0]
        relative = " ".join(f"{x:.2f}" for x in share / share[-1])
        rows.append(f"  {name}: exponent {exponent:.2f}; by n log n: {relative}")
    least = np.polyfit(np.log(n), np.log(n * np.log(n)), 1)[0]
    return "\n".join([f"  (n log n itself: exponent {least:.2f})", *rows])


def _in_own_process(data: dict[str, Any], engine: str) -> dict[str, Any]:
    environment = os.environ | {
        "SIDTOOL_FACTORS": engine,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
    }
    result = subprocess.run(
        [sys.executable, __file__, "--case", json.dumps(data)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        encoding="utf-8",
    )
    if result.returncode:
        return {"failed": result.stderr.strip().splitlines()[-1:]}
    return dict(json.loads(result.stdout.splitlines()[-1]))


def measured(name: str, data: dict[str, Any], engine: str) -> dict[str, Any] | None:
    """Run one case and print its line; None if it failed."""
    found = _in_own_process(data, engine)
    if "failed" in found:
        print(f"{name:>18} {engine:>8} {found['failed']}", flush=True)
        return None
    print(
        f"{name:>18} {engine:>8} {found['seconds']:8.1f} "
        f"{found['processor_seconds']:8.1f} {found['gigabytes']:6.2f}  "
        f"{_begins(found['stages'])}",
        flush=True,
    )
    return found


def main() -> None:
    """Print one line per case and engine, and how the plane cases grow."""
    parser = argparse.ArgumentParser(description=__doc__)
    sizes = [62_500, 125_000, 250_000, 500_000, 1_000_000]
    parser.add_argument("--plane", type=int, nargs="*", default=sizes)
    parser.add_argument("--solid", type=int, nargs="*", default=[20_000, 160_000])
    parser.add_argument("--engine", nargs="*", default=["superlu"])
    parser.add_argument("--case", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print(json.dumps(run(json.loads(options.case))))
        return
    print(
        f"{'case':>18} {'engine':>8} {'seconds':>8} {'CPU s':>8} {'GB':>6}  "
        "stages, begun after s"
    )
    for engine in options.engine:
        found = [measured(f"plane {n}", plane_case(n), engine) for n in options.plane]
        done = [case for case in found if case is not None]
        if len(done) > 2:
            print(growth(done))
        for n in options.solid:
            measured(f"hex8 {n}", solid_case(n), engine)


if __name__ == "__main__":
    main()
