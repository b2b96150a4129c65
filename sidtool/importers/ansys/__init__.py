"""ANSYS archives (.cdb).

archive         reading of a file, command by command; element types
content         contents of an archive, coordinate systems, materials
constraints     equations, coupled directions, point masses
"""
