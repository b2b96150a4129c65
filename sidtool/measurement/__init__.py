"""Requested accuracy, model variants and measured runs, common to study and accuracy.

request         outputs and their allowed errors
candidates      possible simplifications of a model; models as scenes
cache           cache of selected models
outputs         outputs over time and cost of a run
runs            runs of models, each done once, their differences and validity
variants        axes of a study, integration settings, variants of bodies
points          reference motion, cost and error of a variant, Pareto front
tasks           conversions and runs on several processes
"""
