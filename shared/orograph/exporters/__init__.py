"""Maps into other tools' files: `write(path, chart)` in each, named in `formats.py`."""
