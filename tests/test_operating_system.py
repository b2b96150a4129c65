"""Differences between operating systems are in one module, and text is UTF-8."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.places import ROOT

PRODUCT = ("sidtool", "formats", "solver")
MODULE = ROOT / "formats" / "storage" / "operating_system.py"
#: Modules that other systems lack, or that act otherwise there.
MODULES = {"signal", "resource", "fcntl", "pwd", "grp", "termios", "msvcrt", "winreg"}
MODULES |= {"_winapi", "nt", "posix", "pty", "select", "syslog", "tty", "winsound"}
#: The same of functions, by where they are called from.
FUNCTIONS = {
    "sys": {"platform", "getwindowsversion", "getfilesystemencoding"},
    "ctypes": {"WinDLL", "windll", "wintypes", "OleDLL", "oledll", "util"},
    "locale": {"setlocale", "getpreferredencoding", "getencoding", "getlocale"},
    "time": {"tzset", "clock_gettime"},
    "socket": {"AF_UNIX"},
    "Path": {"home"},
}
#: All of these modules that acts alike on all systems and may be used.
PORTABLE = {
    "os": {"PathLike", "fspath", "fsdecode", "fsencode", "path", "scandir", "getcwd"}
    | {"environ", "getpid", "_exit", "devnull", "open", "fdopen", "write", "dup2"}
    | {"fstat", "O_RDWR", "O_WRONLY", "SEEK_SET"},
    "tempfile": {"gettempdir", "mkdtemp", "TemporaryDirectory"},
    "shutil": {"copyfile", "copyfileobj", "rmtree", "which"},
    "platform": {"machine", "python_implementation", "python_version"},
    "multiprocessing": {"active_children", "get_context"},
}
#: Methods of paths; `replace` and `rename` of paths take one argument.
METHODS = {"chmod", "lchmod", "expanduser", "symlink_to", "hardlink_to", "touch"}
METHODS |= {"owner", "readlink"}
#: Arguments of subprocesses: the shell of a system, and what others refuse.
ARGUMENTS = {"shell", "preexec_fn", "start_new_session", "process_group", "umask"}
ARGUMENTS |= {"creationflags", "startupinfo", "pass_fds", "executable"}
#: Beginnings of paths, and variables that name folders, of one system.
TEXTS = ("/dev/", "/proc/", "XDG_", "LOCALAPPDATA", "APPDATA", "USERPROFILE")
TEXTS += ("/tmp", "/etc/", "/sys/", "/usr/", "/bin/", "TMPDIR", "USERNAME", "\\\\?\\")

#: What Python has on POSIX only, or what ends the process at once on Windows.
LACKING = {f"os.{name}" for name in ("kill", "mkfifo", "fork", "getuid", "geteuid")}
LACKING |= {"os.fsdecode", "os.fsencode"}  # fail for names that are no UTF-8
LACKING |= {"signal.SIGHUP", "signal.SIGKILL", "signal.SIGALRM", "os.uname"}


def sources(*tops: str) -> list[Path]:
    return [path for top in tops for path in sorted((ROOT / top).rglob("*.py"))]


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def parsed_sources(words: Iterable[str], *tops: str) -> Iterator[tuple[str, ast.AST]]:
    """Sources that contain one of some words, by their path in the repository."""
    contains = re.compile("|".join(map(re.escape, words))).search
    for path in sources(*tops):
        if contains(path.read_text(encoding="utf-8")):
            yield str(path.relative_to(ROOT)), parsed(path)


def called(node: ast.Call) -> str:
    function = node.func
    if isinstance(function, ast.Name):
        return function.id
    return (
        function.attr if isinstance(function, ast.Attribute) else ast.unparse(function)
    )


def docstrings(tree: ast.AST) -> set[int]:
    return {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }


def differs(module: str, name: str) -> bool:
    """Whether a name of a module is forbidden, or not known to be portable."""
    if module in PORTABLE:
        return name not in PORTABLE[module]
    return name in FUNCTIONS.get(module, ())


def differing(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Lines that use what is not the same on all systems."""
    documented = docstrings(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for entry in node.names:
                renamed = entry.asname and entry.name in (*FUNCTIONS, *PORTABLE)
                if entry.name.partition(".")[0] in MODULES or renamed:
                    yield node.lineno, f"import {entry.name}"
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if module in MODULES:
                yield node.lineno, f"from {module} import"
            for entry in node.names:
                if differs(module, entry.name):
                    yield node.lineno, f"from {module} import {entry.name}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if differs(node.value.id, node.attr):
                yield node.lineno, f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Constant) and id(node) not in documented:
            text = node.value if isinstance(node.value, str) else ""
            if text.startswith(TEXTS):
                yield node.lineno, repr(text)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            alone = len(node.args) == 1 and not node.keywords
            if node.func.attr in METHODS or (
                node.func.attr in ("replace", "rename") and alone
            ):
                yield node.lineno, f".{node.func.attr}()"
        if isinstance(node, ast.Call):
            for key in node.keywords:
                if key.arg in ARGUMENTS:
                    yield node.lineno, f"{key.arg}="


