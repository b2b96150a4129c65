"""Bodies for other programs: superelements and reduced flexible bodies.

Modules in reading order: `craig_bampton` (mass, stiffness and damping by interface
motions), and `body_files` (writers for Simscape, Nastran, OpenFAST, MBDyn and Exudyn,
selected by the ending of a file).
"""
