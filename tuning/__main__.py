"""`python -m tuning` is the command `jaxglider`."""

import sys

from tuning.cli.main import main

sys.exit(main())
