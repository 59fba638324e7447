"""Words of the command line for flights and films; without imports, for a quick --help."""

CACHE_MODES = ("keep", "frozen", "update")
