"""Text, tables, JSON and HTML about files and results.

tables        text tables
sid           contents of a SID, its natural modes
input_files   model files, imported files, scenes
result        results, accuracy
analyses      equilibria, natural modes, Campbell diagrams, Floquet analyses
state_space   state spaces and frequency responses, and their files
json_data     data for other programs
validation    checks and comparison of a SID
"""
