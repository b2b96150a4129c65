"""Diagnostics N8xx and exports of N6xx: files, pictures, other programs."""

from .entry import INFO, WARNING, Entry

ENTRIES = (
    Entry(
        "N810",
        WARNING,
        "compiled kernels cannot be kept in {folders}",
        "Machine code of the kernels is compiled once, written to one of these folders "
        "and read afterwards. No file could be written, for the reason in brackets. "
        "Every process compiles its kernels anew, all of them in about 60 s on two "
        "processors.",
        remedy="NUMBA_CACHE_DIR may name a folder that can be written.",
        example={"folders": ("/opt/sidtool (Permission denied)",)},
    ),
    Entry(
        "N811",
        WARNING,
        "compiled kernels in {path} are damaged and compiled anew",
        "The checksum (SHA-256) in the file is not that of its content. "
        "Nothing of it is used, and a complete file replaces it.",
        remedy="Check the disk if this happens again.",
        example={"path": "kernels/step.bin"},
    ),
    Entry(
        "N812",
        WARNING,
        "compiled kernels in {path} are not used: {reason}",
        "Machine code is loaded only from files and folders that belong to the user or "
        "to the administrator and that others cannot change: permission bits 022 of "
        "all of them are 0.",
        remedy="NUMBA_CACHE_DIR may name a folder of your own.",
        example={"path": "kernels", "reason": "others may write to it"},
    ),
    Entry(
        "N820",
        WARNING,
        "output times do not resolve {outputs}; straight lines join them",
        "The motion between output times is interpolated from the states. Outputs that "
        "deviate from it by more than 30 % of their range are drawn with "
        "straight lines.",
        remedy="Use a smaller output_step.",
        example={"outputs": ("rod.q1",)},
    ),
    Entry(
        "N821",
        INFO,
        "curves between output times have an error of up to {share} of their range",
        "Difference of the interpolated states and their derivatives between output "
        "times, over the range of the curve.",
        remedy="A smaller output_step shows more.",
        units={"share": "%"},
        example={"share": 0.02},
    ),
    Entry(
        "N822",
        WARNING,
        "{file} is not its field: it {reason}",
        "A file NAME.field.h5 next to a SID is used for pictures if its nodes and "
        "shape functions are those of the SID within rounding, max |difference| "
        "relative to the largest entry. Otherwise the nodes of the SID are drawn.",
        remedy="Convert the model again with --field.",
        example={
            "subject": "rod",
            "file": "rod.field.h5",
            "reason": "has other nodes",
        },
    ),
    Entry(
        "N840",
        INFO,
        "{problem}; {taken}",
        "Structure, order and symmetry that a SID file declares, against its entries, "
        "beyond the rounding of printed numbers. Nothing is repaired on reading.",
        remedy="{remedy}",
        example={
            "subject": "Ke",
            "problem": "declared symmetric, but its halves differ",
            "taken": "both are used",
            "remedy": "",
        },
    ),
    Entry(
        "N841",
        WARNING,
        "no identity proves the order of its columns: read {layout}-major",
        "Writers order the columns of Gr and Ge by axis or by mode. An order is known "
        "if I6 (Gr_l + Gr_l^T = 2 J1_l) or I7 (Ge_l = 2 Cr1_l) holds to 1e-3 of the "
        "block and ten times better than in the other order, or if the title names "
        "the writer. Otherwise the order with the smaller residual is taken, or "
        "axis-major without J1 or Cr1. Coriolis forces depend on it.",
        remedy="`convert --repair` rebuilds Gr and Ge.",
        example={"subject": "Ge", "layout": "axis"},
    ),
    Entry(
        "N842",
        WARNING,
        "{announced} announced, the file has {found}",
        "Counts of nodes and modes in the first line, and labels of elastic "
        "coordinates, against the content; the identity I1 is the number of such "
        "contradictions. The file was cut or edited.",
        remedy="Write the file again.",
        example={"announced": "12 nodes, 5 modes", "found": "2 nodes, 3 modes"},
    ),
    Entry(
        "N601",
        INFO,
        "is an event that the FMU does not report",
        "An FMU has the motion of the scene. Events that only record a state change "
        "nothing of it and are left out. Events that end the run are refused.",
        remedy="Watch the output in the importing program.",
        example={"subject": "landing"},
    ),
    Entry(
        "N602",
        INFO,
        "is an input whose table is not in the FMU",
        "Inputs of an FMU are set by the importing program. Until then they have the "
        "value `initial` of the scene.",
        remedy="Give the table to the importing program.",
        example={"subject": "load"},
    ),
)
