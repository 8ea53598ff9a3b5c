"""`python -m gsbridge`: the same as the command `gsbridge`."""

import sys

from gsbridge.cli import main

if __name__ == "__main__":
    sys.exit(main())
