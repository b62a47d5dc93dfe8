"""Names of a package that are in its modules: these need more than Python has, and the package can say what is to be installed."""

import importlib


def lazily(package, places):
    """`__all__` and `__getattr__` of a package; `places`: the names in each of its modules."""

    def found(name):
        module = next((module for module, names in places.items() if name in names), None)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f".{module}", package), name)

    return [*sum(places.values(), ())], found
