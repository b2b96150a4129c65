"""Figures: bodies, outputs over time, spectra, error over cost.

figure               figures without a display, texts and labels in them
curves               outputs over time
results              figures of a result, section forces along bodies
bodies               shape functions and meshes
frequency_responses  Bode plots
studies              error over cost, measures over design parameters
"""
