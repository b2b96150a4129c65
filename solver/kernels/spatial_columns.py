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

# Pool layout of a body: mass, mdCM, J, then arrays over the elastic coordinates:
# vectors (by component, then mode), then square matrices (row k, column l), then the
# cube of Ke1, if any. A stiffened body has zeros for J, Cr and Oe and turns in its mean
# axes instead, with P_H, V_TILT, V_H1 and what begins with S_COUPLING: `mean_axes`.
P_MASS, P_MD, P_J, P_H, P_VECTORS = 0, 1, 4, 10, 16
V_CT, V_CR, V_J1, V_OE0, V_KSIGMA, V_TILT, V_H1, N_VECTORS = 0, 3, 6, 12, 18, 19, 22, 28
S_KE, S_DE, S_CR1, S_OE1, S_CT1 = 0, 1, 2, 5, 11
S_COUPLING, S_H2, S_FREE_TURN, S_FREE_MASS, N_SQUARES = 14, 17, 23, 26, 27

#: Entries of Work.modal per elastic coordinate.
N_MODAL = 17
