"""sidtool: flexible bodies for multibody simulation, from finite elements to motion.

    import sidtool
    sid = sidtool.convert("rod_q4.toml")
    sidtool.write("rod.SID_FEM", sid)
    result = sidtool.simulate("slider_crank.toml", sids={"rod": sid})
    result["piston.x"]

Bad input raises `sidtool.InputError`. Everything is imported on first use.

`formats` and `solver`, on which this package stands, are those installed beside it,
also where the folder of a script holds modules of these names.

Raises
------
ImportError : the program has imported another `formats` or `solver` before.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from formats.errors import InputError as InputError
    from formats.result import Result as Result
    from formats.sid import SID as SID

    from .analysing import inverse_dynamics as inverse_dynamics
    from .analysing import linearise as linearise
    from .analysing import static_equilibrium as static_equilibrium
    from .api import compare as compare
    from .api import convert as convert
    from .api import repair as repair
    from .api import simulate as simulate
    from .api import validate as validate
    from .api import write as write
    from .kinds import read as read

_HOME = {
    "InputError": "formats.errors",
    "Result": "formats.result",
    "SID": "formats.sid",
    "SimulationError": "solver.errors",
    "compare": "sidtool.api",
    "convert": "sidtool.api",
    "inverse_dynamics": "sidtool.analysing",
    "linearise": "sidtool.analysing",
    "read": "sidtool.kinds",
    "repair": "sidtool.api",
    "simulate": "sidtool.api",
    "static_equilibrium": "sidtool.analysing",
    "validate": "sidtool.api",
    "write": "sidtool.api",
}

__version__ = "0.1.0"
__all__ = sorted(_HOME)


def _take_installed(name: str) -> None:
    """Import the package of a name that stands beside this one, and no other."""
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    spec = PathFinder.find_spec(name, [folder])
    if spec is None or spec.loader is None or spec.origin is None:
        raise ImportError(f"sidtool is not installed whole: no {name} in {folder}")
    present = sys.modules.get(name)
    if present is not None:
        origin = getattr(present, "__file__", None)
        if origin is None or os.path.realpath(origin) != os.path.realpath(spec.origin):
            raise ImportError(
                f"another module {name} ({origin}) was imported before sidtool, which "
                f"has a package of that name: rename {name}, or import sidtool first"
            )
        return
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)


for _package in ("formats", "solver"):
    _take_installed(_package)


def __getattr__(name: str) -> Any:
    """Import on first use, so that the command line answers at once."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


class _Face(ModuleType):
    """Keeps public names for functions: importing `sidtool.convert`, the module, would
    put it in the place of `sidtool.convert`, the function."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
