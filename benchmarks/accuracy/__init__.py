"""How true the results are: errors, coverage of intervals, missing effects found, measured records."""
