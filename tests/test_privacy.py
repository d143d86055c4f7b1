"""Names with an underscore stay in their package: no other file imports them, not even the tests."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("impactlaw", "envs", "models", "scripts", "tests")
OTHERS = {"_replace", "_fields", "_env", "_step_mujoco_simulation"}  # of named tuples, shimmy and gymnasium


def walked(source: str) -> list[ast.AST]:
    return list(ast.walk(ast.parse(source)))


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def borrowed(nodes: list[ast.AST]) -> list[str]:
    """Return the private names that a file imports from another one, or uses from an imported module."""
    found, modules = [], set()
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules |= {(name.asname or name.name).split(".")[0] for name in node.names}
            found += [name.name for name in node.names if isinstance(node, ast.ImportFrom) and private(name.name)]
        if isinstance(node, ast.Attribute) and private(node.attr) and isinstance(node.value, ast.Name):
            known = node.value.id in modules and node.attr not in OTHERS
            found += [f"{node.value.id}.{node.attr}"] if known else []
    return found


def looked_at(nodes: list[ast.AST]) -> list[str]:
    """Return the private attributes that a file reads or replaces, except those of self."""
    found = []
    for node in nodes:
        if isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in OTHERS:
            found += [node.attr] if not isinstance(node.value, ast.Name) or node.value.id != "self" else []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "setattr":
            found += [a.value for a in node.args if isinstance(a, ast.Constant) and private(str(a.value))]
    return found


@pytest.mark.parametrize("folder", FOLDERS)
def test_nobody_borrows_a_private_name(folder):
    """Nor do tests see more than users."""
    offenders = {}
    for path in (ROOT / folder).rglob("*.py"):
        nodes = walked(path.read_text())
        found = borrowed(nodes) + (looked_at(nodes) if folder == "tests" else [])
        if found:
            offenders[str(path.relative_to(ROOT))] = found
    assert offenders == {}


def test_what_is_borrowed_is_found():
    assert looked_at(walked("a._b = c.d._e\nself._f\ng.setattr(h, '_i', j)\nk._replace()")) == ["_b", "_e", "_i"]
    assert borrowed(walked("from a import _b")) == ["_b"]
    assert borrowed(walked("import a\nfrom b import c\na._d = c._e")) == ["a._d", "c._e"]
    assert borrowed(walked("from a import b, __version__\nself._c = b.d")) == []
