"""Runs a script as a module would be: `python -m tests.faults.script FILE`."""

import runpy
import sys

runpy.run_path(sys.argv[1], run_name="__main__")
