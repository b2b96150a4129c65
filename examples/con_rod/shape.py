"""Writes patches.json: the outline of a connecting rod as nine NURBS patches.

Two eyes of four patches each around the bores, and a shank that lies on the patch of
either eye that looks at the other. Circles are exact: arcs of degree 2 with weights.
"""

import json
import math

LENGTH = 0.150  # m, from bore to bore
BIG = {"bore": 0.025, "outside": 0.036, "half_angle": math.radians(28.0)}
SMALL = {"bore": 0.011, "outside": 0.018, "half_angle": math.radians(42.0)}

Arc = tuple[list[list[float]], list[float]]
patches = {}


def arc(x: float, radius: float, begin: float, end: float) -> Arc:
    """Control points and weights of a circular arc about (x, 0)."""
    half, middle = (end - begin) / 2, (begin + end) / 2
    places = [(radius, begin), (radius / math.cos(half), middle), (radius, end)]
    points = [[x + r * math.cos(a), r * math.sin(a)] for r, a in places]
    return points, [1.0, math.cos(half), 1.0]


def patch(name: str, one: Arc, other: Arc) -> None:
    """A patch between two arcs: u from one to the other, v along them."""
    patches[name] = {
        "degrees": [1, 2],
        "knots": [[0, 0, 1, 1], [0, 0, 0, 1, 1, 1]],
        "control_points": [one[0], other[0]],
        "weights": [one[1], other[1]],
    }


def eye(
    name: str, x: float, facing: float, bore: float, outside: float, half_angle: float
) -> None:
    """Four patches around a bore; number 0 looks along the angle `facing`."""
    rest = (2 * math.pi - 2 * half_angle) / 3
    begin = facing - half_angle
    for number, angle in enumerate([2 * half_angle, rest, rest, rest]):
        one, other = (arc(x, r, begin, begin + angle) for r in (bore, outside))
        patch(f"{name}_{number}", one, other)
        begin += angle


eye("big", 0.0, 0.0, **BIG)
eye("small", LENGTH, math.pi, **SMALL)
a, b = BIG["half_angle"], SMALL["half_angle"]
left = arc(0.0, BIG["outside"], -a, a)
right = arc(LENGTH, SMALL["outside"], math.pi + b, math.pi - b)
patch("shank", left, right)
with open("patches.json", "w", encoding="utf-8") as file:
    json.dump({"format": "sidtool patches", "version": 1, "patches": patches}, file)
print(f"patches.json: {len(patches)} patches")
