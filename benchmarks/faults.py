"""Faults on purpose: killed runs, damaged caches, disks that are full.

Every run happens to the slider-crank in a folder of its own, as a user starts it. What
counts is that nothing is half-written, no process stays, no traceback is shown and the
numbers are those of an undisturbed run. `python -m benchmarks faults`.
"""

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
from pathlib import Path

from sidtool.formats.errors import InputError
from sidtool.formats.result import read_result
from sidtool.formats.sid_files import read_sid

from . import mutations
from .machine import describe_machine
from .report import Report, Table

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank"
FILES = ("slider_crank.toml", "rod_q4.SID_FEM")
SIMULATE = ("simulate", FILES[0], "--rtol", "1e-3", "-o", "r.h5", "--csv", "r.csv")
COMMANDS: dict[str, tuple[str, ...]] = {
    "convert": ("convert", FILES[1], "-o", "rod.h5"),
    "simulate": SIMULATE,
    "study": ("study", FILES[0], "-o", "s", "--integrator", "radau9", "--rtol", "1e-3"),
}
#: Signals, and the status of a run that is ended by one.
SIGNALS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
KILLS, COLD_KILLS, SIZES, TOGETHER = 100, 6, 20, 8
#: Kernels up to this many bytes are compiled quickly.
SMALL = 40_000


