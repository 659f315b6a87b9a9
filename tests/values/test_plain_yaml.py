"""YAML: what it means, and what it may not do."""

import json
import re
import time
from contextlib import suppress

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from gmrdata.gmr.train import GmrRecipe
from gmrdata.stage.recipes import load_recipe
from gmrdata.values.body import JOINT
from gmrdata.values.errors import BadMotionFile, BadRecipe
from gmrdata.values.joint_names import REQUIRED, find_joints
from gmrdata.values.plain_yaml import NotPlain, dump, parse

VALUES = {
    "true": True, "False": False, "yes": "yes", "off": "off", "y": "y",
    "12": 12, "-3": -3, "+4": 4, "0": 0, "02": "02", "02_03": "02_03", "0x1f": "0x1f",
    "1_000": "1_000", ".inf": float("inf"),
    "1.5": 1.5, "-.5": -0.5, "1e-3": 1e-3, "5E5": 5e5, "2.": 2.0, "1.0e+2": 100.0,
    "-.INF": float("-inf"), "1:30": "1:30", "1:30.5": "1:30.5", "2021-12-01": "2021-12-01",
    "2020-99-99": "2020-99-99", "2001-12-14 21:59:43.10 -5": "2001-12-14 21:59:43.10 -5",
    "": None, "~": None, "null": None, "=": "=", "'5'": "5", "!!str 5": "5", "!!float 5": 5.0,
}  # fmt: skip


@pytest.mark.parametrize("text", sorted(VALUES))
def test_what_a_scalar_means(text):
    found = parse(f"a: {text}\n")[0]["a"]
    assert found == VALUES[text] and type(found) is type(VALUES[text])


def test_keys_are_texts_and_lines_are_known():
    value, lines = parse("1: a\n02: b\ntrue: c\n'<<': d\nlast:\n- e\n- f: g\n")
    assert value == {"1": "a", "02": "b", "true": "c", "<<": "d", "last": ["e", {"f": "g"}]}
    assert lines[("last", 1, "f")] == 7


BAD = {
    "alias": ("a: &x [1]\nb: *x\n", 1, "anchors and aliases"),
    "merge": ("a: {}\n<<: {b: 1}\n", 2, "plain text"),
    "a tag of merging": ("? !!merge <<\n: {b: 1}\n", 1, "plain text"),
    "twice": ("a: 1\n'a': 2\n", 2, "stands twice"),
    "deep": ("a: " + "[" * 100_000, 1, "nested more than 32 levels"),
    "deep in lines": ("".join(f"{' ' * n}a:\n" for n in range(40)), 33, "nested more than 32"),
    "many digits": ("a: " + "9" * 5000 + "\n", 1, "an endless number"),
    "no truth": ("a: !!bool abc\n", 1, "neither true nor false"),
    "no date": ("a: !!timestamp 2020-99-99\n", 1, "a tag of no plain data"),
    "no number": ("a: !!int '1:2'\n", 1, "no whole number"),
    "no real number": ("a: !!float abc\n", 1, "no number"),
    "no null": ("a: !!null abc\n", 1, "not null"),
    "a list as text": ("a: !!str [1]\n", 1, "tagged as text"),
    "a set": ("a: !!set {b}\n", 1, "a tag of no plain data"),
    "pairs": ("a: !!omap [b: 1]\n", 1, "a tag of no plain data"),
    "code": ("a: !!python/object/apply:os.getcwd []\n", 1, "a tag of no plain data"),
    "two documents": ("a: 1\n---\nb: 2\n", 2, "not plain YAML"),
    "no YAML": ("a: [1\n", 2, "not plain YAML"),
    "a control character": ("a: \x00\n", None, "not plain YAML"),
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_what_is_refused(name, tmp_path):
    text, line, said = BAD[name]
    start_s = time.monotonic()
    with pytest.raises(NotPlain, match=said) as caught:
        parse(text)
    assert caught.value.line == line
    path = tmp_path / "r.yaml"
    path.write_text(text)
    with pytest.raises(BadRecipe, match=rf"r\.yaml{'' if line is None else f':{line}'}: .*{said}"):
        load_recipe(path, GmrRecipe)
    with pytest.raises(BadMotionFile, match=said):
        find_joints(("Hips",), (-1,), path, path)
    assert time.monotonic() - start_s < 5


def test_a_joint_map_of_over_a_mebibyte_is_none(tmp_path):
    """Recipes may be larger than that."""
    path = tmp_path / "names.yaml"
    path.write_text("Hips: pelvis\n" + "#" * (1 << 20))
    with pytest.raises(BadMotionFile, match="larger than 1048576 bytes; no joint map is"):
        find_joints(("Hips",), (-1,), path, path)


@pytest.mark.parametrize("name", ["names.yaml", "names.json"])
def test_a_joint_map_may_begin_with_a_byte_order_mark(name, tmp_path):
    """As editors of Windows save it; that of JSON was refused."""
    names = [f"bone {n}" for n in range(len(REQUIRED))]
    text = json.dumps(dict(zip(names, REQUIRED, strict=True)))
    (path := tmp_path / name).write_text(text, encoding="utf-8-sig")
    found = find_joints(names, [-1] * len(names), path, path)
    assert found == {JOINT[joint]: n for n, joint in enumerate(REQUIRED)}


def is_text(written: str) -> bool:
    """Also in YAML 1.2, where 1e5 is a number; PyYAML writes a text `1e5` without quotes."""
    return not re.fullmatch(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+", written)


plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**17), 10**17) | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"])).filter(is_text),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("ab1<~"), inner, max_size=2),
    max_leaves=8,
)  # fmt: skip


@given(value=plain)
def test_what_pyyaml_writes_is_read(value):
    assert parse(yaml.safe_dump(value, allow_unicode=True))[0] == value


@pytest.mark.parametrize("written", ["0E0", "1e5", "-1.5e+3", ".5E-2", "1.e5"])
def test_a_text_that_is_a_number_in_yaml_1_2_stays_a_text(written):
    """PyYAML leaves it without quotes, and would read a text."""
    assert parse(dump({written: written}))[0] == {written: written}
    assert parse(written)[0] == float(written)


@given(text=st.text("ab01:-.,[]{}&*!<#|>'\"\n \t~%@", max_size=40))
def test_any_text_is_read_or_refused(text):
    with suppress(NotPlain):
        parse(text)
