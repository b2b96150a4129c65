"""sidtool: flexible bodies for multibody simulation, from finite elements to motion."""
