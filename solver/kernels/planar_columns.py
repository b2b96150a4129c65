"""Columns of what is known of bodies and markers in the plane."""

# Columns of Work.frame: position, orientation, velocity, angular velocity, and the
# acceleration of the frame at zero z_II' (body-resolved), all absolute.
X, Y, COS, SIN, ANGLE, VX, VY, W, AX, AY, AL = range(11)
N_FRAME = 11

# Columns of Work.point: inertial position, velocity and acceleration (at zero z_II'),
# angle, angular velocity and acceleration, and body-resolved position and relative
# velocity.
PX, PY, PVX, PVY, PAX, PAY, TH, TW, TA, DX, DY, UX, UY = range(13)
N_POINT = 13
