"""The error that is the user's fault to mend: a bad file, a bad value, a wrong use."""


class BadInputError(ValueError):
    """A file or value that can't be used; the message says in one line what, where and what to do.

    The command line turns it into exit code 2.
    """
