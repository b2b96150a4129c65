"""Figures: bodies, outputs over time, spectra, error over cost.

figure               figures without a display, texts and labels in them
curves               outputs over time
sections             section forces along bodies
results              figures of a result
body_pictures        pictures of bodies and their axes in space
bodies               shape functions and meshes
frequency_responses  Bode plots
studies              error over cost, measures over design parameters
"""
