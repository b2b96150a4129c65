"""Requested accuracy, model variants and measured runs, common to study and accuracy.

request         outputs and their allowed errors
candidates      possible simplifications of a model; models as scenes
validity        limits of linear theory, comparable elastic coordinates
cache           cache of selected models
outputs         outputs over time and cost of a run
runs            runs of models, each done once, and their differences
body_variants   bodies with other meshes, modes, frames, terms
variants        axes of a study, integration settings
points          cost and error of a variant, Pareto front
tasks           conversions and runs on several processes
reference       reference motion of a study
"""
