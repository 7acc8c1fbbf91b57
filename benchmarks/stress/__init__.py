"""What the commands do with damaged files."""
