"""The package's version, which pyproject.toml and `b4mrl.__version__` take from here."""

__version__ = "0.1.0"
