"""The report of a run: one self-contained HTML file."""

from __future__ import annotations

from executor.results.report.page import report_page

__all__ = ["report_page"]
