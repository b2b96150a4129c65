"""Films: all bodies are in every picture, and MP4 is what players play."""

from __future__ import annotations

import io
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from PIL import Image

import sidtool
from sidtool.plot.figure import COLOURS
from sidtool.view import film
from sidtool.view.animation import animation_data

FRAMES = 21


def bodies(places: dict[str, list[float]], spin: list[float]) -> sidtool.Result:
    """Cubes, a tenth as large as the mechanism, that turn where they are."""
    length = max(0.1, *np.ptp(np.array(list(places.values())), axis=0))
    inertia = 2.0 * (length / 10) ** 2 / 6
    return sidtool.Scene(
        dimension="spatial",
        gravity=[0.0, 0.0, 0.0],
        time=sidtool.Time(end=1.0, output_step=1.0 / (FRAMES - 1)),
        bodies={
            name: sidtool.RigidBody(
                mass=2.0,
                inertia=3 * [inertia],
                initial=sidtool.Initial(position=place, angular_velocity=spin),
            )
            for name, place in places.items()
        },
        outputs=sidtool.Outputs(record=[f"{name}.x" for name in places]),
    ).simulate()


def pixels_of_bodies(picture: np.ndarray) -> list[np.ndarray]:
    """Pixels in the hues of the first two bodies, whatever their shade."""
    hsv = rgb_to_hsv(picture)
    return [_in_hue(hsv, number) for number in (0, 1)]


def _in_hue(hsv: np.ndarray, number: int) -> np.ndarray:
    hue = rgb_to_hsv(np.array(to_rgb(COLOURS[number])))[0]
    return (hsv[..., 1] > 0.5) & (np.abs(hsv[..., 0] - hue) < 0.02)


#: Pixels around all that is drawn.
EDGE = 10


@pytest.mark.parametrize(
    "ends",
    [
        ([0.0, 0.0, 0.0], [3.0, 0.0, 0.0]),
        ([-5.0, 2.0, 1.0], [-5.0, 2.5, 1.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, -0.3]),
        ([1.0, 1.0, 1.0], [2.0, 0.2, 2.4]),
    ],
    ids=str,
)
def test_no_body_leaves_the_picture(ends: tuple[list[float], list[float]]) -> None:
    """Two cubes at the ends of the mechanism are shown whole: the axes are a square in
    the middle of the page, and cut what was beyond."""
    result = bodies(dict(zip(("one", "two"), ends, strict=True)), [1.0, 0.5, 0.2])
    motion = animation_data(result)
    rows = [0, len(motion.motion.t) - 1]
    for data in film.snapshots(motion.motion, motion.bodies, rows, 1.0):
        picture = np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float) / 255
        cubes = pixels_of_bodies(picture)
        areas = [cube.sum() for cube in cubes]
        assert min(areas) > 60
        assert max(areas) < 2.2 * min(areas)  # equal cubes, turned alike: none is cut
        drawn = cubes[0] | cubes[1]
        rows_, columns = np.nonzero(drawn)
        height, width = drawn.shape
        for inside, size in ((rows_, height), (columns, width)):
            assert inside.min() >= EDGE and inside.max() < size - EDGE
        spread = max(np.ptp(rows_) / height, np.ptp(columns) / width)
        assert spread > 0.6  # and the window is not far too large


def probed(path: Path) -> dict[str, Any]:
    requested = "stream=codec_name,width,height,pix_fmt,nb_read_frames,duration"
    words = f"ffprobe -v error -count_frames -show_entries {requested} -of json".split()
    process = subprocess.run([*words, str(path)], capture_output=True, check=True)
    (stream,) = json.loads(process.stdout)["streams"]
    return dict(stream)


@pytest.mark.needs("ffmpeg")
def test_mp4(tmp_path: Path) -> None:
    """Frames, length and format by ffprobe; a turning point is where it should be."""
    places = {"one": [0.0, 0.0, 0.0], "two": [1.0, 0.0, 0.0]}
    scene = bodies(places, [0.0, 0.0, 0.0]).file_data()
    # the second one moves away by its own length of the mechanism
    result = scene.with_({"bodies.two.initial.velocity": [1.0, 0.0, 0.0]}).simulate()
    notes = result.animate(tmp_path / "m.mp4")
    assert not any("ffmpeg" in sentence for sentence in notes)
    stream = probed(tmp_path / "m.mp4")
    assert stream["codec_name"] == "h264" and stream["pix_fmt"] == "yuv420p"
    assert (stream["width"], stream["height"]) == (640, 440)
    assert int(stream["nb_read_frames"]) == FRAMES
    assert float(stream["duration"]) == pytest.approx(FRAMES / 20)
    words = ["ffmpeg", "-v", "error", "-i", "m.mp4", "f%02d.png"]
    subprocess.run(words, cwd=tmp_path, check=True)
    distances = []
    for name in ("f01.png", f"f{(FRAMES + 1) // 2:02d}.png", f"f{FRAMES}.png"):
        picture = np.asarray(Image.open(tmp_path / name).convert("RGB"), float) / 255
        middles = [np.argwhere(cube).mean(axis=0) for cube in pixels_of_bodies(picture)]
        distances.append(np.linalg.norm(middles[1] - middles[0]))
    shares = np.array(distances) / distances[0]
    np.testing.assert_allclose(shares, [1.0, 1.5, 2.0], rtol=0.05)


def test_without_ffmpeg_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    result = bodies({"one": [0.0, 0.0, 0.0]}, [1.0, 0.0, 0.0])
    with pytest.raises(sidtool.InputError, match="ffmpeg is not installed"):
        result.animate(tmp_path / "m.mp4")
    assert not list(tmp_path.iterdir())
