"""Files of the repository, of which those who run the tests may have only some beside them."""

import re
from pathlib import Path


def place(path):
    """The path of a file or folder."""
    return next(found for folder in Path(__file__).resolve().parents if (found := folder / path).exists())


def tutorial():
    """The files of the tutorial: their texts by name."""
    return dict(re.findall(r"```\w+ (\S+)\n(.*?)```", place("docs/tutorial.md").read_text(), re.DOTALL))
