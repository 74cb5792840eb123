"""`python -m bench` is the same command as `fisheye-bench`."""

if __name__ == "__main__":  # worker processes import this module as well, and need no command line
    from bench.commands.app import main

    main()
