"""The runtime checker of the tests' import hook: an int where a float is annotated is right (PEP 484)."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
