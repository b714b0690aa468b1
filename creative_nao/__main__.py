"""`python -m creative_nao` is the command `creative-nao`."""

import sys

from creative_nao.cli import main

if __name__ == "__main__":
    sys.exit(main())
