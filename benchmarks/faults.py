"""Faults on purpose: killed runs, damaged caches, disks that are full.

Every run happens to the slider-crank in a folder of its own, as a user starts it. What
counts is that nothing is half-written, no process stays, no traceback is shown and the
numbers are those of an undisturbed run. `python -m benchmarks faults`, or some pieces
by `python -m benchmarks.faults PIECE ...`, which leave the figures of the others as
they are.
"""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from . import mutations, odd_inputs
from .campaign import COMMANDS, EXAMPLE, FILES, SIGNALS, SIMULATE, Campaign
from .machine import describe_machine
from .report import Report, Table, load, save

KILLS, COLD_KILLS, SIZES, TOGETHER = 100, 6, 20, 8
#: Kernels up to this many bytes are compiled quickly.
SMALL = 40_000


def kills(c: Campaign) -> None:
    """At random instants of warm runs; one in ten is followed by a whole run."""
    names = list(COMMANDS)
    seconds = {}
    for name in names:
        began = time.perf_counter()
        c.note(f"{name}, undisturbed", [c.run(COMMANDS[name], c.folder(), c.cache)])
        seconds[name] = time.perf_counter() - began
    outcomes: dict[str, list[list[str]]] = {}
    for k in range(KILLS):
        name, number = names[k % 3], list(SIGNALS)[k // 3 % 3]
        folder = c.folder()
        found = killed(
            c, name, number, c.chance.uniform(0, seconds[name]), c.cache, folder
        )
        if k % 10 == 0:
            found += c.run(COMMANDS[name], folder, c.cache)
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


def damages(c: Campaign) -> None:
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
        file = c.chance.choice(
            [f for f in kernels(c.cache) if f.stat().st_size < SMALL]
        )
        file.write_bytes(change(file.read_bytes()))
        outcomes += [c.run(SIMULATE, c.folder(), c.cache) for _ in range(2)]
    first, second = (f.read_bytes() for f in kernels(c.cache)[:2])
    kernels(c.cache)[0].write_bytes(second)
    outcomes.append(c.run(SIMULATE, c.folder(), c.cache))
    for file in kernels(c.cache):
        file.write_bytes(c.chance.choice(list(kinds.values()))(file.read_bytes()))
    outcomes += [c.run(SIMULATE, c.folder(), c.cache) for _ in range(2)]
    c.note("damaged kernels on disk", outcomes)


def kernels(cache: Path) -> list[Path]:
    return sorted(cache.rglob("*.kernel"))


def limits(c: Campaign) -> None:
    """Files cannot grow beyond a size: kernels, result and table alike."""
    outcomes = []
    for k in range(SIZES):
        small = min(kernels(c.cache), key=lambda file: file.stat().st_size)
        small.unlink()
        size = int(10.0 ** (6.0 * k / (SIZES - 1)))
        outcomes.append(c.run(SIMULATE, c.folder(), c.cache, (0, 1), limit=size))
        outcomes.append(c.run(SIMULATE, c.folder(), c.cache))
    c.note("limits on file sizes, each with a run after", outcomes)


@contextmanager
def disk(place: Path, size: int) -> Iterator[bool]:
    """A disk of so many bytes, if this user may mount one."""
    place.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(mount, capture_output=True).returncode == 0
    except FileNotFoundError:
        mounted = False
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(place)], check=True)


def full_disks(c: Campaign) -> None:
    """A disk of a few sizes: what has no room moves."""
    outcomes = []
    for k in range(SIZES):
        folder = c.folder()
        with disk(folder / "disk", 4096 * (1 + k * 5)) as mounted:
            if not mounted:
                c.say("  no full disks: nothing can be mounted here")
                return
            targets = ("-o", "disk/r.h5", "-o", "disk/r.csv")
            result = c.run((*SIMULATE[:4], *targets), folder, c.cache, (0, 1))
            result += c.half_written(folder / "disk")
            if list((folder / "disk").glob(".*")):
                result.append("rests on the full disk")
            outcomes.append(result)
        shutil.rmtree(c.root / "elsewhere")
        (c.root / "elsewhere").mkdir()
    c.note("disks too small for all or some of the files", outcomes)


