"""From a geometry or a mesh to mass, stiffness and marker rows."""
