"""From files to SIDs and scenes: conversion, caches, replacements.

files            kinds of files, writing of SIDs and results
model_to_sid     model file to SID or field
sid_from_arrays  SID from matrices or blocks in memory
model_cache      SIDs of the models of a scene, converted once
scene_changes    scene with replaced SIDs and rigid bodies
extra_outputs    outputs that a run did not record
examples         example folders
"""
