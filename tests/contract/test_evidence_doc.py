"""The evidence page maps each required clause to tests that exist."""

import re

from programs import ROOT

PAGE = (ROOT / "tools" / "docs" / "evidence.md").read_text(encoding="utf-8")
CLAUSES = ("1.1.9", "1.2.1", "CR 2.8", "CR 3.4", "CR 6.1")


def test_evidence_page_maps_each_clause_to_existing_test():
    clauses = tuple(f"| {clause}" for clause in CLAUSES)
    rows = [row for row in PAGE.splitlines() if row.startswith(clauses)]
    for clause in CLAUSES:
        assert any(row.startswith(f"| {clause}") for row in rows), clause
    for row in rows:
        named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", row)
        assert named, row
        for path, name in named:
            text = (ROOT / path).read_text(encoding="utf-8")
            assert not name or f"def {name}(" in text, f"{path} has no {name}"


def test_evidence_page_claims_no_performance_level():
    assert "no performance level" in PAGE
