"""Writes moving.svg, the picture that moves in README.md: python docs/moving.py

One revolution of the founding example at 6 revolutions a second, slowed to 3 s. The rod
is drawn from its full field, deformations are magnified.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sidtool import simulate
from sidtool.formats.scene import Time, read_scene
from sidtool.pipeline.model_to_sid import field_from_model

HERE = Path(__file__).resolve().parent
EXAMPLE = HERE.parent / "examples" / "slider_crank"
FRAMES, SECONDS, MAGNIFIED = 48, 3, 150
WIDTH, HEIGHT, SCALE, LEFT, AXIS = 760, 250, 520, 95, 120
#: Points of the outline: every so many of the mesh.
COARSE = 6


def main() -> None:
    """Simulate, draw, write."""
    sid, field = field_from_model(EXAMPLE / "rod_q4.toml")
    scene = read_scene(EXAMPLE / "slider_crank.toml")
    times = tuple(3.0 - (1.0 - np.arange(FRAMES + 1) / FRAMES) / 6.0)
    scene = scene.model_copy(update={"time": Time(end=3.0, output_times=times)})
    result = simulate(scene, sids={"rod": sid}, base_folder=EXAMPLE)
    q = np.asarray(result["rod.q*"])
    pins = np.column_stack([result["crank.pin.x"], result["crank.pin.y"]])
    pistons = np.asarray(result["piston.x"])
    rows = _outline(field.positions)
    points = field.positions[rows]
    tip = int(np.argmin(np.abs(field.positions - [1.0, 0.0, 0.0]).sum(axis=1)))
    shapes = []
    for frame in range(len(times)):
        # Both pins stay where they are: what is magnified is bending from their line.
        moved = field.displacement(q[frame])
        bent = points + MAGNIFIED * (moved[rows] - points[:, :1] * moved[tip])
        c, s = np.array([pistons[frame], 0.0]) - pins[frame]
        shapes.append(pins[frame] + bent[:, :2] @ np.array([[c, s], [-s, c]]))
    (HERE / "moving.svg").write_text(
        _picture(shapes, pins, pistons, q[:, 0]), encoding="utf-8"
    )


def _outline(positions: np.ndarray) -> np.ndarray:
    """Rows of the lower edge from left to right, then the upper one back."""
    stations = np.unique(np.round(positions[:, 0], 9))
    chosen = stations[::COARSE][:-1].tolist() + [stations[-1]]
    lower, upper = [], []
    for x in chosen:
        rows = np.flatnonzero(np.abs(positions[:, 0] - x) < 1e-8)
        order = rows[np.argsort(positions[rows, 1])]
        lower.append(order[0])
        upper.append(order[-1])
    return np.array(lower + upper[::-1])


def _place(point: np.ndarray) -> str:
    return f"{LEFT + SCALE * point[0]:.1f},{AXIS - SCALE * point[1]:.1f}"


def _animate(name: str, values: list[str]) -> str:
    return (
        f'<animate attributeName="{name}" dur="{SECONDS}s" repeatCount="indefinite" '
        f'values="{";".join(values)}"/>'
    )


def _picture(
    shapes: list[np.ndarray], pins: np.ndarray, pistons: np.ndarray, q1: np.ndarray
) -> str:
    rods = [" ".join(map(_place, shape)) for shape in shapes]
    x = [f"{LEFT + SCALE * pin[0]:.1f}" for pin in pins]
    y = [f"{AXIS - SCALE * pin[1]:.1f}" for pin in pins]
    slides = [f"{LEFT + SCALE * value - 22:.1f}" for value in pistons]
    across = np.linspace(LEFT - 50, WIDTH - 30, len(q1))
    up = HEIGHT - 26 - 18 * q1 / np.abs(q1).max()
    curve = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
    dots = [f"{a:.1f}" for a in across], [f"{b:.1f}" for b in up]
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}">
<title>A crank turns a piston through a flexible rod; its bending is magnified</title>
<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>
<path d="M20 {AXIS + 26}H{WIDTH - 20}" stroke="#999999"/>
<circle cx="{LEFT}" cy="{AXIS}" r="{SCALE / 10:.0f}" fill="none" stroke="#dddddd"/>
<polygon fill="#4c8cc8" stroke="#1f4e79" points="{rods[0]}">{_animate("points", rods)}
</polygon>
<line x1="{LEFT}" y1="{AXIS}" x2="{x[0]}" y2="{y[0]}" stroke="#333333" stroke-width="9"
 stroke-linecap="round">{_animate("x2", x)}{_animate("y2", y)}</line>
<circle cx="{LEFT}" cy="{AXIS}" r="6" fill="#ffffff" stroke="#333333" stroke-width="2"/>
<rect x="{slides[0]}" y="{AXIS - 24}" width="44" height="48" rx="4" fill="#d98032"
 fill-opacity="0.8" stroke="#333333">{_animate("x", slides)}</rect>
<polyline fill="none" stroke="#4c8cc8" stroke-width="1.5" points="{curve}"/>
<circle r="4" fill="#d98032">{_animate("cx", dots[0])}
{_animate("cy", dots[1])}</circle>
<text x="20" y="20" font-family="sans-serif" font-size="13" fill="#333333">rod of the
 founding example, 6 revolutions a second, bending {MAGNIFIED} times as large; below:
 its first elastic coordinate</text>
</svg>
"""


if __name__ == "__main__":
    main()
