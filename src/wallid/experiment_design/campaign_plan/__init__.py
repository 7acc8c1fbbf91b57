"""The plan of a campaign before there is a record: how to instrument a wall, how long, and from when on."""
