"""The options of a measuring script: each has the type of its default, and one with a list may be repeated."""

import argparse


def asked(about, **defaults):
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, usual in defaults.items():
        parser.add_argument(f"--{name}", default=usual, **({"action": "append"} if usual == [] else {"type": type(usual)}))
    return parser.parse_args()
