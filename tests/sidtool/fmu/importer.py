"""A small importer of FMUs: FMI 2.0 and 3.0 through ctypes.

It needs the standard library only, so that a process without other packages can run a
unit: `python importer.py FILE.fmu STATE LENGTH` continues a serialised state and prints
the outputs.
"""

from __future__ import annotations

import ctypes
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

Real = ctypes.c_double
Size = ctypes.c_size_t
Pointer = ctypes.c_void_p
OK, WARNING, DISCARD, ERROR = range(4)
_FOLDERS = {"2.0": "linux64", "3.0": "x86_64-linux"}
_LOGGER_2 = ctypes.CFUNCTYPE(
    None, Pointer, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
)
_LOGGER_3 = ctypes.CFUNCTYPE(
    None, Pointer, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p
)


class _Callbacks(ctypes.Structure):
    _fields_ = [
        ("logger", Pointer),
        ("allocate", Pointer),
        ("release", Pointer),
        ("step_finished", Pointer),
        ("environment", Pointer),
    ]


class Library:
    """A unpacked unit: its description and its shared library."""

    def __init__(self, file: Path, folder: Path) -> None:
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.description = root
        self.version = root.get("fmiVersion", "")
        self.token = root.get("guid") or root.get("instantiationToken") or ""
        simulation = root.find("CoSimulation")
        assert simulation is not None
        identifier = simulation.get("modelIdentifier")
        binaries = folder / "binaries" / _FOLDERS[self.version]
        self.path = binaries / f"{identifier}.so"
        self.functions = ctypes.CDLL(str(self.path))
        variables = root.find("ModelVariables")
        assert variables is not None
        self.numbers = {
            str(v.get("name")): int(str(v.get("valueReference"))) for v in variables
        }
        self.outputs = [
            str(v.get("name")) for v in variables if v.get("causality") == "output"
        ]

    def function(self, name: str) -> ctypes._NamedFuncPointer:
        """A function of the standard, without `fmi2` or `fmi3`."""
        function = getattr(self.functions, f"fmi{self.version[0]}{name}")
        function.restype = ctypes.c_int
        return function


