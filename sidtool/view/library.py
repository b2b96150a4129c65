"""three.js, the library that draws in the browser, from an installed package.

Weighed for a page that needs no network: three.js 0.63 MB (MIT); k3d 2.6 MB, vtk.js
and plotly each over 3 MB, and none of them moves a deforming surface without sending
all of its points for every picture.
"""

from __future__ import annotations

import re
from importlib import resources

from sidtool.formats.errors import InputError

#: The package that ships three.js with its orbit controls as one minified file.
PACKAGE = "jupyter_threejs_sage"


def three_js() -> str:
    """The newest three.js of the package, as one script.

    Raises
    ------
    InputError : the package is not installed.
    """
    try:
        folders = list((resources.files(PACKAGE) / "static").iterdir())
    except (ModuleNotFoundError, FileNotFoundError):
        raise InputError(
            "the page needs three.js, which is not installed",
            expected='pip install "sidtool[view]", or a film: -o motion.gif',
        ) from None
    releases = [f for f in folders if re.fullmatch(r"r\d+", f.name)]
    newest = max(releases, key=lambda folder: int(folder.name[1:]))
    script = (newest / "three.min.js").read_text(encoding="utf-8")
    return script.replace("</script", "<\\/script")
