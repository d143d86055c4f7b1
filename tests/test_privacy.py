"""Names with an underscore stay in their package: nobody else imports them, not even the tests."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("impactlaw", "envs", "models", "scripts", "tests")
FILES = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py") if not path.is_relative_to(ROOT / "out")]


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def borrowed(source: str) -> list[str]:
    """Private names that a file imports from another one, or takes of a module that it has imported."""
    found, modules = [], set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules |= {(name.asname or name.name).split(".")[0] for name in node.names}
            found += [name.name for name in node.names if isinstance(node, ast.ImportFrom) and private(name.name)]
        if isinstance(node, ast.Attribute) and private(node.attr) and isinstance(node.value, ast.Name):
            found += [f"{node.value.id}.{node.attr}"] if node.value.id in modules else []
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_nobody_borrows_a_private_name(path):
    assert borrowed(path.read_text()) == []


def test_what_is_borrowed_is_found():
    assert borrowed("from a import _b") == ["_b"]
    assert borrowed("import a\nfrom b import c\na._d = c._e") == ["a._d", "c._e"]
    assert borrowed("from a import b, __version__\nself._c = b.d") == []
