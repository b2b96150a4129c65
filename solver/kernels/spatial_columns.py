"""Columns of what is known of body frames and markers in space."""

# Columns of Work.frame: position, rotation matrix (body to inertial, by rows),
# velocity, angular velocity, acceleration and angular acceleration at zero z_II'
# (body-resolved, absolute), quaternion.
X, R, V, OMEGA, A, ALPHA, P = 0, 3, 12, 15, 18, 21, 24
N_FRAME = 28

# Columns of Work.point: inertial position, velocity and acceleration (at zero z_II');
# body-resolved position and relative velocity; rotation matrix (marker to inertial, by
# rows), inertial angular velocity and acceleration, and the matrix T that maps rates
# of the rotation vector Psi q to an angular velocity in the body frame.
PX, PV, PA, D, U, PR, PW, PAL, T = 0, 3, 6, 9, 12, 15, 24, 27, 30
N_POINT = 39
