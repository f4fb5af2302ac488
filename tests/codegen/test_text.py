"""Text of others: no line breaks where they would mean something, nothing endless, no secrets."""

import re
import tomllib
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.codegen.text import c_comment, c_string, markdown, one_line, shortened, without_secrets, xml_text


@given(st.text(alphabet=st.characters(codec=None)))
def test_what_is_one_line_is_a_comment_of_a_file(text: str) -> None:
    comment = one_line(text)
    assert tomllib.loads(f"# {comment}\na = 1") == {"a": 1}
    assert len(f"x{comment}x".splitlines()) == 1
    assert comment.encode("utf-8").decode("utf-8") == comment


def test_what_is_harmless_stays_as_it_is() -> None:
    assert one_line("Strömung, 0.5 m/s²") == "Strömung, 0.5 m/s²"
    assert one_line("a\nb\x7f\ud800") == "a\\nb\\x7f\\ud800"


@given(st.text())
def test_nothing_ends_a_c_comment(text: str) -> None:
    assert "*/" not in c_comment(text)
    assert "/*" not in c_comment(text)


@given(st.text(alphabet=st.characters(codec=None)))
def test_nothing_ends_a_c_string(text: str) -> None:
    assert re.fullmatch(r'(?:[^"\\?]|\\["\\?])*', c_string(text))


@given(st.text(alphabet=st.characters(codec=None)))
def test_nothing_ends_a_cell_of_a_table(text: str) -> None:
    assert re.fullmatch(r"(?:[^\\`*\[\]<>|&]|\\.)*", markdown(text))
    assert len(f"x{markdown(text)}x".splitlines()) == 1


@given(st.text(alphabet=st.characters(codec=None)))
def test_nothing_is_no_xml(text: str) -> None:
    element = ET.fromstring(ET.tostring(ET.Element("a", b=xml_text(text)), encoding="utf-8"))  # noqa: S314
    assert element.get("b") == xml_text(text)


def test_a_message_fits_a_screen() -> None:
    assert shortened("a " + "9" * 5000 + " b") == f"a {'9' * 100}…{'9' * 100} b"
    assert len(shortened("word " * 5000)) == 1500
    assert shortened("short\n  words") == "short words"


@pytest.mark.parametrize(
    "text",
    [
        "postgresql://me:hush@host/db",
        "postgresql+psycopg://me:p@hush@host/db",
        "postgresql://host/db?user=me&password=hush",
        "postgresql://host/db?p%61ssword=hush",
        "POSTGRESQL://host/db?sslpassword=hush",
        "host=h password=hush",
        "host=h password='a hush'",
        "PGPASSWORD = hush",
        "the server said: hush-hush",
    ],
)
def test_secrets_are_not_told(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PGPASSWORD", "hush-hush")
    assert "hush" not in without_secrets(f"cannot use '{text}': no")


def test_a_hint_and_a_hidden_password_stay() -> None:
    for text in ("must be postgresql+psycopg://USER@HOST/DATABASE", "postgresql://me:***@host/db?***: is gone"):
        assert without_secrets(text) == text
