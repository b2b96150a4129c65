"""``python -m sidtool``: the command line where its script is not on the path."""

import os
import sys

# `-m` has Python look for every module in the working folder first
if not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:
    del sys.path[0]

from .command import main  # noqa: E402

main()
