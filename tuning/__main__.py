"""`python -m tuning` is the command `jaxglider`."""

import sys

from tuning.cli import main

sys.exit(main())
