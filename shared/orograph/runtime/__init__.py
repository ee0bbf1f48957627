"""The life of a process: claim, join, tick, answer, show figures, end; nodes stepped over the bus or in rounds."""
