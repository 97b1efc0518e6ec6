"""Proof of a patch: simulation of the recording, compared on data left out.

What to use when: `proof.prove` for the whole of it. `setup` builds the simulator of a
recording and its model, `simulation` does again what was done in it, `comparison` says
how readings are compared, `nominal_fit` fits what is nominal, `refinement` moves an
effect's parameters to where the simulator agrees best, `proof_checks` tries the patch
where it should fail, `explained_share` compares before and after,
`model_discrimination` says where two explanations would differ.
"""