class Instance:
    """An instance of a unit, in step mode at its start time, or for model exchange.

    Attributes
    ----------
    messages : status and text of what the unit told
    """

    def __init__(
        self,
        library: Library,
        start: float = 0.0,
        stop: float | None = None,
        token: str | None = None,
        events: bool = False,
        exchange: bool = False,
    ) -> None:
        self.library, self.messages = library, list[tuple[int, str]]()
        self._is_2 = library.version == "2.0"
        token_bytes = (library.token if token is None else token).encode()
        if self._is_2:
            self._logger = _LOGGER_2(self._log_2)
            logger = ctypes.cast(self._logger, Pointer)
            self._callbacks = _Callbacks(logger, None, None, None, None)
            function = library.functions.fmi2Instantiate
            function.restype = Pointer
            address = ctypes.byref(self._callbacks)
            kind = 0 if exchange else 1
            self.address = function(b"it", kind, token_bytes, b"", address, 0, 0)
        elif exchange:
            self._logger_3 = _LOGGER_3(self._log_3)
            function = library.functions.fmi3InstantiateModelExchange
            function.restype = Pointer
            quiet = ctypes.c_bool(False)
            self.address = function(
                b"it", token_bytes, b"", quiet, quiet, None, self._logger_3
            )
        else:
            self._logger_3 = _LOGGER_3(self._log_3)
            function = library.functions.fmi3InstantiateCoSimulation
            function.restype = Pointer
            flags = [ctypes.c_bool(flag) for flag in (False, False, events, events)]
            self.address = function(
                b"it",
                token_bytes,
                b"",
                *flags,
                None,
                Size(0),
                None,
                self._logger_3,
                None,
            )
        if self.address is not None:
            self.start_status = self._start(start, stop)

    def _log_2(
        self, _: int, name: bytes, status: int, kind: bytes, text: bytes
    ) -> None:
        self.messages.append((status, text.decode()))

    def _log_3(self, _: int, status: int, kind: bytes, text: bytes) -> None:
        self.messages.append((status, text.decode()))

    def call(self, name: str, *arguments: object) -> int:
        """Status of a function whose first argument is the instance."""
        return int(self.library.function(name)(Pointer(self.address), *arguments))

    def _start(self, start: float, stop: float | None) -> int:
        times = (Real(start), stop is not None, Real(stop or 0.0))
        if self._is_2:
            status = self.call("SetupExperiment", 0, Real(0.0), *times)
            self.call("EnterInitializationMode")
        else:
            begin, defined, end = times
            status = self.call(
                "EnterInitializationMode",
                *(ctypes.c_bool(False), Real(0.0), begin, ctypes.c_bool(defined), end),
            )
        self.call("ExitInitializationMode")
        return status

    def get(self, names: Iterable[str] | None = None) -> list[float]:
        """Values of variables, by default of all outputs."""
        wanted = self.library.outputs if names is None else list(names)
        n = len(wanted)
        numbers = (ctypes.c_uint32 * n)(*(self.library.numbers[k] for k in wanted))
        values = (Real * n)()
        count = () if self._is_2 else (Size(n),)
        name = "GetReal" if self._is_2 else "GetFloat64"
        assert self.call(name, numbers, Size(n), values, *count) == OK
        return list(values)

    def set(self, name: str, value: float) -> int:
        numbers = (ctypes.c_uint32 * 1)(self.library.numbers[name])
        count = () if self._is_2 else (Size(1),)
        function = "SetReal" if self._is_2 else "SetFloat64"
        return self.call(function, numbers, Size(1), (Real * 1)(value), *count)

    def step(self, time: float, length: float) -> int:
        """Advance, up to a break of a function if the unit stops there."""
        if self._is_2:
            return self.call("DoStep", Real(time), Real(length), 1)
        self.event, self.early = ctypes.c_bool(), ctypes.c_bool()
        self.ends, last = ctypes.c_bool(), Real()
        flags = map(ctypes.byref, (self.event, self.ends, self.early, last))
        return self.call(
            "DoStep", Real(time), Real(length), ctypes.c_bool(True), *flags
        )

    def run(self, end: float, length: float, time: float = 0.0) -> list[list[float]]:
        """Outputs at all communication points up to a time, the first included."""
        rows = [self.get()]
        for k in range(round((end - time) / length)):
            assert self.step(time + k * length, length) == OK, self.messages
            rows.append(self.get())
        return rows

    def rates(self, states: Iterable[float]) -> list[float]:
        """Rates of the continuous states, in model exchange."""
        values = list(states)
        n = len(values)
        array = (Real * n)(*values)
        assert self.call("SetContinuousStates", array, Size(n)) == OK
        part = "" if self._is_2 else "ContinuousState"
        assert self.call(f"Get{part}Derivatives", array, Size(n)) == OK
        return list(array)

    def derivative(self, unknowns: Iterable[str], known: str) -> list[float]:
        """Directional derivatives of variables by an input or a state."""
        wanted = [self.library.numbers[name] for name in unknowns]
        n = len(wanted)
        numbers = (ctypes.c_uint32 * n)(*wanted)
        by = (ctypes.c_uint32 * 1)(self.library.numbers[known])
        seed, found = (Real * 1)(1.0), (Real * n)()
        parts = (numbers, Size(n), by, Size(1), seed)
        sizes = () if self._is_2 else (Size(1),)
        ends = () if self._is_2 else (Size(n),)
        name = "GetDirectionalDerivative"
        assert self.call(name, *parts, *sizes, found, *ends) == OK
        return list(found)

    def state(self) -> Pointer:
        """A copy of the state, which `free` releases."""
        state = Pointer()
        assert self.call(self._state("Get"), ctypes.byref(state)) == OK
        return state

    def restore(self, state: Pointer) -> None:
        assert self.call(self._state("Set"), state) == OK

    def free(self, state: Pointer) -> None:
        assert self.call(self._state("Free"), ctypes.byref(state)) == OK

    def serialised(self) -> bytes:
        state, size = self.state(), Size()
        name = self._state("Serialized") + "Size"
        assert self.call(name, state, ctypes.byref(size)) == OK
        content = ctypes.create_string_buffer(size.value)
        assert self.call(self._state("Serialize"), state, content, size) == OK
        self.free(state)
        return content.raw

    def deserialise(self, content: bytes) -> int:
        """Set the state to a serialised one."""
        state, name = Pointer(), "DeSerialize" if self._is_2 else "Deserialize"
        status = self.call(
            self._state(name), content, Size(len(content)), ctypes.byref(state)
        )
        if status == OK:
            self.restore(state)
            self.free(state)
        return status

    def reset(self) -> None:
        assert self.call("Reset") == OK
        self._start(0.0, None)

    def close(self) -> None:
        self.call("FreeInstance")

    def _state(self, verb: str) -> str:
        return f"{verb}FMU{'s' if self._is_2 else 'S'}tate"


def main() -> None:
    file, state, time, length = sys.argv[1:]
    library = Library(Path(file), Path(state).parent / "unpacked")
    instance = Instance(library)
    assert instance.deserialise(Path(state).read_bytes()) == OK
    assert instance.step(float(time), float(length)) == OK
    print(" ".join(x.hex() for x in instance.get()))


if __name__ == "__main__":
    main()
