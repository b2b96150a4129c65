"""Kernels on disk: whole and of this code, or compiled anew, whatever the disk does."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.diagnostics.record import DiagnosticWarning
from sidtool.solver.compiler import kernel_cache, kernels
from sidtool.solver.compiler.inner_kernels import Intrinsic
from sidtool.solver.compiler.kernels import Entry, entry
from sidtool.solver.compiler.lowering import units
from sidtool.solver.compiler.types import float64
from tests.codes import only_warning
from tests.places import ROOT, posix
from tests.solver.compiler.small_kernels import scaled

#: A file: below it nothing can be written, not even by an administrator.
NO_FOLDER = Path(__file__)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and no trouble told yet."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(kernel_cache, "_warned", set())
    return tmp_path / "cache"


_made: list[Any] = []


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Notes the functions that are compiled."""

    compile_kernel = units.compile_kernel

    def compiled(function: Any, signature: Any, *library: Any) -> bytes:
        _made.append(function)
        return compile_kernel(function, signature, *library)

    _made.clear()
    monkeypatch.setattr(units, "compile_kernel", compiled)


def from_disk(kernel: Entry) -> bool:
    """Whether a kernel that was called did not have to be compiled."""
    return kernel._function not in _made


def entries(cache: Path) -> list[Path]:
    return [path for path in cache.rglob("*") if path.is_file()]


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """What a full disk does: files cannot grow beyond a size."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_another_process_finds_a_whole_kernel(cache: Path) -> None:
    assert scaled(2.0)(1.5) == 3.0
    again = scaled(2.0)
    assert again(1.5) == 3.0 and from_disk(again)
    (file,) = entries(cache)
    assert file.suffix == ".kernel"


def test_versions_of_a_kernel_replace_each_other(cache: Path) -> None:
    for factor in (2.0, 3.0, 2.0):
        kernel = scaled(factor)
        assert kernel(1.5) == 1.5 * factor and not from_disk(kernel)
    assert len(entries(cache)) == 1


@posix
@pytest.mark.parametrize("size", [0, 100, 1_000])
def test_a_full_disk_leaves_no_kernel_of_older_code(size: int, cache: Path) -> None:
    """What could not be written is not there, and nobody takes what was for it."""
    assert scaled(2.0)(1.5) == 3.0
    with files_up_to(size), pytest.warns(DiagnosticWarning) as told:
        assert scaled(3.0)(1.5) == 4.5
    warning = only_warning(told)
    assert warning.code == "N810"
    assert "File too large" in str(warning.data["folders"])
    again = scaled(3.0)
    assert again(1.5) == 4.5 and not from_disk(again)
    assert len(entries(cache)) == 1


def damages(content: bytes) -> dict[str, bytes]:
    """Ways in which a file goes wrong on its way to the disk and back."""
    found = {"empty": b"", "garbage": os.urandom(len(content)), "zeros": bytes(5_000)}
    found["longer"] = content + b"\0"
    for share in (1, 10, 50, 90, 99):
        place = len(content) * share // 100
        found[f"cut at {share} %"] = content[:place]
        changed = bytearray(content)
        changed[place] ^= 16
        found[f"one bit at {share} %"] = bytes(changed)
    return found


def test_damaged_kernels_are_compiled_anew(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one warning that names the file; then it is whole again."""
    assert scaled(5.0)(1.5) == 7.5
    (file,) = entries(cache)
    good = file.read_bytes()
    for kind, content in damages(good).items():
        monkeypatch.setattr(kernel_cache, "_warned", set())
        file.write_bytes(content)
        kernel = scaled(5.0)
        with pytest.warns(DiagnosticWarning) as told:
            assert not kernel.is_cached(kernel.signatures[0]), kind
        warning = only_warning(told)
        assert (warning.code, warning.data["path"]) == ("N811", str(file))
    assert kernel(1.5) == 7.5
    assert file.read_bytes()[: len(kernel_cache.MAGIC)] == kernel_cache.MAGIC
    again = scaled(5.0)
    assert again(1.5) == 7.5 and from_disk(again)


def test_a_whole_file_of_another_kernel_is_not_taken(cache: Path) -> None:
    assert scaled(2.0)(1.5) == 3.0
    (file,) = entries(cache)
    other = file.read_bytes()
    assert scaled(7.0)(1.5) == 10.5
    file.write_bytes(other)
    kernel = scaled(7.0)
    assert kernel(1.5) == 10.5 and not from_disk(kernel)


def test_another_compiler_makes_another_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = scaled(2.0)
    assert kernel(1.5) == 3.0
    monkeypatch.setattr(kernels, "compiler_digest", lambda: "of the next version")
    assert not scaled(2.0).is_cached(kernel.signatures[0])


def test_another_processor_makes_another_kernel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Caches are on shared disks, and processors differ in their instructions."""
    kernel = scaled(3.0)
    assert kernel(1.5) == 4.5
    host, signature = kernels.host_target(), kernel.signatures[0]
    for other in (
        host._replace(processor="cortex-a72"),
        host._replace(features=f"{host.features},+sve2"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(kernels, "host_target", lambda other=other: other)
            patch.setattr(kernels, "environment", kernels.environment.__wrapped__)
            assert not scaled(3.0).is_cached(signature)
    assert scaled(3.0).is_cached(signature)


@posix
def foreign(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets a path belong to another user."""
    if os.geteuid():
        monkeypatch.setattr(os, "geteuid", lambda: path.stat().st_uid + 1)
    else:
        os.chown(path, 12345, -1)


