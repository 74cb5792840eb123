"""The commands: each a function that returns a record, and what prints it. The only package that prints or exits.

Most are in the module of their name. `command` makes a command line of a function; `app` is the program. Exit status:
see docs/reference.md. A bug keeps its traceback. Modules import what is heavy inside of their functions, so that help
and completion are quick.
"""
