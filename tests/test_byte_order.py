"""What is read from bytes, or written as bytes, says its byte order; so it is the same on a big-endian machine.

`make s390x` runs the decoders on one. Here every call that makes numbers of bytes is looked at, in every module.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "lidario"
MODULES = sorted(ROOT.rglob("*.py"))
PLACES = {"frombuffer": 1, "dtype": 0, "view": 0}
"""Calls of numpy that say how bytes are read: the place of the type among their arguments."""
OF_NUMPY = re.compile(r"'=?[uif][248]'|np\.(u?int|float)(16|32|64)")
OF_STRUCT = re.compile(r"'\d*[a-zA-Z?][\w?]*'")
"""Types of several bytes in the order of the machine. "=" says that order on purpose: the kernel's, in `struct`."""


def unsaid(source: str) -> list[int]:
    """The lines whose types of several bytes have the byte order of the machine."""
    found = list[int]()
    if not any(f"{word}(" in source for word in PLACES) and "struct." not in source:
        return found
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            words = [ast.unparse(each) for each in node.args]
            of_struct = ast.unparse(node.func).startswith("struct.") and OF_STRUCT.fullmatch(words[0])
            kinds = words[PLACES.get(node.func.attr, len(words)) :][:1]
            if of_struct or any(map(OF_NUMPY.search, kinds)):
                found.append(node.lineno)
    return found


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
