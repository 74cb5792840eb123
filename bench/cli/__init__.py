"""The command line: parse, call one function, print, exit status. The only room that prints or exits.

Exit status: 0 fine, 2 a usage or data error told in one line. A bug keeps its traceback.
"""

from bench.cli.app import main

__all__ = ["main"]
