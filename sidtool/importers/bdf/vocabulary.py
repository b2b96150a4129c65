"""Cards of Nastran bulk data that are not read: without effect, or refused."""

from __future__ import annotations

#: Loads, supports, results, and data beyond linear elasticity.
_IDLE = """
    ACCEL ACCEL1 ASET ASET1 AUTOSPC BSET BSET1 CSET CSET1 DAREA
    DCONSTR DEBUG DELAY DESVAR DLOAD DPHASE DRESP1 DVPREL1 EIGB EIGC
    EIGP EIGR EIGRL FORCE FORCE1 FORCE2 FREQ FREQ1 FREQ2 FREQ3 FREQ4 FREQ5 GRAV LOAD
    LSEQ MAT4 MATS1 MOMENT MOMENT1 MOMENT2 NLPARM NLPCI OMIT OMIT1 PLOAD PLOAD1 PLOAD2
    PLOAD4 PLOTEL QSET QSET1 RANDPS RFORCE RLOAD1 RLOAD2 SPCADD SPCD SPCR SUPORT
    SUPORT1 TABDMP1 TABLED1 TABLED2 TABLED3 TABLED4 TABLES1 TABRND1 TEMP TEMPD TEMPP1
    TIC TLOAD1 TLOAD2 TSTEP TSTEPNL USET USET1 EPOINT SPOINT SET3
    BNDFIX BNDFIX1 BNDFREE BNDFRE1 DOPTPRM DLINK DVMREL1 DVCREL1 TABLEM1
"""
#: What would do instead of cards that are refused.
INSTEAD = {
    **dict.fromkeys(
        ("CTUBE", "CBEND"),
        "CROD or CBAR with the same section",
    ),
    **dict.fromkeys(
        ("CELAS1", "CELAS2", "CELAS3", "CELAS4", "CBUSH", "CDAMP1", "CDAMP2", "CVISC"),
        "a force in the scene between markers",
    ),
    **dict.fromkeys(("CMASS1", "CMASS2", "CMASS3", "CMASS4", "CONM1"), "CONM2"),
    **dict.fromkeys(
        ("MAT2", "MAT8"), "MAT1, MAT9 for solids, or an .inp with *ELASTIC, TYPE"
    ),
    "CSHEAR": "shells",
    **dict.fromkeys(
        ("PCOMP", "PCOMPG"),
        "PSHELL of one material, or an .inp with *SHELL SECTION, COMPOSITE and "
        'geometry.engine = "calculix"',
    ),
}
WITHOUT_EFFECT = frozenset(_IDLE.split())
