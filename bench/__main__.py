"""`python -m bench` is the same command as `fisheye-bench`."""

from bench.cli import main

if __name__ == "__main__":
    main()
