"""The two ways a command ends badly: its input was wrong (exit 2), or the work failed (exit 1)."""


class InputError(Exception):
    """Bad input from the user; the message names the place and the cure."""


class RunError(Exception):
    """The run itself failed; the message names what and where to look."""
