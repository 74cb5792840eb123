"""The command line: parse, call one function, print, exit status. The only package that prints or exits.

Exit status: 0 fine, 1 the gate failed, 2 a usage or data error told in one line, 3 the gate has no baseline or
judged nothing. A bug keeps its traceback.
"""

from bench.cli.app import main

__all__ = ["main"]
