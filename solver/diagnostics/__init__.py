"""Notes and warnings on a scene and on a run, in reading order.

- `checks`: input errors that need the compiled scene
- `implausible_values`, `implausible_forces`: input that is hardly intended
- `body_extents`, `light_links`: sizes of bodies, bodies with too little inertia
- `basis_coverage`, `basis_quality`: loads that the shape functions do not represent
- `excitation`, `body_loads`, `geometric_stiffening`: loads of flexible bodies
- `initial_deformation`, `vibration`: motion of the elastic coordinates
- `singular_configurations`: passages of singular configurations
- `failure_causes`: why a run stopped
- `result_notes`, `run_summary`: notes of a result
"""
