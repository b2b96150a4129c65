"""Bodies for other programs: superelements and reduced flexible bodies.

Modules in reading order: `craig_bampton` (mass, stiffness and damping by interface
motions), `matrix_checks` (what is checked before writing), `inertia_integrals`
(integrals of the floating frame in the form of other programs), and the writers
`simscape`, `nastran`, `openfast`, `mbdyn` and `exudyn`; `body_files` selects one by the
ending of a file.
"""
