"""Model files with other gains: nothing else changes, and what cannot be edited is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from pmjoint_codegen.errors import ModelError
from pmjoint_codegen.tune.rewrite import rewrite

GAINS = {"c1": 20.5, "k1": 31.25, "k2": 977.0}


@pytest.mark.parametrize(
    "model", ["paper", "joint", "joint-damped", "joint-exact", "joint-lag", "third-order"]
)
def test_every_model_keeps_all_but_name_and_gains(root: Path, model: str) -> None:
    text = (root / "models" / f"{model}.toml").read_text(encoding="utf-8")
    edited = rewrite(text, "mine", GAINS, "by hand", model)
    before, after = tomllib.loads(text), tomllib.loads(edited)
    assert after["name"] == "mine"
    assert after["design"]["c"][0] == 20.5
    assert after["design"]["k"][:2] == [31.25, 977.0]
    assert after["design"]["e"] == before["design"]["e"]
    assert after["title"] == f"{before['title']}, gains tuned"  # figures credit no source with these gains
    assert tomllib.loads(rewrite(edited, "mine", GAINS, "again", model))["title"] == after["title"]
    edited = edited.replace(", gains tuned", "")
    lines = [line for line in edited.split("\n")[1:] if "# was [" not in line and '"mine"' not in line]
    assert len(lines) == text.count("\n") + 1 - 3  # name, c, k
    assert set(lines) <= set(text.split("\n"))


def test_a_comment_stays_behind_the_value_it_speaks_of() -> None:
    text = 'name = "a"\r\n[design]\r\nc = [1]\r\ne = [1]\r\nck = [1]\r\n'
    text += "k = [40, # fast\n 400] # at -20\r\n[other]\r\nk = [1]\r\n"
    edited = rewrite(text, "b", {"k1": 30.0}, "note", "a.toml")
    assert edited.startswith('# note\r\nname = "b"\r\n')
    assert edited.endswith("k = [30, 400] # was [40, 400]: at -20\r\n[other]\r\nk = [1]\r\n")


@pytest.mark.parametrize(
    "text",
    [
        'name = "a"\ndesign = { c = [1], e = [1], ck = [1], k = [1] }\n',
        'name = "a"\ndesign.c = [1]\ndesign.e = [1]\ndesign.ck = [1]\ndesign.k = [1]\n',
        'name = """a"""\n[design]\nc = [1]\ne = [1]\nck = [1]\nk = [1]\n',
        'text = """\n[design]\nk = [2]\n"""\nname = "a"\n[design]\nc = [1]\ne = [1]\nck = [1]\nk = [1]\n',
    ],
)
def test_what_cannot_be_edited_in_place_is_refused(text: str) -> None:
    with pytest.raises(ModelError, match="cannot be edited in place"):
        rewrite(text, "b", {"k1": 30.0}, "note", "a.toml")


def test_lists_that_follow_from_other_keys_are_written_out() -> None:
    text = """name = "m"
[design]
bandwidth = 10 # 1/s
poles = [[3, 1], 2] # of A0
c = [1, 2]
"""
    own = {"c1": 1.0, "c2": 2.0, "e1": 0.1, "e2": 0.02, "k0": 7.0, "k1": 8.0, "k2": 22.0, "k3": 20.0}
    edited = rewrite(text, "m2", {"e2": 0.5, "k1": 9.0, "c1": 4.0}, "tuned", "m", own)
    assert tomllib.loads(edited)["design"] == {
        "bandwidth": 10,
        "c": [4, 2],
        "e": [0.1, 0.5],
        "k": [9, 22, 20],
    }
    assert "k = [9, 22, 20] # was poles = [[3, 1], 2]: of A0" in edited


@pytest.mark.parametrize(
    ("design", "words", "wanted", "comment"),
    [
        (
            "c = [1]\ncompensator = true # (23)\n",
            {"saturation": "braking"},
            {"saturation": "braking"},
            "# was compensator = true: (23)",
        ),
        (
            'c = [1]\nsaturation = "braking"\nbraking = 0.6\nstart = "zero"\n',
            {"saturation": "clip", "start": "matched"},
            {"saturation": "clip", "start": "matched"},
            "# was braking = 0.6",
        ),
        ("c = [1]\n", {"start": "matched"}, {"start": "matched"}, ""),
        (
            'c = [1]\nsaturation = "clip"\ncompensator = false\n',
            {"saturation": "compensator"},
            {"saturation": "compensator"},
            "# was compensator = false",
        ),
    ],
)
def test_the_saturation_and_start_of_a_search_are_written_too(
    design: str, words: dict[str, str], wanted: dict[str, str], comment: str
) -> None:
    text = f'name = "a"\n[design]\n{design}[plant]\nstart = 1\n'
    edited = rewrite(text, "b", {"c1": 2.0}, "note", "a.toml", words=words)
    assert tomllib.loads(edited) == {"name": "b", "design": {"c": [2], **wanted}, "plant": {"start": 1}}
    assert comment in edited


def test_the_bandwidth_of_an_observer_is_one_number(root: Path) -> None:
    text = (root / "tests" / "simulate" / "joint-adrc.toml").read_text(encoding="utf-8")
    design = tomllib.loads(rewrite(text, "mine", {"c1": 12.0, "observer": 90.5}, "by hand", "x"))["design"]
    assert design == {"law": "adrc", "c": [12, 15], "observer": 90.5}
