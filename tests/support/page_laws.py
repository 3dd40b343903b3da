"""Conditions that every page must meet.

Each condition is JavaScript that runs in the page and returns the violations.
"""

from __future__ import annotations

from importlib import resources
from typing import Any

import pytest

CONTRAST = """() => {
  const parse = (text) => (text.match(/[0-9.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map((c) => c / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const behind = (node) => {
    for (let each = node; each; each = each.parentElement) {
      const colour = parse(getComputedStyle(each).backgroundColor);
      if (colour.length < 4 || colour[3] > 0.85) return colour;
    }
    return [255, 255, 255];
  };
  const poor = [];
  for (const node of document.querySelectorAll("body *")) {
    const own = [...node.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim());
    if (!own || node.matches("script, style, :disabled, option") || !node.getClientRects().length) continue;
    const style = getComputedStyle(node);
    const [a, b] = [light(parse(style.color)), light(behind(node))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const name = `${node.tagName} ${node.className} ${node.textContent.slice(0, 30)}`;
    if (ratio < (large ? 3 : 4.5)) poor.push(`${name}: ${ratio.toFixed(2)}`);
  }
  return poor;
}"""

UNNAMED = """() => [...document.querySelectorAll("button, input, select, summary, a[href], canvas")].filter((node) => {
  const named = node.textContent.trim() || node.getAttribute("aria-label") || node.labels?.length;
  const reached = node.matches("canvas, :disabled") || node.tabIndex >= 0;
  return !(named && reached) && !node.closest(".uplot");
}).map((node) => node.outerHTML.slice(0, 120))"""

OVERFLOW = """() => document.documentElement.scrollWidth > innerWidth
  ? [...document.querySelectorAll("body *")].filter((node) => node.getBoundingClientRect().right > innerWidth + 1)
      .map((node) => `${node.tagName}.${node.className}`).slice(0, 5)
  : []"""


CONTRAST_RULE = "{ runOnly: ['color-contrast'], resultTypes: ['violations'] }"
OTHER_RULES = "{ rules: { 'color-contrast': { enabled: false } }, resultTypes: ['violations'] }"


def serious(page: Any, contrast: bool = True) -> list[str]:
    """Return the serious and critical findings of axe-core on a page.

    With `contrast` they include the contrast in light and in dark mode.
    """
    axe = pytest.importorskip(
        "axe_playwright_python",
        reason="axe-core is not installed (pip install axe-playwright-python)",
    )
    page.evaluate(resources.files(axe).joinpath("axe.min.js").read_text(encoding="utf-8"))
    result = page.evaluate(f"axe.run({OTHER_RULES})")["violations"]
    for scheme in ("light", "dark") if contrast else ():
        page.emulate_media(color_scheme=scheme)
        result += page.evaluate(f"axe.run({CONTRAST_RULE})")["violations"]
    return [
        f"{item['id']}: {node['html'][:160]}"
        for item in result
        if item["impact"] in ("serious", "critical")
        for node in item["nodes"]
    ]
