"""The words that the command line knows of flights and films; without any import, since --help is to be quick."""

CACHE_MODES = ("keep", "frozen", "update")
QUALITIES = ("draft", "good", "best")
