"""The full field of a body: where its points are and how they move, for pictures.

`body_field` asks the discretised body; `mesh_field`, `patch_field` and `beam_field`
know one kind of body each and give a `Sampled`, linear in the degrees of freedom.
"""
