"""The fastest model that keeps a requested accuracy.

options               requests in the scene, a call or the command line
plan                  from a scene to the scene that is simulated
reference_run         the finest model, tightly integrated
sid_rounding          error by the printed digits of SID files
frames                body frames, terms neglected by linear theory
mesh_choice           meshes and modes of bodies given by models
selection             search for the reduced model; integrator and tolerance
long_run_part         selection in an initial interval of a long run
long_run_reference    reference of a long run
error_bounds          a posteriori error bounds, contribution of each choice
trimmed_sid           SID with only what a scene needs
report                decisions, and diagnostics of what errors do not include
"""
