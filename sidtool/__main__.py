"""``python -m sidtool``: the command line if its script is not on the path."""

import os
import sys

# with `-m` Python searches modules in the working folder first
if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
    del sys.path[0]

from .command import main  # noqa: E402

main()
