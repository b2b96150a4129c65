"""Diagnostics N9xx: identities of a SID that fail, its units, comparison with another.

N901 to N921 are the identities I1 to I21.
"""

from typing import NamedTuple

from .entry import ERROR, INFO, WARNING, Entry


class IdentityText(NamedTuple):
    """What an identity of a SID says, and what its failure means for a simulation."""

    name: str
    severity: str
    title: str
    meaning: str

    @property
    def code(self) -> str:
        """Code of its failure: N914 for I14."""
        return f"N9{int(self.name[1:]):02d}"

    @property
    def entry(self) -> Entry:
        """Entry of its failure."""
        return Entry(
            self.code,
            self.severity,
            f"{self.name} fails by {{deviation:.1e}} (bound {{bound:.0e}}): "
            f"{self.title}",
            f"{self.meaning} Deviation = max |difference of both sides| / max |entry|, "
            "or the number of contradictions. The bound "
            "is raised to the rounding of printed digits. `validate` gives details; "
            "`convert --repair` rebuilds what follows from other blocks.",
            example={"deviation": 1.2e-3, "bound": 1e-11},
        )


_IDENTITIES = (
    IdentityText(
        "I1",
        ERROR,
        "announced counts = nodes, modes and labels",
        "The file was cut or edited by hand: nodes or modes may be missing.",
    ),
    IdentityText(
        "I2",
        ERROR,
        "origin m1 = phi m0 at every node",
        "Positions and velocities of a marker contradict each other: joints on it "
        "create or lose energy.",
    ),
    IdentityText(
        "I3",
        ERROR,
        "AP m1 = (psi)~ AP m0 at every node",
        "Orientation and angular velocity of a marker contradict each other: joints "
        "on it create or lose energy.",
    ),
    IdentityText(
        "I4",
        ERROR,
        "mdCM m1 = Ct m0 transposed",
        "The moving centre of mass and the inertia coupling disagree: gravity and "
        "acceleration are felt differently, momentum is not conserved.",
    ),
    IdentityText(
        "I5",
        ERROR,
        "Oe m0 = -(J1xx/2, J1yy/2, J1zz/2, J1xy, J1yz, J1xz)",
        "Centrifugal forces on the elastic coordinates do not follow from the change "
        "of inertia: a spinning body gains or loses energy.",
    ),
    IdentityText(
        "I6",
        ERROR,
        "Gr_l + Gr_l^T = 2 J1_l",
        "The gyroscopic block belongs to another inertia or its columns are mixed up: "
        "vibrating and turning at once creates or loses energy.",
    ),
    IdentityText(
        "I7",
        ERROR,
        "Ge_l = 2 Cr1_l, or Cr1_l - Cr1_l^T",
        "Coriolis forces on the elastic coordinates do not follow from the coupling "
        "of rotation and elasticity: a turning body gains or loses energy.",
    ),
    IdentityText(
        "I8",
        WARNING,
        "Ge_l = Cr1_l - Cr1_l^T (exact theory)",
        "A spurious symmetric part sits in Ge: rotating and vibrating at once is "
        "slightly non-conservative.",
    ),
    IdentityText(
        "I9",
        WARNING,
        "Cr1 antisymmetric in the modes (no stiffening)",
        "Cr1 holds a symmetric part that no displacement field explains: angular "
        "acceleration excites the elastic coordinates wrongly.",
    ),
    IdentityText(
        "I10",
        WARNING,
        "antisymmetric part of Gr_l = -(Cr0_l)~",
        "Gr or Cr0 misses a part: angular momentum is not conserved when the body "
        "turns and vibrates at once.",
    ),
    IdentityText(
        "I11",
        WARNING,
        "Oe m1 symmetric in the modes",
        "The centrifugal stiffness matrix is not symmetric: a body spinning about an "
        "oblique axis gains or loses energy and may grow unstable.",
    ),
    IdentityText(
        "I12",
        WARNING,
        "Oe m1 xx + yy + zz = -2 Me (no rotary inertia)",
        "Centrifugal terms were summed with a lumped or reduced mass, and centrifugal "
        "softening is off by this share; or Me holds rotary inertia, which keeps its "
        "trace as sections turn.",
    ),
    IdentityText(
        "I13",
        ERROR,
        "Me, Ke, De symmetric; Me > 0, Ke >= 0, De >= 0",
        "The elastic coordinates have negative mass, stiffness or damping: vibrations "
        "grow without bound.",
    ),
    IdentityText(
        "I14",
        ERROR,
        "coupled mass matrix (6 + nq) positive definite",
        "Coupled mass matrix not positive definite: this body cannot move freely and "
        "may only be used with its frame held.",
    ),
    IdentityText(
        "I15",
        WARNING,
        "frequencies in the labels follow from Ke, Me",
        "The labels hold other frequencies than the body has: other units, modes "
        "moved to another frame and cut off, or a changed stiffness.",
    ),
    IdentityText(
        "I16",
        WARNING,
        "central inertia >= 0 and triangle inequality",
        "No distribution of mass has this inertia: the body turns like no real one.",
    ),
    IdentityText(
        "I17",
        WARNING,
        "De follows a damping law",
        "De is neither Rayleigh nor modal damping: shape functions are coupled by "
        "damping, which few producers intend.",
    ),
    IdentityText(
        "I18",
        ERROR,
        "AP m0 is a rotation at every node",
        "A marker has no orientation, or a left-handed one: joints and forces on it "
        "act along wrong axes.",
    ),
    IdentityText(
        "I19",
        ERROR,
        "no block is an empty placeholder",
        "Blocks were left empty by the writer: the body does not resist turning, or "
        "misses forces when it turns and vibrates.",
    ),
    IdentityText(
        "I20",
        ERROR,
        "Ct m1 and phi m1 stiffen as Oe m1 does",
        "The stiffening by acceleration, gravity or forces has the wrong sign: weight "
        "would stiffen a standing tower instead of softening it.",
    ),
    IdentityText(
        "I21",
        ERROR,
        "terms of higher order act, and Ke m1 has an energy",
        "A simulation refuses the body: its equations have no such terms, or elastic "
        "forces without an energy would drive it.",
    ),
)
#: What each identity says, by its name.
IDENTITY_TEXTS = {each.name: each for each in _IDENTITIES}

