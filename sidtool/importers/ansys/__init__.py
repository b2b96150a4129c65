"""ANSYS archives (.cdb).

archive         reading of a file, command by command
content         contents of an archive, coordinate systems
element_types   supported element types
materials       elastic materials
constraints     equations, coupled directions, point masses
"""
