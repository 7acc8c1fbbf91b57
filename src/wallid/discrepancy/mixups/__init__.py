"""Mix-ups of columns, units, places and clocks: their corrections, and the search for one that explains a record."""
