"""Read the comments beside the fields of a class, which state the meanings of keys."""

import ast
import inspect
import io
import tokenize
from collections.abc import Mapping


def comments_of(kind: type) -> Mapping[str, str]:
    """Return the comment of each field of a class, without the fields of its bases.

    The comment of a field is on its line, or on the lines right above it. A comment above several
    fields in succession belongs to the first one.
    """
    source = inspect.cleandoc("\n" + inspect.getsource(kind))
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {
        each.start[0]: each.string.lstrip("# ") for each in tokens if each.type == tokenize.COMMENT
    }
    lines = source.splitlines()
    (node,) = ast.parse(source).body
    assert isinstance(node, ast.ClassDef)
    found = {}
    for field in node.body:
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        words = [
            comments[n] for n in range(field.lineno, (field.end_lineno or 0) + 1) if n in comments
        ]
        above = field.lineno - 1
        while above in comments and lines[above - 1].lstrip().startswith("#"):
            words.insert(0, comments[above])
            above -= 1
        if words and not words[0].startswith(("type: ignore", "noqa")):
            found[field.target.id] = sentence(" ".join(words))
    return found


def sentence(text: str) -> str:
    """Return a text that begins with a capital letter and ends with a full stop."""
    shown = text[0].upper() + text[1:] if text[0].isascii() else text
    return shown if shown.endswith((".", "!", "?")) else f"{shown}."
