"""Figures: bodies, outputs over time, spectra, error over cost.

figure          figures without a display, texts and labels in them
curves          outputs over time
results         figures of a result
axes3d          axes of bodies in space
body_pictures   pictures of bodies
bodies          shape functions and meshes
precision       error over cost
sweeps          measures over design parameters
"""
