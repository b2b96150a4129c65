"""Only what a scene needs: the cheapest model that keeps a wanted accuracy.

wanted        outputs, and the error that each may have
flat          a spatial scene whose motion stays in a plane
candidates    what can be left out; models as scenes
runs          models, each compiled and run once, and how much two differ
reference     every choice at its finest, integrated tightly
digits        what the digits of SID files leave open
frames        what small deformations leave out, seen in other frames
meshes        bodies of models, as fine as is needed
same_shapes   elastic coordinates that mean the same in two SIDs of one body
outside       where the theory of a SID ends
integration   integrator and tolerance of a model
choose        the search
long          the search where runs are long
bounds        what errors cannot exceed, where that is known
budget        what each kind of choice adds and saves
sentences     why
cached        what was chosen before
asked         where an accuracy is asked for
plan          all of it, from a scene to the scene that is simulated
"""

from __future__ import annotations

from .asked import from_texts, plan_for
from .outside import OutsideTheory
from .plan import Certified, Plan, planned

__all__ = ["Certified", "OutsideTheory", "Plan", "from_texts", "plan_for", "planned"]
