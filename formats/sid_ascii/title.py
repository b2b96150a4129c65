"""Title line of a SID file, and what it states about the writer."""

import re
import unicodedata
from dataclasses import dataclass

from ..base.sid import ComplianceShares, parse_compliance_shares
from ..storage.hdf5_files import written_by

MAX_LENGTH = 400
PREFIX = ":No. nodes, No. modes:"
#: Smallest length that is needed for the compliance shares.
MIN_SHARES_LENGTH = 30

_PLAIN = re.compile(r"(\d+)\s+(\d+)\s*(.*)", re.ASCII)
_WITHOUT_BLANK = re.compile(r"\d+\s*(?=:)()()(.*)", re.ASCII)
_FEMBEAM = re.compile(
    r"(\d+)\s*nodes?\s*,\s*(\d+)\s*(?:modes?|coordinates?)\b\s*,?\s*(.*)",
    re.IGNORECASE | re.ASCII,
)
#: What our own files end their titles with, which other readers take for free text:
#: version, matrices without elements, nodes for the peak stress, and shares, see
#: `formats.base.compliance_shares`; earlier files hold the layout alone.
_OWN = re.compile(
    r"(?<!\s)\s*+\[(?P<by>sidtool(?: [\w.+!-]+)?)(?P<matrices>; matrices)?"
    r"(?:; (?P<peak>(?:no )?peak nodes))?"
    r"(?:; (?P<carried>[^\[\]]+))?\]$",
    re.ASCII,
)
_TAG = re.compile(r"(?<!\s)\s*+\[layout (\w+)\]$", re.ASCII)


@dataclass(frozen=True)
class Layout:
    """How a writer of SID files lays its numbers out; see theory, section 4.

    Attributes
    ----------
    writer : name of the program
    token : the word in a title that gives the writer away
    gr, ge : columns of Gr and Ge, "axis" or "mode" major
    m1_index : "rlc" (mode index second) or "rcl"
    """

    writer: str
    token: str
    gr: str = "axis"
    ge: str = "axis"
    m1_index: str = "rlc"


@dataclass(frozen=True)
class Title:
    """Contents of a title.

    Attributes
    ----------
    text : without the marks of our own writer
    layout : the marked one, if it is not certainly the canonical one
    by : our own program, "" if there is no mark
    carried : compliance shares, if they are stated
    from_matrices : the body came as matrices
    has_peak_nodes : nodes were added for the peak stress, None if that is not stated
    """

    text: str
    layout: Layout | None = None
    by: str = ""
    carried: ComplianceShares | None = None
    from_matrices: bool = False
    has_peak_nodes: bool | None = None


LAYOUTS = {
    "fembs": Layout("FEMBS", "FEMBS"),
    "pysid": Layout("PY_SID", "PY_SID", gr="mode"),
    "matmorembs": Layout("MatMorembs", "MATLABMORInterface"),
    "fembeam": Layout("FEMBeam", "FEMBeam2SID", "mode", "mode", "rcl"),
}


def split_title(line: str) -> tuple[tuple[int, int] | None, str] | None:
    """Counts of nodes and modes, and the text; None if the line is not a title.

    The text is never searched for keywords: real titles contain them.
    """
    for pattern in (_FEMBEAM, _PLAIN, _WITHOUT_BLANK):
        match = pattern.match(line)
        if match:
            counts = (int(match[1][:9]), int(match[2][:9])) if match[1] else None
            return counts, match[3].removeprefix(PREFIX).strip()
    return None


def split_tag(text: str) -> Title:
    """The text and the marks at its end."""
    layout, by, carried, from_matrices, peaks = None, "", None, False, None
    if match := _TAG.search(text):
        tokens = {layout.token: layout for layout in LAYOUTS.values()}
        layout = tokens.get(match[1])
        if layout is None:
            return Title(text)
        text, by = text[: match.start()], "sidtool"
    if match := _OWN.search(text):
        text, by = text[: match.start()], match["by"]
        carried = parse_compliance_shares(match["carried"] or "")
        from_matrices = bool(match["matrices"])
        peaks = None if match["peak"] is None else match["peak"] == "peak nodes"
    return Title(text, layout, by, carried, from_matrices, peaks)


def is_own(start: bytes) -> bool:
    """Whether a file that begins so has a title with the mark of our own writer."""
    line = start.partition(b"\n")[0].decode("ascii", "replace").strip()
    title = split_title(line)
    return title is not None and bool(split_tag(title[1]).by)


def layout_from_words(text: str) -> Layout | None:
    """The layout of the writer that a title names, if it names one."""
    for layout in LAYOUTS.values():
        if layout.token in text:
            return layout
    return None


def title_line(
    text: str,
    counts: tuple[int, int],
    fembeam: bool,
    tag: Layout | None,
    carried: ComplianceShares | None = None,
    from_matrices: bool = False,
    peaks: bool | None = None,
) -> str:
    """The first line of a file: 7-bit ASCII, at most 400 characters.

    Parameters
    ----------
    text : free text; what is not ASCII is replaced, what is too long is cut
    counts : numbers of nodes and modes
    fembeam : in the words of FEMBeam instead of those of FEMBS
    tag : the layout to mark at the end, so that no reader has to guess
    carried : what the shape functions carry, as far as it fits behind the text
    from_matrices : whether the body came as matrices
    peaks : whether nodes were added for the peak stress, None if no node has stress
    """
    start = "{:5d} {:3d}    ".format(*counts) + PREFIX
    if fembeam:
        start = "{} nodes, {} modes, ".format(*counts)
    layout = "" if tag is None else f" [layout {tag.token}]"
    matrices = "; matrices" if from_matrices else ""
    nodes = "" if peaks is None else "; peak nodes" if peaks else "; no peak nodes"
    begin, end = f" [{written_by()}{matrices}{nodes}", f"]{layout}"
    room = MAX_LENGTH - len(start) - len(begin) - len(end)
    title = ascii_text(text)[:room].rstrip()
    room -= len(title) + len("; ")
    if carried is not None and room >= MIN_SHARES_LENGTH:
        begin += f"; {carried.text(room)}"
    return f"{start}{title}{begin}{end}"


def ascii_text(text: str) -> str:
    """One line of printable 7-bit ASCII; accents are dropped, the rest becomes "?"."""
    plain = unicodedata.normalize("NFKD", re.sub(r"\s", " ", text).strip())
    base_characters = (char for char in plain if not unicodedata.combining(char))
    return "".join(char if " " <= char <= "~" else "?" for char in base_characters)
