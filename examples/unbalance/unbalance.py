"""Response to an unbalance of 1 kg mm on the disc, over the speed."""

import numpy as np

import sidtool

UNBALANCE = 1e-3  # kg m
scene = sidtool.Scene.load("scene.toml")
rows = []
for speed in (190.0, 198.0, 210.0, 222.0, 230.0):
    space = scene.with_({"parameters.speed": speed}).state_space(about="start")
    A, B, C, D = space.A, space.B, space.C, space.D
    transfer = C @ np.linalg.solve(1j * speed * np.eye(len(A)) - A, B) + D
    y, z = transfer @ [1.0, -1j] * UNBALANCE * speed**2  # turns from y to z
    rows.append([speed, abs(y), abs(z)])
print("\n".join("{:.0f} rad/s  y {:.3g} m  z {:.3g} m".format(*row) for row in rows))
np.savetxt("unbalance.csv", rows, delimiter=",", header="speed,y,z", comments="")
