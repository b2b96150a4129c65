"""Data types that all packages use: errors, expansions, the SID, progress.

errors              input errors and warnings
sid                 Standard Input Data of one flexible body, its Taylor expansions
stress              stresses at the nodes of a SID
units               units as texts, with their factors to SI
progress            progress of long computations
interruptible       calls of machine code that signals can end
html                tables for notebooks and reports
"""
