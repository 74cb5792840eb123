"""The command line: parse, call one function, print, exit status. The only package that prints or exits.

Exit status: see docs/commands.md. A bug keeps its traceback.
"""

from bench.commands.app import main

__all__ = ["main"]
