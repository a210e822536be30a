"""Fixtures of the audit's tests: the printed paper beside its derivation, and one whole audit."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from pmjoint_codegen.audit.context import Context
from pmjoint_codegen.audit.examination import COMPARISONS, audit, paper_context
from pmjoint_codegen.audit.findings import Finding


@pytest.fixture(scope="session")
def context() -> Context:
    """Return the printed equations beside the derivation."""
    return paper_context()


@pytest.fixture(scope="session")
def findings(cache: object) -> Mapping[str, Finding]:
    """Return everything that the audit finds, by number, in its order."""
    notices: list[str] = []
    found = {finding.number: finding for finding in audit(lambda fraction: None, notices.append)}
    assert len(found) > len(COMPARISONS)
    return found
