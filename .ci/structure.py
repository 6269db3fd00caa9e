#!/usr/bin/env python3
"""Checks the source's structure: import cycles, imports against the order of the pipeline, long files and functions.

Rules: no cycle of more than three files, no import of a module that src/lib.rs lists later, no file above 500 lines,
no function above 100 lines. Tests (`tests.rs`, `*_tests.rs`, files below `tests/`, `#[cfg(test)]`) may import anything.
Imports are `use` declarations, and paths that begin with `crate`, `super` or a member's name. A `mod.rs` or `lib.rs`
without functions only re-exports and has no edges. Each violation prints a line, and the exit code is 1.
"""
import re
import sys
import tomllib
from pathlib import Path

MAX_CYCLE, MAX_FILE_LINES, MAX_FUNCTION_LINES = 3, 500, 100
ROOT = Path(__file__).resolve().parent.parent
FACES = ("mod", "lib", "main")


def packages():
    """Yields library name and source folder of the root package and of the members."""
    for manifest in [ROOT / "Cargo.toml", *sorted(ROOT.glob("src/*/Cargo.toml")), ROOT / "python/Cargo.toml"]:
        toml = tomllib.loads(manifest.read_text())
        library = toml.get("lib", {})
        name = library.get("name", toml["package"]["name"]).replace("-", "_")
        yield name, (manifest.parent / library.get("path", "src/lib.rs")).parent


def modules(folders):
    """Returns the file of each (package, module path)."""
    found = {}
    for package, folder in folders.items():
        members = [other for other in folders.values() if other != folder and folder in other.parents]
        for file in sorted(folder.rglob("*.rs")):
            path = file.relative_to(folder).with_suffix("").parts
            is_test = "tests" in path or path[-1].endswith("_tests")
            if is_test or any(member in file.parents for member in members):
                continue
            found[package, path[:-1] if path[-1] in FACES else path] = file
    return found


def without_tests_and_comments(text):
    text = re.sub(r"#\[cfg\(test\)\]\s*(pub\S* )?mod \w+ \{.*", "", text, flags=re.S)
    return re.sub(r"//[^\n]*", "", text)


def leaves(prefix, tree):
    """Yields the paths of a `use` tree: a::b, a::c::d and a::c::e for `a::{b, c::{d, e}}`."""
    tree = tree.strip()
    group = re.fullmatch(r"([\w:]*)\{(.*)\}", tree, re.S)
    if not group:
        yield prefix + re.split(r"\s+as\s+", tree)[0].rstrip("*:")
        return
    depth, start, inner = 0, 0, group[2] + ","
    for at, character in enumerate(inner):
        depth += {"{": 1, "}": -1}.get(character, 0)
        if character == "," and depth == 0:
            if inner[start:at].strip():
                yield from leaves(prefix + group[1], inner[start:at])
            start = at + 1


def resolve(files, key, path):
    """Returns the module that `path` names in the module `key`: the longest prefix of `path` that is a module."""
    package, here = key
    parts = [part for part in path.split("::") if part]
    if not parts:
        return None
    if parts[0] == "crate":
        target, parts = package, parts[1:]
    elif parts[0] in ("self", "super"):
        target, here = package, list(here)
        while parts and parts[0] in ("self", "super"):
            if parts.pop(0) == "super":
                here = here[:-1]
        parts = here + parts
    elif any(name == parts[0] for name, _ in files):
        target, parts = parts[0], parts[1:]
    else:
        return None
    lengths = range(len(parts), -1, -1)
    return next((k for k in ((target, tuple(parts[:n])) for n in lengths) if k in files), None)


def imports(files):
    code = {key: without_tests_and_comments(file.read_text()) for key, file in files.items()}
    only_reexports = {key for key, file in files.items() if file.stem in FACES and not re.search(r"\bfn \w", code[key])}
    graph = {}
    for key, text in code.items():
        paths = [leaf for use in re.finditer(r"(?<!pub )\buse\s+([^;]+);", text) for leaf in leaves("", use[1])]
        paths += re.findall(r"\b(?:crate|super)(?:::\w+)+", re.sub(r"\buse\s+[^;]+;", "", text))
        targets = {resolve(files, key, path) for path in paths}
        graph[key] = {target for target in targets if target and target != key and target not in only_reexports}
    return graph


def cycles(graph):
    """Returns the strongly connected components of more than one module (Tarjan)."""
    number, lowest, stack, found = {}, {}, [], []

    def visit(key):
        number[key] = lowest[key] = len(number)
        stack.append(key)
        for target in graph[key]:
            if target not in number:
                visit(target)
            if target in stack:
                lowest[key] = min(lowest[key], lowest[target])
        if lowest[key] == number[key]:
            at = stack.index(key)
            component, stack[at:] = stack[at:], []
            found.append(component)

    sys.setrecursionlimit(10_000)
    for key in graph:
        if key not in number:
            visit(key)
    return [component for component in found if len(component) > 1]


def long_functions(lines):
    """Yields name and length of each function above the limit; rustfmt aligns its last brace with its first letter."""
    for start, line in enumerate(lines):
        head = re.match(r"(\s*)(?:pub(?:\([^)]*\))? )?(?:const |async |unsafe )*fn (\w+)", line)
        if head:
            end = next((n for n in range(start, len(lines)) if lines[n] == head[1] + "}"), start)
            if end - start + 1 > MAX_FUNCTION_LINES:
                yield head[2], end - start + 1


def violations():
    files = modules(dict(packages()))
    relative = {key: file.relative_to(ROOT) for key, file in files.items()}
    graph = imports(files)
    for cycle in cycles(graph):
        if len(cycle) > MAX_CYCLE:
            yield f"{len(cycle)} files import each other: {', '.join(sorted(str(relative[key]) for key in cycle))}"
    order = re.findall(r"^(?:pub(?:\(crate\))? )?mod (\w+);", (ROOT / "src/lib.rs").read_text(), re.M)
    for (package, path), targets in graph.items():
        for other, target in targets:
            stages = [order.index(p[0]) for p in (path, target) if p and p[0] in order]
            if package == other == "glasshouse" and len(stages) == 2 and stages[0] < stages[1]:
                yield f"{relative[package, path]} imports {relative[other, target]}, which src/lib.rs lists later"
    for key, file in files.items():
        lines = file.read_text().splitlines()
        if len(lines) > MAX_FILE_LINES:
            yield f"{relative[key]} has {len(lines)} lines, above the limit of {MAX_FILE_LINES}: split it by subject"
        for name, length in long_functions(lines):
            yield f"fn {name} in {relative[key]} has {length} lines, above the limit of {MAX_FUNCTION_LINES}"


found = list(violations())
print("\n".join(found) or "ok")
sys.exit(bool(found))
