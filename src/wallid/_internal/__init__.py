"""What all packages use: errors, validation, units, number formats, array conversion and compiler options."""
