"""What the commands do with damaged files, and at signals."""
