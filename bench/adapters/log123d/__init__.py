"""Logs of the library 123D, into which the large driving data sets convert."""

from bench.adapters.log123d.adapter import log123d_recordings

__all__ = ["log123d_recordings"]