def read_only(c: Campaign) -> None:
    """A cache that cannot be written: whole, without a kernel, damaged, empty."""

    def without_one(retained: Path) -> None:
        kernels(retained)[0].unlink()

    def damaged(retained: Path) -> None:
        file = kernels(retained)[-1]
        file.write_bytes(file.read_bytes()[:-100])

    changes: dict[str, Callable[[Path], None]] = {
        "whole": lambda retained: None,
        "without a kernel": without_one,
        "damaged": damaged,
        "empty": shutil.rmtree,
    }
    for name, change in changes.items():
        place = c.root / "read_only"
        with disk(place, 1 << 28) as mounted:
            if not mounted:
                c.say("  no read-only caches: nothing can be mounted here")
                return
            shutil.copytree(c.cache, place / "cache")
            change(place / "cache")
            subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
            result = c.run(SIMULATE, c.folder(), place / "cache")
            c.note(f"a read-only cache, {name}", [result])


def mistakes(c: Campaign, file: Path) -> None:
    """Mutations of an example file; those that end wrongly are kept."""
    root = Path(tempfile.mkdtemp(prefix="mutations_"))
    found = mutations.outcomes(file, root, random.Random(file.name))
    c.note(f"mutations of {file.name}", found)
    if not any(found):
        shutil.rmtree(root)


def odd(c: Campaign) -> None:
    """Hostile and odd inputs, one by one."""
    found = [
        odd_inputs.outcome(what, c.folder(), EXAMPLE / FILES[1])
        for what in odd_inputs.INPUTS
    ]
    c.note("odd inputs: " + ", ".join(odd_inputs.INPUTS), found)


def out_of_reach(c: Campaign) -> None:
    one = [c.run(SIMULATE, c.folder(), Path("/dev/null/cache"))]
    c.note("a cache that cannot be made", one)
    jit = [c.run(SIMULATE, c.folder(), c.cache, NUMBA_DISABLE_JIT=1)]
    c.note("NUMBA_DISABLE_JIT=1", jit)


def together(c: Campaign) -> None:
    """Many first runs at once."""
    folders = [c.folder() for _ in range(TOGETHER)]
    started = [c.start(SIMULATE, folder, c.root / "shared") for folder in folders]
    errors = [process.communicate()[1] for process in started]
    ended = zip(folders, started, errors, strict=True)
    c.note("at once on an empty cache", [c.judge(f, p, e, [0]) for f, p, e in ended])


#: Name of a piece -> its runs.
PIECES: dict[str, Callable[[Campaign], None]] = {
    "kills": kills,
    "kills while compiling": cold_kills,
    "damaged caches": damages,
    "read-only caches": read_only,
    "caches out of reach": out_of_reach,
    "an empty cache": together,
    "limits": limits,
    "full disks": full_disks,
    "odd inputs": odd,
    **{file.name: partial(mistakes, file=file) for file in mutations.examples()},
}
HEADER = ("fault", "runs", "wrong")


def run(
    folder: Path,
    name: str,
    say: Callable[[str], None],
    pieces: Sequence[str] = tuple(PIECES),
) -> Report:
    """The figures of these pieces, and those that are there of the others."""
    last = load(folder, [name]).get(name)
    tables = {table.caption: table for table in last.tables} if last else {}
    with tempfile.TemporaryDirectory() as made:
        c = Campaign(Path(made), say)
        for piece in pieces:
            c.rows = []
            PIECES[piece](c)
            tables[piece] = Table(piece, HEADER, c.rows)
    known = [tables[piece] for piece in PIECES if piece in tables]
    wrong = [row for table in known for row in table.rows if row[2] != "0"]
    total = sum(int(row[1]) for table in known for row in table.rows)
    remark = f"{len(wrong)} of these kinds of faults ended wrongly."
    if not wrong:
        remark = (
            f"{total} runs: nothing was half-written, stayed, hung, showed a traceback "
            "or had other numbers."
        )
    return Report("Faults on purpose", known, [remark], machine=describe_machine())


if __name__ == "__main__":
    results = Path(__file__).parent / "results"
    save(results, "faults", run(results, "faults", print, sys.argv[1:] or [*PIECES]))
