"""What every package uses: errors, validation, units, number formats, and the options that make XLA fast."""
