"""Entries are read back whole or not at all, whatever was done to their folder."""

import os
import time

import pytest

from planner.learned.store import Store, StoreWarning

KEY, OTHER = "00" * 32, "ab" * 32


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "entries")


def files(store):
    return sorted(path for path in store.folder.rglob("*") if path.is_file())


def damage_flip(content):
    return content[:40] + bytes([content[40] ^ 1]) + content[41:]


@pytest.mark.parametrize(
    "damage",
    [
        damage_flip,
        lambda c: c[:-1],
        lambda c: c[:9],
        lambda c: bytes(99),
    ],
    ids=["a bit", "cut short", "no digest", "zeros"],
)
def test_a_damaged_entry_is_absent_with_one_warning_and_can_be_made_again(store, damage):
    store.put(KEY, b"content" * 10)
    store.put(OTHER, b"content" * 10)
    for path in files(store):
        path.write_bytes(damage(path.read_bytes()))
    with pytest.warns(StoreWarning, match="damaged") as caught:
        results = [store.get(key) for key in (KEY, OTHER)]
    assert results == [None, None]
    assert len(caught) == 1
    assert str(caught[0].message).isprintable()
    store.put(KEY, b"content" * 10)
    assert store.get(KEY) == b"content" * 10


def test_a_folder_that_cannot_be_made_costs_a_warning_and_nothing_else(tmp_path):
    (tmp_path / "file").write_text("in the way")
    store = Store(tmp_path / "file" / "entries")
    with pytest.warns(StoreWarning, match="going on without the cache") as caught:
        [store.put(key, b"content") for key in (KEY, OTHER)]
    assert len(caught) == 1


@pytest.mark.parametrize("key", ["", "../../etc", "AB" * 32, "ab/cd", "short"])
def test_a_name_that_is_no_digest_is_refused(store, key):
    with pytest.raises(ValueError, match="hexadecimal"):
        store.get(key)


def test_trimming_removes_what_was_not_used_for_longest(store):
    keys = [f"{k:02x}" * 32 for k in range(10)]
    for age, key in enumerate(keys):
        store.put(key, bytes(1000))
        path = store.folder / key[:2] / key[2:]
        os.utime(path, (time.time() - 1000 + age,) * 2)
    assert store.get(keys[0]) is not None  # used just now
    store.trim(limit_bytes=4 * 1032)
    assert [key for key in keys if store.get(key) is not None] == [keys[0], *keys[-3:]]
