"""What is read from bytes, or written as bytes, says its byte order; so it is the same on a big-endian machine.

`make s390x` runs the decoders on one. Here every call that makes numbers of bytes is looked at, in every module.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "lidario"
MODULES = sorted(ROOT.rglob("*.py"))
TYPED = {"frombuffer": 1, "dtype": 0, "view": 0}
"""Calls of numpy that say how bytes are read: the place of the type among their arguments."""
PACKED = {"Struct", "pack", "pack_into", "unpack", "unpack_from", "iter_unpack", "calcsize"}
ONE_BYTE = {"uint8", "int8", "bool_"}
SAYS = re.compile(r"[<>!|].*|[?bBc]|[ui]1|\d*[sxBb]")


def unsaid(source: str) -> list[int]:
    """The lines whose types of several bytes have the byte order of the machine."""
    found = list[int]()
    if not any(f"{word}(" in source for word in (*TYPED, *PACKED)):
        return found
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name, module = node.func.attr, getattr(node.func.value, "id", "")
        if name in TYPED and len(node.args) > TYPED[name]:
            types = _types(node.args[TYPED[name]])
        elif name in PACKED and module == "struct":
            # "=" is the order of the machine, said on purpose: what the kernel of this machine hands over.
            types = [each for each in _types(node.args[0]) if not each.startswith("=")]
        else:
            continue
        if not all(SAYS.fullmatch(each) or each in ONE_BYTE for each in types):
            found.append(node.lineno)
    return found


def _types(node: ast.expr) -> list[str]:
    """The types in an argument: a text, `np.uint8`, those of the fields of a list, the formats of a dictionary."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.Attribute):
        return [node.attr] if getattr(node.value, "id", "") == "np" else []
    if isinstance(node, ast.List):
        return [each for field in node.elts if isinstance(field, ast.Tuple) for each in _types(field.elts[1])]
    if isinstance(node, ast.Dict):
        named = {
            key.value: value
            for key, value in zip(node.keys, node.values, strict=True)
            if isinstance(key, ast.Constant)
        }
        formats = named["formats"]
        assert isinstance(formats, ast.Tuple | ast.List)
        return [each for field in formats.elts for each in _types(field)]
    # A name stands for what `np.dtype` was called with; an f-string is given the order that a message names.
    return []


@pytest.mark.long
def test_every_number_of_several_bytes_says_its_order() -> None:
    lines = {path.relative_to(ROOT).as_posix(): unsaid(path.read_text(encoding="utf-8")) for path in MODULES}
    assert len(lines) > 200
    assert not {name: found for name, found in lines.items() if found}


@pytest.mark.parametrize(
    "line",
    [
        "np.frombuffer(data, np.uint16)",
        "np.frombuffer(data, 'u2')",
        "np.frombuffer(data, '=f4', 3, 1)",
        "rows.view(np.int32)",
        "np.dtype([('sync', 'u1'), ('time', 'u8')])",
        "np.dtype([('sync', 'u1'), ('words', 'u2', 4)])",
        "np.dtype({'names': ('a', 'b'), 'formats': ('<u4', 'i2')})",
        "struct.unpack('HB', data)",
        "struct.Struct('Q')",
    ],
)
def test_an_order_that_is_not_said_is_found(line: str) -> None:
    assert unsaid(line) == [1]


def test_most_of_the_decoders_have_such_a_call() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "families").glob("*/*.py")]
    assert sum("frombuffer" in text for text in texts) > 8
