"""Running the command line inside the test process."""

import pytest

from stereohdr.cli import main


def run(*arguments):
    """Run ``stereohdr ARGUMENTS``; return its exit status."""
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return stop.value.code or 0
