"""Diagnostics: what the program says beside its numbers, as data with codes.

In reading order:

- `record`: the catalogue; a diagnostic, how one is made of a code and values, as data
  and as warning of Python
- `entry`: an entry of the catalogue, how its message is filled
- `conversion` (N1xx), `scene` (N2xx, N5xx), `run` (N3xx, N4xx, N50x), `accuracy`
  (N6xx), `analyses` (N7xx), `files` (N8xx), `identities` (N9xx): the entries by subject
- `hdf5`: diagnostics as a table of a file
"""

from .entry import (
    ERROR as ERROR,
    INFO as INFO,
    SEVERITIES as SEVERITIES,
    WARNING as WARNING,
    Entry as Entry,
)
from .record import (
    Diagnostic as Diagnostic,
    WithDiagnostics as WithDiagnostics,
    count_by_severity as count_by_severity,
    diagnose as diagnose,
    each_once as each_once,
    from_data as from_data,
    plain_text as plain_text,
    stop_message as stop_message,
    without as without,
)
