"""The operator's command, `argosy`."""

import sys


def command() -> None:
    """Run the command line as a process. Ctrl-C during the imports, which take long, ends it without a traceback."""
    try:
        from argosy import __main__
    except KeyboardInterrupt:
        sys.exit(130)
    __main__.command()
