"""From files to SIDs and scenes: conversion, caches, replacements.

files            kinds of files, writing of SIDs and results
model_to_sid     model file to SID or field
sid_from_arrays  SID from matrices or blocks in memory
scene_models     bodies of a scene that are described by models
model_cache      SIDs of models, converted once
scene_changes    scene with replaced SIDs and rigid bodies
extra_outputs    outputs that a run did not record
examples         example folders
"""
