"""Where the files of the study are: conf/ and reproduce/, in a checkout or in an installed package."""

from pathlib import Path

PACKAGE = Path(__file__).parents[1]


def conf_directory() -> Path:
    """Return the directory of the configuration files, to which the package of a checkout has a link."""
    return (PACKAGE / "conf").resolve()


def project_directory() -> Path:
    """Return the directory of the checkout; of an installed package, that of its own files."""
    return conf_directory().parent
