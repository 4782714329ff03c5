"""Every page has a policy by which a browser runs the scripts of this package alone, and asks no other host."""

from __future__ import annotations

import base64
import hashlib
import html
import re

import pytest

from executor.reports.html import policy, render, script
from tests.source_tree import ROOT

TEMPLATES = ROOT / "executor" / "reports" / "templates"
PAGES = sorted(path.name for path in TEMPLATES.glob("*.html") if "extends" in path.read_text(encoding="utf-8"))


def policy_in(page: str) -> str:
    found = re.search(r'<meta http-equiv=\'Content-Security-Policy\' content="([^"]*)">', page)
    assert found is not None
    # Before anything that it is about.
    assert not re.search(r"<(?:script|style|img|title)", page[: found.start()])
    return html.unescape(found[1])


def test_a_page_runs_its_own_scripts_and_no_others() -> None:
    hostile = "<script>fetch('http://127.0.0.1')</script>"
    page = render("view.html", title=hostile, kind="run", path=hostile, data="{}")
    assert hostile not in page
    allowed = policy_in(page)
    assert "default-src 'none'" in allowed and "unsafe-inline" not in re.sub(r"style-src [^;]*;", "", allowed)
    inline = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in inline]
    assert len(inline) == 2 and re.findall(r"'sha256-([^']*)'", allowed) == digests
    assert not re.search(r"\son[a-z]+\s*=", re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL))
    assert not re.search(r"https?:", allowed)


@pytest.mark.parametrize("name", PAGES)
def test_a_template_names_the_scripts_that_it_has(name: str) -> None:
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    assert "Content-Security-Policy" in (TEMPLATES / "base.html").read_text(encoding="utf-8")
    used = re.findall(r'<script>\{\{ script\("(\w+)"\)\|safe \}\}</script>', text)
    assert len(used) == len(re.findall(r"<script>", text))
    named = re.search(r"set (?:\w+, )*scripts = (?:\([^()]*\), )*\(([^()]*)\)", text)
    assert re.findall(r'"(\w+)"', named[1] if named else "") == used
    assert all(script(one) for one in used)
    assert ("sha256" in policy(*used)) is bool(used)