@dataclass
class Campaign:
    """The folder of all runs, what is right, and what went wrong."""

    root: Path
    say: Callable[[str], None]
    chance: random.Random = field(default_factory=lambda: random.Random(1))
    right: bytes = b""
    rows: list[list[str]] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def folder(self) -> Path:
        made = Path(tempfile.mkdtemp(dir=self.root))
        for name in FILES:
            shutil.copy(EXAMPLE / name, made / name)
        return made

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
        bad = [text for outcome in outcomes for text in outcome]
        self.rows.append([what, str(len(outcomes)), str(sum(map(bool, outcomes)))])
        self.wrong += [f"{what}: {text}" for text in bad]
        self.say(f"  {what}: {len(outcomes)}, wrong {sum(map(bool, outcomes))} {bad}")


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
        fields = (process / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return False
    return fields[0] != "Z" and int(fields[3]) == session


def kills(c: Campaign, cache: Path) -> None:
    """At random instants of warm runs; one in ten is followed by a whole run."""
    names = list(COMMANDS)
    seconds = {}
    for name in names:
        began = time.perf_counter()
        c.note(f"{name}, undisturbed", [c.run(COMMANDS[name], c.folder(), cache)])
        seconds[name] = time.perf_counter() - began
    outcomes: dict[str, list[list[str]]] = {}
    for k in range(KILLS):
        name, number = names[k % 3], list(SIGNALS)[k // 3 % 3]
        folder = c.folder()
        found = killed(
            c, name, number, c.chance.uniform(0, seconds[name]), cache, folder
        )
        if k % 10 == 0:
            found += c.run(COMMANDS[name], folder, cache)
        outcomes.setdefault(f"{name}, {number.name}", []).append(found)
    for what, of_these in sorted(outcomes.items()):
        c.note(what, of_these)


def killed(
    c: Campaign,
    name: str,
    number: signal.Signals,
    after: float,
    cache: Path,
    folder: Path,
) -> list[str]:
    """While Python starts a signal ends it as it always does: nothing has begun."""
    process = c.start(COMMANDS[name], folder, cache)
    with suppress(subprocess.TimeoutExpired):
        process.wait(after)
    process.send_signal(number)
    errors = process.communicate()[1]
    if process.returncode == -number and ", in main" not in errors:
        return c.judge(folder, process, "", [-number])
    return c.judge(folder, process, errors, [0, SIGNALS[number]])


def cold_kills(c: Campaign) -> None:
    """While kernels are compiled; the cache that is left gives the right numbers."""
    cache, outcomes = c.root / "killed", []
    for k in range(COLD_KILLS):
        number = list(SIGNALS)[k % 3]
        after = c.chance.uniform(3.0, 15.0)
        outcomes.append(killed(c, "simulate", number, after, cache, c.folder()))
    outcomes.append(c.run(SIMULATE, c.folder(), cache))
    c.note("killed while compiling, then a whole run", outcomes)


def damages(c: Campaign, cache: Path) -> None:
    """Each kind to a small kernel, then all kernels at once; all are whole after."""

    def garbled(content: bytes) -> bytes:
        return c.chance.randbytes(len(content))

    def one_bit(content: bytes) -> bytes:
        place = c.chance.randrange(len(content))
        return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]

    kinds: dict[str, Callable[[bytes], bytes]] = {
        "empty": lambda content: b"",
        "halved": lambda content: content[: len(content) // 2],
        "garbled": garbled,
        "one bit changed": one_bit,
    }
    outcomes = []
    for change in kinds.values():
        file = c.chance.choice([f for f in kernels(cache) if f.stat().st_size < SMALL])
        file.write_bytes(change(file.read_bytes()))
        outcomes += [c.run(SIMULATE, c.folder(), cache) for _ in range(2)]
    first, second = (f.read_bytes() for f in kernels(cache)[:2])
    kernels(cache)[0].write_bytes(second)
    outcomes.append(c.run(SIMULATE, c.folder(), cache))
    for file in kernels(cache):
        file.write_bytes(c.chance.choice(list(kinds.values()))(file.read_bytes()))
    outcomes += [c.run(SIMULATE, c.folder(), cache) for _ in range(2)]
    c.note("damaged kernels on disk", outcomes)


def kernels(cache: Path) -> list[Path]:
    return sorted(cache.rglob("*.kernel"))


def limits(c: Campaign, cache: Path) -> None:
    """Files cannot grow beyond a size: kernels, result and table alike."""
    outcomes = []
    for k in range(SIZES):
        small = min(kernels(cache), key=lambda file: file.stat().st_size)
        small.unlink()
        size = int(10.0 ** (6.0 * k / (SIZES - 1)))
        outcomes.append(c.run(SIMULATE, c.folder(), cache, (0, 1), limit=size))
        outcomes.append(c.run(SIMULATE, c.folder(), cache))
    c.note("limits on file sizes, each with a run after", outcomes)


def full_disks(c: Campaign, cache: Path) -> None:
    """A disk of a few sizes, if this user may mount one: what has no room moves."""
    outcomes = []
    for k in range(SIZES):
        folder = c.folder()
        disk = folder / "disk"
        disk.mkdir()
        size = 4096 * (1 + k * 5)
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
        try:
            mounted = subprocess.run(mount, capture_output=True).returncode == 0
        except FileNotFoundError:
            mounted = False
        if not mounted:
            c.say("  no full disks: nothing can be mounted here")
            return
        try:
            targets = ("-o", "disk/r.h5", "--csv", "disk/r.csv")
            found = c.run((*SIMULATE[:4], *targets), folder, cache, (0, 1))
            found += c.half_written(disk)
            if list(disk.glob(".*")):
                found.append("rests on the full disk")
            outcomes.append(found)
        finally:
            subprocess.run(["umount", str(disk)], check=True)
        shutil.rmtree(c.root / "elsewhere")
        (c.root / "elsewhere").mkdir()
    c.note("disks too small for all or some of the files", outcomes)


def mistakes(c: Campaign) -> None:
    """Mutations of each example file, see `mutations`."""
    for file in mutations.examples():
        root = Path(tempfile.mkdtemp(dir=c.root))
        chance = random.Random(file.name)
        c.note(f"mutations of {file.name}", mutations.outcomes(file, root, chance))


def out_of_reach(c: Campaign, cache: Path) -> None:
    one = [c.run(SIMULATE, c.folder(), Path("/dev/null/cache"))]
    c.note("a cache that cannot be made", one)
    jit = [c.run(SIMULATE, c.folder(), cache, NUMBA_DISABLE_JIT=1)]
    c.note("NUMBA_DISABLE_JIT=1", jit)


def together(c: Campaign) -> None:
    """Many first runs at once."""
    folders = [c.folder() for _ in range(TOGETHER)]
    started = [c.start(SIMULATE, folder, c.root / "shared") for folder in folders]
    errors = [process.communicate()[1] for process in started]
    ended = zip(folders, started, errors, strict=True)
    c.note("at once on an empty cache", [c.judge(f, p, e, [0]) for f, p, e in ended])


def run(folder: Path, name: str, say: Callable[[str], None]) -> Report:
    with tempfile.TemporaryDirectory() as made:
        c = Campaign(Path(made), say)
        (c.root / "elsewhere").mkdir()
        cache, first = c.root / "cache", c.folder()
        process = c.start(SIMULATE, first, cache)
        process.communicate()
        c.right = (first / "r.csv").read_bytes()
        kills(c, cache)
        damages(c, cache)
        limits(c, cache)
        full_disks(c, cache)
        out_of_reach(c, cache)
        cold_kills(c)
        together(c)
        mistakes(c)
    caption = "Runs of the slider-crank, and how many were wrong:"
    return Report(
        title="Faults on purpose",
        tables=[
            Table(caption, ["fault", "runs", "wrong"], c.rows),
        ],
        remarks=c.wrong or ["Nothing was half-written, stayed, or had other numbers."],
        machine=describe_machine(),
    )
