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

# Pool layout of a body: mass, mdCM, J, then arrays over the elastic coordinates. A
# stiffened body has zeros for J, Cr and Oe and turns in its mean axes instead, with the
# moment of inertia P_H; see `mean_axes`.
P_MASS, P_MDX, P_MDY, P_J, P_H, P_VECTORS = range(6)
# Vectors of length nq, in this order; Ct holds two of them.
V_CTX, V_CTY, V_CR, V_J1, V_OE0, V_KSIGMA, V_TILT, V_H1, N_VECTORS = range(9)
# Square matrices, in this order (row k, column l); behind them the cube of Ke1, if any.
# The last four are those of a stiffened body.
S_KE, S_DE, S_CR1, S_OE1, S_CT1X, S_CT1Y = range(6)
S_COUPLING, S_H2, S_FREE_TURN, S_FREE_MASS, N_SQUARES = range(6, 11)
