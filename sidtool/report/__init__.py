"""Text, tables, JSON and HTML about files and results.

tables        text tables
sid           contents of a SID, its natural modes
input_files   model files, imported files, scenes
result        results, analyses, accuracy
state_space   state spaces and frequency responses, and their files
modes         Campbell diagrams, Floquet modes
json_data     data for other programs
validation    checks and comparison of a SID
"""
