"""What to measure next: the measurements after which a diagnosis would name the right effect alone."""
