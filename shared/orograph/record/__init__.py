"""A run as one MCAP file that every viewer opens, and the file read again. foxglove and mcap are known here only."""
