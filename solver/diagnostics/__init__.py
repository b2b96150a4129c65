"""Notes and warnings on a scene and on a run, in reading order.

- `checks`: input errors that need the compiled scene
- `implausible_values`: input that is hardly intended
- `light_links`: sizes of bodies, bodies with too little inertia
- `basis_coverage`, `basis_shares`: loads that the shape functions represent poorly or
  not at all
- `excitation`, `body_loads`, `geometric_stiffening`: loads of flexible bodies
- `initial_deformation`, `vibration`: motion of the elastic coordinates
- `failure_causes`: passages of singular configurations, why a run stopped
- `result_notes`, `run_summary`: notes of a result
"""
