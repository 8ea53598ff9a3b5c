"""An edit of the library changes the digest of exactly the stages that use it."""

import pytest

from gsbridge import digests


@pytest.fixture
def package(tmp_path, monkeypatch):
    root = tmp_path / "gsbridge"
    (root / "sub").mkdir(parents=True)
    (root / "__init__.py").write_text("")
    (root / "logs.py").write_text("def start(): pass\n")
    (root / "base.py").write_text('"""Doc."""\nX = 1\n')
    (root / "sub" / "__init__.py").write_text('"""Doc."""\n')
    (root / "sub" / "leaf.py").write_text("from gsbridge import base, logs\n\ndef f():\n    return base.X\n")
    (root / "other.py").write_text("Y = 2\n")
    monkeypatch.setattr(digests, "PACKAGE", root)

    def clear():
        digests._tree.cache_clear()
        digests._code.cache_clear()
        digests.direct_imports.cache_clear()

    clear()
    yield root, clear
    clear()


def test_closure_follows_imports(package):
    assert digests.import_closure(["gsbridge.sub.leaf"]) == {"gsbridge.sub.leaf", "gsbridge.sub", "gsbridge.base"}


@pytest.mark.parametrize(
    ("file", "text", "changes"),
    [
        ("base.py", '"""Another doc."""\n# a comment\nX = 1\n', False),
        ("base.py", '"""Doc."""\nX = 2\n', True),
        ("other.py", "Y = 3\n", False),
        ("logs.py", "def start(): return 1\n", False),
        ("sub/__init__.py", "Z = 1\n", True),
    ],
)
def test_digest_follows_meaning(package, file, text, changes):
    root, clear = package
    before = digests.code_digest("gsbridge.sub.leaf")
    (root / file).write_text(text)
    clear()
    assert (digests.code_digest("gsbridge.sub.leaf") != before) is changes


def test_unknown_module_is_refused(package):
    with pytest.raises(ValueError, match="no module"):
        digests.code_digest("gsbridge.none")