ENTRIES = (
    *(each.entry for each in _IDENTITIES),
    Entry(
        "N930",
        WARNING,
        "numbers look like {system}, not SI ({evidence})",
        "Size, density and product of size and first frequency are compared with "
        "those of usual bodies (log-normal, 0.6 to 1.2 decades) in all known unit "
        "systems. Reported where the misfit in SI is larger by more than 4.",
        remedy="convert --units {system}:SI",
        example={
            "system": "mm-t-s",
            "evidence": "size 0.4 m, density 7850 kg/m3, 120 Hz",
        },
    ),
    Entry(
        "N931",
        WARNING,
        "no known unit system makes this an ordinary body; nearest: {system}",
        "As N930; the misfit, a sum of squared deviations over their spreads, is above "
        "25 in each system.",
        remedy="Check mass, size and frequencies.",
        example={"system": "m-kg-s", "evidence": "size 1e+06 m"},
    ),
    Entry(
        "N932",
        WARNING,
        "labels are {ratio:.4g} times the frequencies of Ke and Me: mixed units",
        "Frequencies in the labels are in Hz in every unit system. Their ratio to the "
        "frequencies of (Ke, Me) is the same for all modes within 2 %, and neither 1 "
        "nor 1000.",
        remedy="Check force, mass and length.",
        example={"ratio": 31.62},
    ),
    Entry(
        "N940",
        INFO,
        "comparison: {reason}",
        "Two SIDs are compared in quantities that do not depend on the basis of shape "
        "functions, at common nodes. What has no counterpart is left out.",
        example={"reason": "one of the bodies is rigid: mass properties only"},
    ),
)
