"""Quick checks: files, values and labels for themselves and against their neighbours, by limits of physics."""
