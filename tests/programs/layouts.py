"""Name, size and offset of every field of every structure on the wire, a line each: of `json`, of the module in `python`, or the program in `c` that prints them."""
import json, re, sys
import armplane.wire

HOW = sys.argv[1]
if HOW == "python":
    for structure in [value for value in vars(armplane.wire).values() if isinstance(value, type)]:
        for field in structure._fields_:
            place = getattr(structure, field[0])
            print(structure.__name__, field[0], place.offset, place.size)
    sys.exit()
lines = [
    # A keyword in C++ and Python.
    (structure["name"], {"class": "class_"}.get(field["name"], field["name"]), field["offset"], field["bytes"])
    for structure in json.load(sys.stdin)["structures"]
    for field in structure["fields"]
]
assert len(lines) > 100, lines
if HOW == "json":
    for line in lines:
        print(*line)
else:
    print('#include "armplane.h"\nint main(void) {')
    for name, field, _, _ in lines:
        struct = "struct armplane_" + re.sub("(?<!^)(?=[A-Z])", "_", name).lower()
        print(f'printf("{name} {field} %zu %zu\\n", offsetof({struct}, {field}), sizeof (({struct} *)0)->{field});')
    print("return 0;\n}")
