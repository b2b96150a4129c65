"""What a command says of files that cannot be written."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.cli.result_files import OutputFiles
from sidtool.formats.result import Result, ResultFile
from sidtool.formats.result.data import TABLES
from tests.codes import unwrapped


def test_an_error_of_a_library_is_shown_in_its_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """libhdf5 reports failures without an error number, and the message was None."""

    class Refused(ResultFile):
        def finish(self, result: Result) -> None:
            raise OSError("object header message is too large")

    with OutputFiles(None, None) as files:
        files._open[tmp_path / "r.h5"] = Refused(tmp_path / "r.h5")
        files.begin(dict.fromkeys(TABLES, ()), 1)
        with pytest.raises(OSError, match="too large"):
            files.finish(None)  # type: ignore[arg-type]
    files.print_messages(stderr=False)
    assert "r.h5: object header message is too large" in unwrapped(
        capsys.readouterr().err
    )
    assert list(tmp_path.iterdir()) == []
