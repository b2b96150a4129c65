"""Example files with mistakes in them: each ends with a message or with a result.

A child of this process runs the command line on each mutated file, with all modules
imported, so that thousands take minutes.
"""

from __future__ import annotations

import os
import random
import re
import resource
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"
#: Of each example file.
MUTATIONS = 1000
#: Seconds of processor time and bytes that a run may take; a simulation may be as long
#: as a file says, and is ended after fewer.
LONGEST, MEMORY, PATIENCE = 60, 3 << 30, 10
NUMBER = re.compile(rb"(?<![A-Za-z_\d.])[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
ODD = (
    b"0 -1 1 2 7 1e20 -1e20 1e308 1e-308 1e400 nan inf -inf 0x7fffffffffffffff "
    b"99999999999999999999999999 1e3 1e-3 0.1 true [] {} '' [1] -0.0 1e15 1e7"
).split()
BYTES = (b"\0", b"\x1b[31m", b"\xff", b"\xef\xbb\xbf", b"\r", b'"', b"[", b"]", b"=")


def mutated(content: bytes, chance: random.Random) -> bytes:
    """One to three mistakes."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        content = chance.choice(KINDS)(content, chance)
    return content


def _span(content: bytes, chance: random.Random) -> tuple[int, int]:
    first = chance.randrange(len(content) + 1)
    return first, min(len(content), first + chance.choice((1, 3, 20, 300)))


def _bit(content: bytes, chance: random.Random) -> bytes:
    if not content:
        return content
    k = chance.randrange(len(content))
    changed = content[k] ^ 1 << chance.randrange(8)
    return content[:k] + bytes([changed]) + content[k + 1 :]


def _without(content: bytes, chance: random.Random) -> bytes:
    first, last = _span(content, chance)
    return content[:first] + content[last:]


def _twice(content: bytes, chance: random.Random) -> bytes:
    first, last = _span(content, chance)
    return content[:last] + content[first:]


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def _inserted(content: bytes, chance: random.Random) -> bytes:
    k = chance.randrange(len(content) + 1)
    return content[:k] + chance.choice(BYTES) + content[k:]


def _number(content: bytes, chance: random.Random) -> bytes:
    found = list(NUMBER.finditer(content))
    if not found:
        return content
    match = chance.choice(found)
    return content[: match.start()] + chance.choice(ODD) + content[match.end() :]


def _lines(change: Callable[[list[bytes], int, int], None]) -> Callable[..., bytes]:
    def changed(content: bytes, chance: random.Random) -> bytes:
        lines = content.split(b"\n")
        change(lines, chance.randrange(len(lines)), chance.randrange(len(lines)))
        return b"\n".join(lines)

    return changed


def _swap(lines: list[bytes], i: int, k: int) -> None:
    lines[i], lines[k] = lines[k], lines[i]


KINDS: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _bit,
    _without,
    _twice,
    _cut,
    _inserted,
    _number,
    _number,
    _number,
    _lines(_swap),
    _lines(lambda lines, i, k: lines.insert(k, lines[i])),
    _lines(lambda lines, i, k: lines.__delitem__(i)),
)


def commands(file: Path, content: bytes) -> list[tuple[str, ...]]:
    """What a user does with such a file; the first one is cheap."""
    name, info = file.name, ("info", file.name)
    if file.suffix != ".toml":
        return [info, ("validate", name), ("convert", name, "-o", "made.h5")]
    if b"sidtool scene" in content:
        tables = ("-o", "made.csv", "-o", "made.h5", "--rtol", "1e-2")
        return [info, ("simulate", name, *tables)]
    return [info, ("convert", name, "-o", "made.h5")]


def examples() -> list[Path]:
    return sorted([*EXAMPLES.glob("*/*.toml"), *EXAMPLES.glob("*/*.SID_FEM")])


def outcomes(file: Path, root: Path, chance: random.Random) -> list[list[str]]:
    """What is wrong with the end of each run; the cheap command for nine of ten."""
    content, found = file.read_bytes(), []
    import_all()
    for k in range(MUTATIONS):
        folder = Path(tempfile.mkdtemp(dir=root))
        for other in file.parent.glob("*.SID_FEM"):
            shutil.copy(other, folder)
        (folder / file.name).write_bytes(mutated(content, chance))
        kinds = commands(file, content)
        command = kinds[0] if k % 10 else kinds[1 + k // 10 % (len(kinds) - 1)]
        wrong = run_command(command, folder)
        if wrong:
            stored = shutil.copy(folder / file.name, root / f"{k}-{file.name}")
            wrong = [f"{' '.join(command)} ({stored}): {text}" for text in wrong]
        found.append(wrong)
        shutil.rmtree(folder)
    return found


def import_all() -> None:
    from sidtool import solver, validate  # noqa: F401
    from sidtool.report import result  # noqa: F401


def run_command(command: tuple[str, ...], folder: Path) -> list[str]:
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _child(command, folder)
    _, status, used = os.wait4(child, 0)
    printed = b"".join((folder / n).read_bytes() for n in (".out", ".err"))
    wrong = []
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        if number == 24 and command[0] == "simulate":
            return []  # SIGXCPU: the file asks for a long run
        wrong.append(f"signal {number} after {time.monotonic() - began:.0f} s")
    elif os.WEXITSTATUS(status) not in (0, 1, 2):
        wrong.append(f"status {os.WEXITSTATUS(status)}")
    if b"Traceback" in printed:
        wrong.append(printed.decode(errors="replace")[-400:])
    if b"\x1b" in printed or b"\0" in printed:
        wrong.append("control characters reach the terminal")
    if os.WIFEXITED(status) and list(folder.glob(".*.part")):
        wrong.append("a .part file stays")
    seconds = used.ru_utime + used.ru_stime
    if command[0] != "simulate" and seconds > PATIENCE:
        wrong.append(f"{seconds:.0f} s")
    return wrong


def _child(command: tuple[str, ...], folder: Path) -> None:
    status = 99
    try:
        os.chdir(folder)
        limit = PATIENCE if command[0] == "simulate" else LONGEST
        # at the second limit the kernel sends SIGKILL instead of SIGXCPU
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        for number, name in ((1, ".out"), (2, ".err")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), number)
        from sidtool.cli.main import run

        status = run(command)
    except BaseException:
        traceback.print_exc()
    finally:
        import sys

        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
