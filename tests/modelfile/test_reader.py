"""What can be wrong with a model file before a single key is looked at."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.modelfile.reader import parse_document, read_document


def complaint(data: bytes, tmp_path: Path) -> str:
    file = tmp_path / "m.toml"
    file.write_bytes(data)
    with pytest.raises(ModelError) as caught:
        read_document(file)
    assert caught.value.where.startswith(str(file))
    return str(caught.value).replace(str(file), "m.toml")


def test_a_document_is_what_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_bytes('\ufeffname = "ξ" # x\r\n[plant]\norder = 2\n'.encode())
    assert read_document(tmp_path / "m.toml") == {"name": "ξ", "plant": {"order": 2}}


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"m\.toml: no such model file; give the path of a \.toml file"):
        read_document(tmp_path / "m.toml")


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="is a folder"):
        read_document(tmp_path)


def test_a_pipe_is_read_like_a_file(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.write(writer, b"order = 2\n")
    os.close(writer)
    assert read_document(Path(f"/dev/fd/{reader}")) == {"order": 2}
    os.close(reader)


def test_what_never_ends_is_too_large() -> None:
    with pytest.raises(ModelError, match="is too large"):
        read_document(Path("/dev/zero"))


def test_not_utf8_names_byte_and_line(tmp_path: Path) -> None:
    assert complaint(b'a = 1\nb = "\xe9"\n', tmp_path) == (
        "m.toml: is not UTF-8: byte 0xe9 on line 2; save the file as UTF-8"
    )


def test_bad_toml_names_the_line(tmp_path: Path) -> None:
    assert "is not valid TOML" in complaint(b"a = 1\nb = = 2\n", tmp_path)
    assert "line 2" in complaint(b"a = 1\nb = = 2\n", tmp_path)


def test_a_key_that_stands_twice_names_the_line(tmp_path: Path) -> None:
    assert "line 3" in complaint(b"[parameters]\nd1 = 1\nd1 = 2\n", tmp_path)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a = 1\n" * 20_000, "is too large"),
        (b"a." * 30_000 + b"a = 1", "line 1 has"),
        (b"a." * 20 + b"a = 1", "nested too deeply"),
        (b"a = " + b"[" * 3000, "is not valid TOML"),
        (b"a = " + b"[" * 50 + b"]" * 50, "nested too deeply"),
        (b"a = " + b"9" * 4000, "line|entry|is a whole number"),
        (b"a = " + b"9" * 4095, "line 1 has|TOML|whole number"),
        (
            b"a.b = [1, 2, 9223372036854775808]",
            "m.toml: a.b, entry 3: is 9223372036854775808; allowed: 64-bit",
        ),
        (b"a = 1979-05-27T07:32:00Z", "m.toml: a: is a date or time"),
        (b"a = 1979-13-45", "is not valid TOML"),
        (b"\x00", "is not valid TOML"),
    ],
)
def test_unreasonable_files_are_refused_at_once(data: bytes, words: str, tmp_path: Path) -> None:
    said = complaint(data, tmp_path)
    assert any(word in said for word in words.split("|")), said
    assert len(said) < 500


@given(st.binary(max_size=300) | st.text(alphabet="ab.[]{}=\"'\n#,1-:", max_size=300).map(str.encode))
@settings(deadline=None)
def test_any_bytes_give_a_document_or_a_model_error(data: bytes) -> None:
    with suppress(ModelError, UnicodeDecodeError):
        assert isinstance(parse_document(data.decode("utf-8-sig"), "m.toml"), dict)
