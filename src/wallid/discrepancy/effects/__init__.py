"""The effects that the plain model may miss; `equation_terms` states the equations that they change."""
