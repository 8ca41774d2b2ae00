"""``python -m benchmarks.reasoner``: some rows, without the rest of the part."""

import sys

from benchmarks.reasoner.part import main

sys.exit(main())
