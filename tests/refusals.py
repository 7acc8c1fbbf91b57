"""What the tests of the input rooms share."""

import pytest

from wallid.case.wall_and_sensors import InputError


def refuses(make, *parts):
    """A call is refused with a message that holds every part; returns the message."""
    with pytest.raises(InputError) as caught:
        make()
    message = str(caught.value)
    for part in parts:
        assert part in message
    assert "\n" not in message
    return message
