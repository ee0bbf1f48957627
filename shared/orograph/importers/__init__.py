"""Other people's data into scenarios."""
