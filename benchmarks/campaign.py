"""A run of the command line as a user starts it, and what is wrong with its end."""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import read_result
from sidtool.formats.sid_files import read_sid

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank"
FILES = ("slider_crank.toml", "rod_q4.SID_FEM")
SIMULATE = ("simulate", FILES[0], "--rtol", "1e-3", "-o", "r.h5", "-o", "r.csv")
COMMANDS: dict[str, tuple[str, ...]] = {
    "convert": ("convert", FILES[1], "-o", "rod.h5"),
    "simulate": SIMULATE,
    "study": ("study", FILES[0], "-o", "s", "--integrator", "radau9", "--rtol", "1e-3"),
}
#: Signals, and the status of a run that is ended by one.
SIGNALS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}


@dataclass
class Campaign:
    """The folder of all runs, what is right, and what went wrong."""

    root: Path
    say: Callable[[str], None]
    chance: random.Random = field(default_factory=lambda: random.Random(1))
    rows: list[list[str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        (self.root / "elsewhere").mkdir()

    @cached_property
    def cache(self) -> Path:
        """Kernels of an undisturbed run."""
        assert self.right
        return self.root / "cache"

    @cached_property
    def right(self) -> bytes:
        """The table of an undisturbed run."""
        first = self.folder()
        self.start(SIMULATE, first, self.root / "cache").communicate()
        return (first / "r.csv").read_bytes()

    def folder(self) -> Path:
        created = Path(tempfile.mkdtemp(dir=self.root))
        for name in FILES:
            shutil.copy(EXAMPLE / name, created / name)
        return created

    def start(
        self, command: Sequence[str], folder: Path, cache: Path, **more: object
    ) -> subprocess.Popen[str]:
        limit = more.pop("limit", None)
        surroundings = os.environ | {
            "NUMBA_CACHE_DIR": str(cache),
            "TMPDIR": str(self.root / "elsewhere"),
        }

        def prepare() -> None:
            if isinstance(limit, int):
                resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        return subprocess.Popen(
            [sys.executable, "-m", "sidtool", *command],
            cwd=folder,
            env=surroundings | {str(k): str(v) for k, v in more.items()},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=prepare,
            encoding="utf-8",
        )

    def run(
        self,
        command: Sequence[str],
        folder: Path,
        cache: Path,
        statuses: Sequence[int] = (0,),
        **more: object,
    ) -> list[str]:
        """A run to its end; what is wrong with it."""
        process = self.start(command, folder, cache, **more)
        errors = process.communicate()[1]
        return self.judge(folder, process, errors, statuses)

    def judge(
        self,
        folder: Path,
        process: subprocess.Popen[str],
        errors: str,
        statuses: Sequence[int],
    ) -> list[str]:
        found = []
        if process.returncode not in statuses:
            found.append(f"status {process.returncode}: {errors.strip()[-200:]}")
        if "Traceback" in errors:
            found.append("a traceback")
        if process.returncode != -signal.SIGKILL and list(folder.glob(".*.part")):
            found.append("a .part file stays")
        if process.returncode == 0 and "r.csv" in process.args:  # type: ignore[operator]
            found += [] if (folder / "r.csv").exists() else ["no r.csv"]
        return found + self.half_written(folder) + staying(process.pid)

    def half_written(self, folder: Path) -> list[str]:
        """What is there is whole, and right."""
        table, study = folder / "r.csv", folder / "s"
        found = []
        if table.exists() and table.read_bytes() != self.right:
            found.append("other numbers in r.csv")
        for name, read in (("r.h5", read_result), ("rod.h5", read_sid)):
            with suppress(FileNotFoundError):
                try:
                    if (folder / name).exists():
                        read(folder / name)
                except InputError as error:
                    found.append(f"{name}: {error}")
        if (study / "study.txt").exists() and not (study / "study.png").exists():
            found.append("half a study")
        return found

    def note(self, what: str, outcomes: Sequence[list[str]]) -> None:
        bad = "; ".join(text for outcome in outcomes for text in outcome)
        wrong = f"{sum(map(bool, outcomes))} {bad}".strip()
        self.rows.append([what, str(len(outcomes)), wrong])
        self.say(f"  {what}: {len(outcomes)}, wrong {wrong}")


def staying(session: int) -> list[str]:
    """Processes of a session whose first one has ended, a second later."""
    for _ in range(20):
        alive = [p for p in Path("/proc").glob("[0-9]*") if _belongs(p, session)]
        if not alive:
            return []
        time.sleep(0.05)
    return [f"{len(alive)} processes stay"]


def _belongs(process: Path, session: int) -> bool:
    try:
        fields = (
            (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        )
    except OSError:
        return False
    return fields[0] != "Z" and int(fields[3]) == session
