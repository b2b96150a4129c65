"""Derivatives of a motion by numbers of its scene, and what is made of them.

history             outputs over a motion: integrals, peaks, settling
functionals         numbers that a motion gives, such as `max_abs(rod.q1)`
seeds               derivatives of functionals by the states of a motion
variables           numbers of a scene and of models, by their keys
model_sensitivity   derivatives of a body by numbers of its model, without a motion
differences         central differences with an estimate of their error
sensitivity_result  values, derivatives and errors, as table, data and file
search_result       what both of the following results share
optimisation        scaled objective and limits, search for the best design
measurements        measured outputs in tables
identification      least squares, numbers with intervals
"""

from .sensitivity_result import Sensitivities

__all__ = ["Sensitivities"]
