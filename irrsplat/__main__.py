"""`python -m irrsplat` is the command line."""

import sys

from irrsplat.app.cli import main

sys.exit(main())