#: What makes machine code untrusted: of the folder or the file, a mode or an owner.
UNTRUSTED = [("folder", 0o777), ("folder", 0o775), ("folder", None)]
UNTRUSTED += [("file", 0o666), ("file", 0o664), ("file", None)]


@posix
@pytest.mark.parametrize(("what", "mode"), UNTRUSTED)
def test_machine_code_that_others_may_have_written_is_not_loaded(
    what: str, mode: int | None, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert scaled(2.0)(1.5) == 3.0
    (file,) = entries(cache)
    path = file if what == "file" else file.parent
    foreign(path, monkeypatch) if mode is None else path.chmod(mode)
    again = scaled(2.0)
    with pytest.warns(DiagnosticWarning) as told:
        assert again(1.5) == 3.0 and not from_disk(again)
    warning = only_warning(told)
    assert (warning.code, warning.data["path"]) == ("N812", str(path))


@posix
def test_a_link_of_another_user_to_kernels_is_not_followed(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert scaled(2.0)(1.5) == 3.0
    (file,) = entries(cache)
    folder = file.parent
    moved = folder.rename(cache / "moved")
    folder.symlink_to(moved)
    again = scaled(2.0)
    assert again(1.5) == 3.0 and from_disk(again)
    if not os.geteuid():
        os.chown(folder, 12345, -1, follow_symlinks=False)
        again = scaled(2.0)
        with pytest.warns(DiagnosticWarning) as told:
            assert again(1.5) == 3.0 and not from_disk(again)
        assert only_warning(told).code == "N812"


@posix
def test_kernels_are_written_for_their_owner_alone(cache: Path) -> None:
    before = os.umask(0)
    try:
        assert scaled(2.0)(1.5) == 3.0
    finally:
        os.umask(before)
    (file,) = entries(cache)
    assert file.stat().st_mode & 0o22 == file.parent.stat().st_mode & 0o22 == 0


def with_intrinsic(factor: float) -> Entry:
    @Intrinsic
    def times(x):  # type: ignore[no-untyped-def]
        def generate(builder, arguments):  # type: ignore[no-untyped-def]
            value = arguments[0]
            return builder.fmul(value, value.type(factor))

        return float64(float64), generate

    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return times(x)

    return kernel


def test_an_intrinsic_is_part_of_the_code() -> None:
    """Its body writes machine code: another one is another kernel."""
    ones = [with_intrinsic(f) for f in (2.0, 3.0, 2.0)]
    assert ones[0].code_digest == ones[2].code_digest != ones[1].code_digest
    assert [kernel(1.5) for kernel in ones] == [3.0, 4.5, 3.0]


def unreachable(monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    """As in a container: nothing can be written, also not by its administrator."""
    if where == "NUMBA_CACHE_DIR":
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(NO_FOLDER / "cache"))
        return
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(kernel_cache, "COMPILER_FOLDER", NO_FOLDER / "package")
    if where == "home":
        for name in ("HOME", "USERPROFILE"):
            monkeypatch.setenv(name, str(NO_FOLDER / "home"))
        return
    monkeypatch.delenv("HOME", raising=False)

    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)


@pytest.mark.parametrize("where", ["NUMBA_CACHE_DIR", "home", "no home"])
def test_without_a_cache_kernels_are_compiled_in_memory(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    unreachable(monkeypatch, where)
    with pytest.warns(DiagnosticWarning) as told:
        assert not kernel_cache.is_writable()
        assert [scaled(f)(1.5) for f in (2.0, 3.0)] == [3.0, 4.5]
    warning = only_warning(told)
    assert warning.code == "N810"
    assert len(warning.data["folders"]) == (2 if where == "home" else 1)


def test_kernels_of_a_package_that_cannot_be_written_are_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an administrator compiled serves all; others keep theirs at home."""
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(kernel_cache, "COMPILER_FOLDER", tmp_path / "package")
    assert scaled(2.0)(1.5) == 3.0
    made = tmp_path / "package" / "__pycache__"
    (file,) = entries(tmp_path)
    assert file.parent == made
    write = kernel_cache.atomic_path

    def read_only(path: Path, **more: bool) -> Any:
        if path.parent == made:
            raise OSError(30, "Read-only file system")
        return write(path, **more)

    monkeypatch.setattr(kernel_cache, "atomic_path", read_only)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for factor in (2.0, 3.0, 3.0):
            kernel = scaled(factor)
            assert kernel(1.5) == 1.5 * factor
        assert from_disk(kernel) and len(entries(tmp_path / "home")) == 1


INTERPRETED = """
from tests.solver.compiler.test_stored_kernels import scaled
from tests.solver.compiler.test_tables import last_entries, pair
print(scaled(2.0)(1.5), last_entries(pair(), 10))
"""


def test_kernels_are_compiled_where_jit_is_disabled() -> None:
    """NUMBA_DISABLE_JIT is for the user's own functions."""
    done = subprocess.run(
        [sys.executable, "-c", INTERPRETED],
        cwd=ROOT,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        encoding="utf-8",
    )
    assert done.stdout == "3.0 82.0\n", done.stderr
