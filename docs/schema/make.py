#!/usr/bin/env python3
"""Writes the JSON Schemas of scenarios, graphs and summary.json from the types that read and write them.

    python3 docs/schema/make.py            # writes scenario.json, graph.json and summary.json beside this file
    python3 docs/schema/make.py --check    # exit code 1 if a file is out of date

The types are in shared-types/src; their comments, with units, become descriptions. `cargo test --test system schema` compares the keys with those that
the program itself accepts, and validates every scenario of the repository and the summary of a run.
"""

import json
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
TYPES = HERE.parents[1] / "shared-types/src"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
NUMBERS = {"f64": "number", "i32": "integer", "bool": "boolean", "String": "string", "PathBuf": "string"}
BY_SINGULARITY = json.loads("""{
  "description": "One number for each singularity, by its name. Names left out keep their defaults. An array is read as elbow, wrist, overhead.",
  "anyOf": [
    {
      "type": "object",
      "properties": {
        "elbow": {"type": "number"}, "wrist": {"type": "number"}, "overhead": {"type": "number"}, "shoulder": {"type": "number"}, "numeric": {"type": "number"}
      },
      "additionalProperties": false
    },
    {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
  ]
}""")
# A type of Rust and its schema, which may hold that of the type within.
FORMS = [
    (r"Option<(.*)>", lambda of: of),
    (r"Vec<(.*)>", lambda of: {"type": "array", "items": of}),
    (r"\[(.*); (\d+)\]", lambda of, size: {"type": "array", "items": of, "minItems": int(size), "maxItems": int(size)}),
    (r"BTreeMap<String, (.*)>", lambda of: {"type": "object", "additionalProperties": of}),
]


def text_of(lines):
    """The words of `///` comments up to a code block; links keep their names."""
    words = " ".join(line.strip().removeprefix("///").strip() for line in lines).split("```")[0].strip()
    return re.sub(r"\[`?([^\]`]+)`?\](\([^)]*\))?(?=[^\[]|$)", r"\1", words) if "](" in words or "[`" in words else words


def split(body):
    """The items of a block: comments and attributes, then the item itself up to its comma."""
    comments, attributes = [], []
    for line in body.splitlines():
        line = line.strip()
        if line.startswith("///"):
            comments.append(line)
        elif line.startswith("#["):
            attributes.append(line)
        elif line:
            yield text_of(comments), " ".join(attributes), line.rstrip(",")
            comments, attributes = [], []


def kebab(name):
    return re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower()


def schema_of(kind):
    """The schema of a field's type."""
    if kind in NUMBERS:
        return {"type": NUMBERS[kind]}
    if kind in ("u32", "u64", "usize"):
        return {"type": "integer", "minimum": 0}
    if kind == "BySingularity":
        return BY_SINGULARITY
    for form, made in FORMS:
        if found := re.fullmatch(form, kind):
            of, *size = found.groups()
            return made(schema_of(of), *size)
    return {"$ref": f"#/$defs/{kind}"}


def structure(about, attributes, body):
    """The schema of a struct, and the types whose fields are flattened into it."""
    properties, required, flattened = {}, [], []
    is_closed = "deny_unknown_fields" in attributes
    for words, of_field, item in split(body):
        field, kind = re.fullmatch(r"pub (\w+): (.*)", item).groups()
        if "serde(flatten)" in of_field:
            flattened.append(kind)
            continue
        named = dict(re.findall(r'(rename|alias) = "(\w+)"', of_field))
        name, schema, is_option = named.get("rename", field), schema_of(kind), kind.startswith("Option<")
        if 'with = "floor"' in of_field:
            schema = {"anyOf": [{"type": "number"}, {"const": "none"}]}
        elif is_option and "skip_serializing_if" not in of_field:
            schema = {"anyOf": [schema, {"type": "null"}]}
        properties[name] = {**schema, "description": words}
        if is_closed and "alias" in named:
            properties[named["alias"]] = {**schema, "description": f"The same as {field}."}
        # serde takes an option that is left out as none, unless a function of its own reads it.
        is_read = " with =" in of_field or "deserialize_with" in of_field
        if "default)]" not in attributes and "serde(default" not in of_field and (is_read or not is_option):
            required.append(name)
    schema = {"type": "object", "description": about, "properties": properties}
    schema |= {"required": required} if required else {}
    return schema | ({"additionalProperties": False} if is_closed else {}), flattened


def definitions():
    """The schema of every type in the files, by name."""
    found, flattened = {}, []
    words_of = lambda comments: text_of(comments.splitlines())
    names = "scenario fault fault/kind summary job graph/topology process layout".split()
    for file in [*(TYPES / f"{name}.rs" for name in names), *sorted((TYPES / "scenario").glob("*.rs"))]:
        source = file.read_text().split("#[cfg(test)]")[0]
        head = r"((?:^///[^\n]*\n)*)((?:^#\[[^\n]*\n)*)^pub (struct|enum) (\w+) \{\n(.*?)^\}"
        for comments, attributes, what, name, body in re.findall(head, source, re.S | re.M):
            if "Deserialize" not in attributes:
                continue
            if what == "enum":
                options = [{"const": kebab(item), "description": words} for words, _, item in split(body)]
                found[name] = {"description": words_of(comments), "oneOf": options}
            else:
                found[name], parts = structure(words_of(comments), attributes, body)
                flattened += [(name, part) for part in parts]
        for comments, name, body in re.findall(r"words! \{\n((?:    ///[^\n]*\n)*)    (\w+) \{\n(.*?)^    \}", source, re.S | re.M):
            options = [{"const": re.search(r'"([^"]+)"', item)[1], "description": words} for words, _, item in split(body)]
            found[name] = {"description": words_of(comments), "oneOf": options}
    for name, part in flattened:
        found[name]["properties"] = found[part]["properties"] | found[name]["properties"]
        found[name]["required"] = found[part].get("required", []) + found[name].get("required", [])
    return found


def schema(name, title):
    """The schema of a type, with those of all that it refers to."""
    every, found = definitions(), {}

    def add(one):
        if one not in found:
            found[one] = every[one]
            for other in re.findall(r'"#/\$defs/(\w+)"', json.dumps(every[one])):
                add(other)

    add(name)
    return {"$schema": DRAFT, "title": title, **found.pop(name), "$defs": found}


def main():
    stale, is_check = [], "--check" in sys.argv
    for file, title in {"scenario": "A scenario of armplane", "graph": "A process graph of armplane", "summary": "summary.json of a run of armplane"}.items():
        path, text = HERE / f"{file}.json", f"{json.dumps(schema(file.capitalize(), title), indent=2, ensure_ascii=False)}\n"
        if not is_check:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            stale.append(path.name)
    if stale:
        sys.exit(f"{', '.join(stale)}: out of date; run python3 docs/schema/make.py")


if __name__ == "__main__":
    main()