def without_encoding(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Calls that read or write text in the encoding of the system."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name, keys = called(node), {key.arg for key in node.keywords}
        if "encoding" in keys:
            continue
        texts = {"read_text": 0, "write_text": 1}
        if (
            (name in texts and len(node.args) <= texts[name])
            or (name in ("open", "fdopen") and opens_text(node))
            or {"text", "universal_newlines"} & keys
        ):
            yield node.lineno, name


def only_posix(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Lines that use what Windows lacks, outside of what is marked `posix`."""
    marks = [ast.unparse(mark) for mark in getattr(node, "decorator_list", ())]
    if "posix" in marks:
        return
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        name = f"{node.value.id}.{node.attr}"
        if name in LACKING:
            yield node.lineno, name
    for child in ast.iter_child_nodes(node):
        yield from only_posix(child)


def opens_text(node: ast.Call) -> bool:
    """Of `open`, `Path.open`, `os.fdopen`; not `os.open`, nor `Image.open`."""
    function = node.func
    owner = ast.unparse(function.value) if isinstance(function, ast.Attribute) else ""
    if owner in ("os", "webbrowser", "Image") and called(node) == "open":
        return False
    at = 0 if owner not in ("", "os", "io") else 1
    modes = [key.value for key in node.keywords if key.arg == "mode"]
    modes += node.args[at : at + 1]
    return not (modes and isinstance(modes[0], ast.Constant) and "b" in modes[0].value)


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("import signal", 1),
        ("from os import kill, getpid", 1),
        ("import os\nos.replace(a, b); os.sched_getaffinity(0)", 2),
        ("path.replace(other); text.replace('a', 'b')", 1),
        ("path.chmod(1); Path.home(); sys.platform", 3),
        ("import os as o, numpy as np\nfrom tempfile import mkstemp", 2),
        ("run(command, shell=True); Popen(a, start_new_session=True)", 2),
        ("open('/tmp/a', 'rb'); os.popen(a); path.owner(); os.sep", 4),
        ("'''/dev/null is a device'''; open('/dev/null', encoding='ascii')", 1),
        ("replace(record, field=1); os.getpid()", 0),
    ],
)
def test_system_dependent_code_is_found(code: str, found: int) -> None:
    assert len(list(differing(ast.parse(code)))) == found


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("open(a); open(a, 'w'); path.open(); path.open('a')", 4),
        ("open(a, 'rb'); path.open('wb'); os.open(a, b); Image.open(a)", 0),
        ("path.read_text(); path.read_text('latin-1'); path.write_text(text)", 2),
        ("path.write_text(text, 'ascii'); path.read_text(encoding='utf-8')", 0),
        ("run(command, text=True); run(command, text=True, encoding='utf-8')", 1),
    ],
)
def test_text_without_encoding_is_found(code: str, found: int) -> None:
    assert len(list(without_encoding(ast.parse(code)))) == found


def test_one_module_contains_system_dependent_code() -> None:
    words = {*TEXTS, ".replace(", ".rename("} | {f".{name}(" for name in METHODS}
    words |= {f"{word} {name}" for name in MODULES for word in ("import", "from")}
    words |= {f"import {name} as" for name in (*FUNCTIONS, *PORTABLE)}
    words |= {w for name in PORTABLE for w in (f"{name}.", f"from {name} import")}
    words |= {f"{name}=" for name in ARGUMENTS}
    for owner, names in FUNCTIONS.items():
        words |= {f"from {owner} import", *(f"{owner}.{name}" for name in names)}
    found = [
        f"{path}:{line}: {what}"
        for path, tree in parsed_sources(words, *PRODUCT)
        if ROOT / path != MODULE
        for line, what in differing(tree)
    ]
    assert found == []
    assert len(list(differing(parsed(MODULE)))) > 20


def test_text_is_read_and_written_with_an_encoding() -> None:
    """Not in the code page of Windows, in which others cannot read it."""
    words = "read_text", "write_text", "open(", "text=", "universal_newlines"
    tops = *PRODUCT, "benchmarks", "docs", "examples", "tests"
    found = [
        f"{path}:{line}: {what}"
        for path, tree in parsed_sources(words, *tops)
        for line, what in without_encoding(tree)
    ]
    assert found == []


def test_tests_of_posix_are_marked() -> None:
    code = "def test(): os.mkfifo(a)"
    assert len(list(only_posix(ast.parse(code)))) == 1
    assert not list(only_posix(ast.parse(f"@posix\n{code}")))
    words = {name.partition(".")[2] for name in LACKING}
    found = [
        f"{path}:{line}: {what}"
        for path, tree in parsed_sources(words, "tests")
        for line, what in only_posix(tree)
    ]
    assert found == []


def test_one_module_writes_hdf5_files() -> None:
    """libhdf5 crashes on a full disk if it writes to the disk itself."""
    writers = {
        path
        for path, tree in parsed_sources(["h5py.File("], *PRODUCT)
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "h5py.File"
        if [ast.unparse(mode) for mode in node.args[1:2]] != ["'r'"]
    }
    assert {Path(path).name for path in writers} == {"hdf5_files.py"}
